"""What the configuration describes by itself, without the rest of it: the radar."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from radartwin.radar.chirp import Radar

if TYPE_CHECKING:
    from radartwin.config.radar import RadarConfig


def build_radar(config: RadarConfig) -> Radar:
    """The configured radar: read from its file, or a board's values with what the configuration sets.

    Raises:
        InputError: values that are no radar; MissingError, RecordingError: the file is absent or malformed.
    """
    if config.file:
        radar = Radar.from_file(Path(config.file))
        return replace(radar, element=config.element) if config.element else radar
    board = Radar.iwr1843().to_dict() if config.name == "iwr1843" else {}
    return Radar.from_dict({"element": "iwr1843", **board, **config.given()})
