"""Define the antenna positions and the element pattern of the evaluation boards.

The positions on the AWR1843BOOST and IWR1843BOOST are those of their user's guide (TI SPRUIM4B), and those on the IWR6843ISK are from the
mmWave EVM user's guide (TI SWRU546). On these boards, the receivers are half a wavelength apart, the transmitters are one wavelength apart
in azimuth, and TX2 is raised by half a wavelength. TX1 and TX3 with four receivers therefore form eight channels in azimuth at a spacing of
half a wavelength. On the xWR1642BOOST (user's guide TI SWRU521), the two transmitters are two wavelengths apart.

In this module, the channel number grows towards +y (left), because in the mmWave SDK demo the phase grows with the channel number for a
target on the right. On the board, the transmitters and the receivers form two groups, side by side and a few wavelengths apart. The user's
guides do not give the distance between the two groups. This module therefore centres both groups at the origin of the sensor frame. For a
target at 0.5 m, this simplification shortens the two-way path by about 0.1 mm, and by nearly the same length on all channels.
"""

from __future__ import annotations

from dataclasses import dataclass

from radartwin.constants import SPEED_OF_LIGHT

Position = tuple[float, float, float]


@dataclass(frozen=True)
class Board:
    """Hold the antenna positions of a board in metres, in the board's numbering (TX1 and RX1 first), and the antenna pattern's name."""

    name: str
    tx_positions_m: tuple[Position, ...]
    rx_positions_m: tuple[Position, ...]
    element: str


def _board(name: str, design_frequency_hz: float, tx: tuple[tuple[float, float], ...], element: str) -> Board:
    """Build a board with four receivers half a wavelength apart.

    The argument `tx` gives the (azimuth, elevation) offset of each transmitter in wavelengths at `design_frequency_hz`.
    """
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
IWR6843ISK = _board("iwr6843isk", 62e9, _THREE_TX, "isotropic")  # the package has no pattern of the 60 GHz antennas
