"""SHA-256 of each room's answers.json, written by `radartwin.label.recorded.ship`: what depends on the answers depends on this module."""

DIGESTS: dict[str, str] = {
    "arkit_lidar_chair_scan": "1564de8f507943e5ff80ddaadf778f813b2a26a4dc80faa091ed6e4dd9f0c2bc",
    "atrium": "fa1a2be8eb39bb3063a91e09af8a8aa2e4b6a38b949d99e3ff02582525af3cff",
    "lab": "042b19b3cc002b74f23a2db71ce951dc94b999421f1be404d08ed5d1b674fcbf",
    "squash_court": "4d950e9615fafc369653af6da54749c5436d603e1a00ad011280fed9f26848c2",
}
