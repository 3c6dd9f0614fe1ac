"""Configuration of the radar."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from radartwin.config.checks import one_of, path_field
from radartwin.errors import ConfigError


@dataclass
class RadarConfig:
    """The fields of `radartwin.Radar`, or a TI configuration file that holds them. Positions: metres, x forward, y
    left, z up.
    """

    name: str = "iwr1843"
    file: str | None = path_field()  # mmWave SDK .cfg, mmWave Studio .mmwave.json, .yaml; only element may be set beside it
    start_frequency_hz: float | None = None
    slope_hz_per_s: float | None = None
    sample_rate_hz: float | None = None
    num_samples: int | None = None
    num_chirps: int | None = None  # loops per transmitter and frame
    tx_positions_m: list[list[float]] | None = None
    rx_positions_m: list[list[float]] | None = None
    chirp_interval: float | None = None  # seconds between successive chirp starts, transmitters interleaved
    frame_rate_hz: float | None = None
    element: str | None = None  # iwr1843 | isotropic; null: the file's, else iwr1843
    noise_figure_db: float | None = None
    transmit_power_dbm: float | None = None
    real_sampling: bool | None = None  # null: the file's, else false

    def __post_init__(self) -> None:
        if self.element is not None:
            one_of("radar.element", self.element, ("iwr1843", "isotropic"))
        if self.name == "file" and not self.file:
            raise ConfigError("radar=file needs the file: add radar.file=FILE.cfg or FILE.mmwave.json")
        if self.name != "file" and self.file:
            raise ConfigError(f"radar.file is only read by radar=file, and radar.name is {self.name}; add radar=file")
        if self.file and (refused := sorted(set(self.given()) - {"name", "element"})):
            raise ConfigError(f"radar.{refused[0]} is set, but radar=file takes it from {self.file}; change it there, or leave it out here")

    def given(self) -> dict[str, Any]:
        """The fields that the option or the user set, by the names `Radar` has for them."""
        return {f.name: value for f in fields(self) if f.name != "file" and (value := getattr(self, f.name)) is not None}
