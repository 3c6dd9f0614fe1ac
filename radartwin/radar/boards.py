"""Define the antenna positions and the element pattern of the evaluation boards.

References: AWR1843BOOST and IWR1843BOOST user's guide (TI SPRUIM4B) and IWR6843ISK in the mmWave EVM user's guide
(TI SWRU546): receivers half a wavelength apart, transmitters one wavelength apart in azimuth, TX2 raised by half a
wavelength. TX1 and TX3 with four receivers therefore form eight half-wavelength channels in azimuth.
xWR1642BOOST user's guide (TI SWRU521): two transmitters two wavelengths apart.

The channel number grows towards +y, because in the mmWave SDK demo the phase grows with the channel number for a target on
the right. On the board, the transmitters and the receivers form two groups, side by side and a few wavelengths apart. The
guides do not give the distance between the groups, so here both groups are centred at the origin of the sensor frame. For a
target at 0.5 m this shortens the two-way path by about 0.1 mm, nearly the same on all channels.
"""

from __future__ import annotations

from dataclasses import dataclass

from radartwin.constants import SPEED_OF_LIGHT

Position = tuple[float, float, float]


@dataclass(frozen=True)
class Board:
    """Hold the antenna positions in metres, in the numbering of the board (TX1 first), and the element pattern."""

    name: str
    tx_positions_m: tuple[Position, ...]
    rx_positions_m: tuple[Position, ...]
    element: str


def _board(name: str, design_frequency_hz: float, tx: tuple[tuple[float, float], ...], element: str) -> Board:
    """Build a board with four receivers half a wavelength apart, from (azimuth, elevation) offsets of transmitters in wavelengths."""
    wavelength = SPEED_OF_LIGHT / design_frequency_hz
    tx_width, rx_width = max(y for y, _ in tx), 1.5
    return Board(
        name,
        tuple((0.0, (y - tx_width / 2) * wavelength, z * wavelength) for y, z in tx),
        tuple((0.0, (0.5 * n - rx_width / 2) * wavelength, 0.0) for n in range(4)),
        element,
    )


_THREE_TX = ((0.0, 0.0), (1.0, 0.5), (2.0, 0.0))

IWR1843BOOST = _board("iwr1843boost", 77e9, _THREE_TX, "iwr1843")
IWR1642BOOST = _board("iwr1642boost", 77e9, ((0.0, 0.0), (2.0, 0.0)), "iwr1843")
IWR6843ISK = _board("iwr6843isk", 62e9, _THREE_TX, "isotropic")  # no pattern of the 60 GHz antennas is modelled
