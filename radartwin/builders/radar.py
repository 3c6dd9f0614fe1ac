"""Build the configured radar."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from radartwin.config.compose import compose
from radartwin.config.radar import RadarConfig
from radartwin.radar.chirp import Radar


def build_radar(config: RadarConfig) -> Radar:
    """Build the radar from the configured radar file, or else from the evaluation board with the configured values.

    Raises:
        InputError: a configured value is impossible for a radar.
        MissingError, RecordingError: the radar file is absent or malformed.
    """
    if config.file:
        radar = Radar.from_file(Path(config.file))
        return replace(radar, element=config.element) if config.element else radar
    board = Radar.iwr1843().to_dict() if config.name == "iwr1843" else {}
    return Radar.from_dict({"element": "iwr1843", **board, **config.given()})


def named_radar(name: str) -> Radar:
    """Build the radar of a radar file, or of an option of the configuration group `radar` such as "openradar_77ghz"."""
    if Path(name).suffix or Path(name).exists():
        return Radar.from_file(name)
    return build_radar(compose([f"radar={name}"]).radar)
