"""SHA-256 of each room's answers.json, written by `radartwin.label.recorded.ship`: what depends on the answers depends on this module."""

DIGESTS: dict[str, str] = {
    "arkit_lidar_chair_scan": "c01d1cc5b3f8146e27e405e683dea3e0ae6e1a45cf41027a32b11a295cc0c080",
    "atrium": "df46e87ab32f0384375a003643d014e6d2473388113dbd7fef90d4f962a1e550",
    "lab": "be8403f54ee082c1f2e63a8b29917c31953b9b11cc52b970037956ecba44ffca",
    "squash_court": "96c3a127cf644ad518a97c99a359bf24478c87c5ed1770be067e0939c19fd04d",
}
