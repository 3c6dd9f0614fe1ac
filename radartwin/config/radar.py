"""Configuration of the radar."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from radartwin.config.checked_fields import Checked, choice, path_name
from radartwin.errors import ConfigError


@dataclass
class RadarConfig(Checked):
    """Fields of `radartwin.Radar`, or the radar description file with their values. A null field takes the value of the board or file."""

    KEY = "radar"
    name: str = "iwr1843"
    file: str | None = path_name()  # radar description: mmWave SDK .cfg, mmWave Studio .mmwave.json, or .yaml
    array: str | None = path_name()  # table of the antennas, .csv or .yaml (radartwin/radar/array_table.py), in place of the positions
    start_frequency_hz: float | None = None
    slope_hz_per_s: float | None = None
    sample_rate_hz: float | None = None
    num_samples: int | None = None
    num_chirps: int | None = None  # number of chirps per transmitter and frame
    tx_positions_m: list[list[float]] | None = None
    rx_positions_m: list[list[float]] | None = None
    chirp_interval: float | None = None  # seconds between the starts of successive chirps, counting the chirps of all transmitters
    frame_rate_hz: float | None = None
    element: str | None = choice(None, "iwr1843", "isotropic")  # pattern of the antenna elements; also allowed together with a file
    noise_figure_db: float | None = None
    transmit_power_dbm: float | None = None
    real_sampling: bool | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.name == "file" and not self.file:
            raise ConfigError("radar=file needs the file: add radar.file=FILE.cfg or FILE.mmwave.json")
        if self.name != "file" and self.file:
            raise ConfigError(f"radar.file is only read by radar=file, and radar.name is {self.name}; add radar=file")
        if self.array and (self.tx_positions_m or self.rx_positions_m):
            raise ConfigError("radar.array and radar.tx_positions_m or rx_positions_m both give the antennas; leave out one of them")
        if self.file and (refused := sorted(set(self.given()) - {"name", "element"})):
            raise ConfigError(f"radar.{refused[0]} is set, but radar=file takes it from {self.file}; change it there, or leave it out here")

    def given(self) -> dict[str, Any]:
        return {f.name: value for f in fields(self) if f.name not in ("file", "array") and (value := getattr(self, f.name)) is not None}
