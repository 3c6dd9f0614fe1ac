"""SHA-256 of each room's answers.json, so that keys of stored results depend on the answers. `ship_records` writes it."""

DIGESTS: dict[str, str] = {
    "arkit_lidar_chair_scan": "7c2a9d2908e9bb97b5a0f14204f988af4931eb911d057a0b92ba2fc0fe66bf94",
    "atrium": "b4e7739bf0a36a0535b893ff5ff8a23bb600f5129458a4927e539eb8f03f04d0",
    "cc0_furnished_room": "4296df76723d36640a0aa6c5224a861bf44784afa9517a89fde480282ec79da0",
    "lab": "edcb70940ec40bbbac0ec025c940d9b53e39478c754c305acdcea6039fbf6f4b",
    "squash_court": "ade6b5109237c5129723a357681921a376df1d2bef16b7098ae3d249298ded6b",
}
