"""SHA-256 of each room's answers.json, so that keys of stored results depend on the answers. `ship_records` writes it."""

DIGESTS: dict[str, str] = {
    "arkit_lidar_chair_scan": "eb1b79492623482ae8e9e3e3c5aff9cbbe365ce0523d2746ddc912587919ebc9",
    "atrium": "caa583bc3e66068da5857a55b7e2e1f3151984a849e1db7c6027d990c98faf58",
    "cc0_furnished_room": "4296df76723d36640a0aa6c5224a861bf44784afa9517a89fde480282ec79da0",
    "lab": "b7602b794672ac496ba2d2de4aebd1ddc1cbca14163c1c3860ee2f0c83733756",
    "squash_court": "c69414d59183bc87068087aa73bc7f77b37ec227460f544f89a7307907820b13",
}
