"""Build the configured radar."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from radartwin.config.compose import compose
from radartwin.config.radar import RadarConfig
from radartwin.radar.array_table import read_array
from radartwin.radar.chirp import Radar
from radartwin.radar.named import NAMED


def build_radar(config: RadarConfig) -> Radar:
    """Build the radar from the configured radar file, or from the named radar with the configured values.

    An array table replaces the antennas and their gains, and the configured `element` replaces their pattern. Raises UserError.
    """
    array = {"tx_gains_db": None, "rx_gains_db": None, **read_array(config.array)} if config.array else {}
    element = {"element": config.element} if config.element else {}
    if config.file:
        return replace(Radar.from_file(Path(config.file)), **{**array, **element})
    board = NAMED[config.name]().to_dict() if config.name in NAMED else {}
    return Radar.from_dict({"element": "iwr1843", **board, **array, **config.given()})


def named_radar(name: str) -> Radar:
    """Build the radar of a radar file, or of an option of the configuration group `radar` such as "openradar_77ghz"."""
    if Path(name).suffix or Path(name).exists():
        return Radar.from_file(name)
    return build_radar(compose([f"radar={name}"]).radar)
