"""SHA-256 of each room's answers.json, so that keys of stored results depend on the answers. `radartwin.label.recorded.ship` writes it."""

DIGESTS: dict[str, str] = {
    "arkit_lidar_chair_scan": "0077eb4166d80563475131359ffcb8bf5532950730e5cb8a1a8eaa7c71abedd2",
    "atrium": "3a99197555116f032a4c003d500980e5197669753f8e87aa9e8b03b2144f8b5a",
    "lab": "bcf379297180c3a5cf0237756dbd7bdc8f2254e413eda4d76e113b0c94f423a5",
    "squash_court": "2ed39aeb759054e018380b6323359a2d51c5b4c1408421fc25c693a35226bbb5",
}
