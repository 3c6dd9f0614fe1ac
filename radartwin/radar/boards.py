"""Define the antenna positions and the element pattern of the evaluation boards.

The positions on the AWR1843BOOST and IWR1843BOOST are those of their user's guide (TI SPRUIM4B), and those on the IWR6843ISK are from the
mmWave EVM user's guide (TI SWRU546). On these boards, the receivers are half a wavelength apart, the transmitters are one wavelength apart
in azimuth, and TX2 is raised by half a wavelength. TX1 and TX3 with four receivers therefore form eight channels in azimuth at a spacing of
half a wavelength. On the xWR1642BOOST (user's guide TI SWRU521), the two transmitters are two wavelengths apart.

The board MMWCAS-RF-EVM carries four chips AWR2243 (design guide TI TIDUEN5A, figures 5 to 7). Its antenna positions are those of TI's
processing example for this board, in half wavelengths at 76.8 GHz. TX4 to TX12 are two wavelengths apart in azimuth. TX3, TX2 and TX1 of
the main chip are 1, 4 and 6 half wavelengths above TX4 to TX12. The differences between the four heights include every number of half
wavelengths from 0 to 6, so that the heights form a minimum-redundancy array. The 16 receivers form groups of 4, 8 and 4 antennas at a
spacing of half a wavelength. The azimuth row of 9 transmitters and 16 receivers has 144 channels at 86 different positions, without a gap.

In this module, the channel number of the boards with one chip grows towards +y (left), because in the mmWave SDK demo the phase grows with
the channel number for a target on the right. On the MMWCAS-RF-EVM, the positions of TI's example grow towards +y (left) and +z (up). This
direction is an assumption of this project. If the assumption is wrong for a real capture, the azimuths of the capture have the opposite
sign. On the boards with one chip, the transmitters and the receivers form two groups, side by side and a few wavelengths apart. The user's
guides do not give the distance between the two groups. This module therefore centres both groups at the origin of the sensor frame. On the
MMWCAS-RF-EVM, both groups are centred in azimuth, and the receivers and TX4 to TX12 are at height zero. For a target at 0.5 m, this
simplification shortens the two-way path by about 0.1 mm, and by nearly the same length on all channels.
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

_CASCADE_HALF_WAVELENGTH = SPEED_OF_LIGHT / 76.8e9 / 2
_CASCADE_TX = ((11, 6), (10, 4), (9, 1), *((place, 0) for place in range(32, -1, -4)))  # (azimuth, elevation) of TX1 to TX12
_CASCADE_RX = (*range(11, 15), *range(50, 54), *range(46, 50), *range(4))  # azimuth of RX1 to RX16

MMWCAS_RF_EVM = Board(
    "mmwcas-rf-evm",
    tuple((0.0, (y - 16.0) * _CASCADE_HALF_WAVELENGTH, z * _CASCADE_HALF_WAVELENGTH) for y, z in _CASCADE_TX),
    tuple((0.0, (y - 26.5) * _CASCADE_HALF_WAVELENGTH, 0.0) for y in _CASCADE_RX),
    "isotropic",  # the package has no pattern of these antennas
)
