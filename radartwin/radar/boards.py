"""Define the antenna positions and the element pattern of the evaluation boards.

The positions on the AWR1843BOOST and IWR1843BOOST are those of their user's guide (TI SPRUIM4B), and those on the IWR6843ISK are from the
mmWave EVM user's guide (TI SWRU546). On these boards, the receivers are half a wavelength apart, the transmitters are one wavelength apart
in azimuth, and TX2 is raised by half a wavelength. TX1 and TX3 with four receivers therefore form eight channels in azimuth at a spacing of
half a wavelength. On the xWR1642BOOST (user's guide TI SWRU521), the two transmitters are two wavelengths apart. The channels of the
IWR6843AOP and of the IWR6843ISK-ODS are those of the lines antGeometry0, antGeometry1 and antPhaseRot in TI's configurations for these
boards (3D people tracking, TI Radar Toolbox), and those of the AWR2944EVM are those of its line antGeometryCfg (MMWAVE-MCUPLUS SDK).

The board MMWCAS-RF-EVM carries four chips AWR2243 (design guide TI TIDUEN5A, figures 5 to 7). Its antenna positions are those of TI's
processing example for this board, in half wavelengths at 76.8 GHz. TX4 to TX12 are two wavelengths apart in azimuth. TX3, TX2 and TX1 of
the main chip are 1, 4 and 6 half wavelengths above TX4 to TX12. The differences between the four heights include every number of half
wavelengths from 0 to 6, so that the heights form a minimum-redundancy array. The 16 receivers form groups of 4, 8 and 4 antennas at a
spacing of half a wavelength. The azimuth row of 9 transmitters and 16 receivers has 144 channels at 86 different positions, without a gap.

In this module, the channel number of the boards with one chip grows towards +y (left), because in the mmWave SDK demo the phase grows with
the channel number for a target on the right. On the MMWCAS-RF-EVM, the positions of TI's example grow towards +y (left) and +z (up). This
direction is an assumption of this project. If the assumption is wrong for a real capture, the azimuths of the capture have the opposite
sign. The lines antGeometry0 and antGeometry1 of the IWR6843AOP and the IWR6843ISK-ODS are taken to grow towards +y and +z, which is not
checked with a real capture either. The columns of antGeometryCfg grow towards +y, and its rows downwards. On the boards with one chip, the
transmitters and the receivers form two groups, side by side and a few wavelengths apart. The user's guides do not give the distance between
the two groups. This module therefore centres both groups in azimuth, and puts the lowest antenna of each group at height zero. For a target
at 0.5 m, this simplification shortens the two-way path by about 0.1 mm, and by nearly the same length on all channels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import RecordingError

Position = tuple[float, float, float]


@dataclass(frozen=True)
class Board:
    """Hold the antennas of a board: positions in metres in the board's numbering (TX1 and RX1 first), and the antenna pattern's name.

    The attribute `signs` (tx, rx) is -1 for each channel whose feed lines turn the phase by 180 degrees; None stands for no turn.
    """

    name: str
    tx_positions_m: tuple[Position, ...]
    rx_positions_m: tuple[Position, ...]
    element: str = "isotropic"  # the package has patterns of few antennas
    signs: tuple[tuple[int, ...], ...] | None = None

    def part(self, transmitters: Sequence[int], receivers: Sequence[int]) -> Board:
        """Return the board with only some of its antennas, given by their numbers from 0, in the given order."""
        return replace(
            self,
            tx_positions_m=tuple(self.tx_positions_m[n] for n in transmitters),
            rx_positions_m=tuple(self.rx_positions_m[n] for n in receivers),
            signs=self.signs and tuple(tuple(self.signs[t][r] for r in receivers) for t in transmitters),
        )


def board_of_channels(
    name: str, half_wavelength_m: float, azimuth: ArrayLike, elevation: ArrayLike, signs: Sequence[float] = (), receivers: int = 4
) -> Board:
    """Build a board from the places of its virtual channels, ordered by transmitter first.

    Args:
        name: name of the board.
        half_wavelength_m: half of the wavelength in metres.
        azimuth, elevation: place of each channel to the left (+y) and upwards (+z), in half wavelengths.
        signs: 1 or -1 for each channel; an empty list stands for 1.
        receivers: number of receivers.
    Raises:
        RecordingError: the lists differ in length, or no positions of transmitters and receivers have these channels as their sums.
    """
    try:
        channels = np.stack([np.array(azimuth, float), np.array(elevation, float)], axis=-1).reshape(-1, receivers, 2)
        turned = np.array(signs or np.ones(len(channels) * receivers)).reshape(-1, receivers)
        (tx, rx) = channels[:, 0] - channels[0, 0], channels[0]
        if len(turned) != len(channels) or not np.allclose(tx[:, None] + rx, channels) or not np.all(np.abs(turned) == 1):
            raise ValueError
    except (ValueError, IndexError):
        reason = "its channels need one place and one sign (1 or -1) each, and must be the sums of transmitter and receiver positions"
        raise RecordingError(f"{name}: {reason}; give a .yaml with the antenna positions") from None
    # Both groups are centred in azimuth, and their lowest antennas are at height zero.
    tx, rx = (places - [(places[:, 0].max() + places[:, 0].min()) / 2, places[:, 1].min()] for places in (tx, rx))
    tx_positions_m, rx_positions_m = (tuple((0.0, y * half_wavelength_m, z * half_wavelength_m) for y, z in p.tolist()) for p in (tx, rx))
    rows = tuple(tuple(int(sign) for sign in row) for row in turned)
    return Board(name, tx_positions_m, rx_positions_m, signs=rows if np.any(turned < 0) else None)


def _row_board(name: str, design_frequency_hz: float, tx: Sequence[tuple[int, int]], rx: Sequence[int] = range(4)) -> Board:
    """Build a board from the (azimuth, elevation) of its transmitters and the azimuth of its receivers in half wavelengths."""
    azimuth, elevation = zip(*((y + n, z) for y, z in tx for n in rx), strict=True)
    return board_of_channels(name, SPEED_OF_LIGHT / design_frequency_hz / 2, azimuth, elevation, receivers=len(rx))


_THREE_TX = ((0, 0), (2, 1), (4, 0))

IWR1843BOOST = replace(_row_board("IWR1843BOOST", 77e9, _THREE_TX), element="iwr1843")
IWR1642BOOST = replace(_row_board("IWR1642BOOST", 77e9, ((0, 0), (4, 0))), element="iwr1843")
IWR6843ISK = _row_board("IWR6843ISK", 62e9, _THREE_TX)

# Azimuth, elevation and sign of each virtual channel in half wavelengths, as in antGeometry0, antGeometry1 and antPhaseRot of TI's
# configurations for the boards; for the AWR2944EVM, columns and negative rows of antGeometryCfg.
GEOMETRY = {
    "IWR6843AOP": (
        (-1, -1, 0, 0, -3, -3, -2, -2, -1, -1, 0, 0),
        (-1, 0, -1, 0, -3, -2, -3, -2, -3, -2, -3, -2),
        (1, -1, 1, -1, 1, -1, 1, -1, 1, -1, 1, -1),
    ),
    "IWR6843ISK-ODS": (
        (0, 0, -1, -1, -2, -2, -3, -3, -2, -2, -3, -3),
        (0, -1, -1, 0, 0, -1, -1, 0, -2, -3, -3, -2),
        (1, -1, -1, 1, 1, -1, -1, 1, 1, -1, -1, 1),
    ),
    "AWR2944EVM": ((0, 2, 7, 9, 3, 5, 10, 12, 6, 8, 13, 15, 9, 11, 16, 18), (-1,) * 12 + (0,) * 4, (1,) * 16),
    "IWR6843ISK": ((0, -1, -2, -3, -2, -3, -4, -5, -4, -5, -6, -7), (0, 0, 0, 0, -1, -1, -1, -1, 0, 0, 0, 0), (1,) * 12),
}
IWR6843AOP, IWR6843ISK_ODS, AWR2944EVM = (
    board_of_channels(name, SPEED_OF_LIGHT / frequency_hz / 2, *GEOMETRY[name])
    for name, frequency_hz in (("IWR6843AOP", 60e9), ("IWR6843ISK-ODS", 60e9), ("AWR2944EVM", 77e9))
)

_CASCADE_TX = ((11, 6), (10, 4), (9, 1), *((place, 0) for place in range(32, -1, -4)))  # (azimuth, elevation) of TX1 to TX12
_CASCADE_RX = (*range(11, 15), *range(50, 54), *range(46, 50), *range(4))  # azimuth of RX1 to RX16

MMWCAS_RF_EVM = _row_board("MMWCAS-RF-EVM", 76.8e9, _CASCADE_TX, _CASCADE_RX)

BOARDS = {board.name: board for board in (IWR1843BOOST, IWR1642BOOST, IWR6843ISK, IWR6843AOP, IWR6843ISK_ODS, AWR2944EVM, MMWCAS_RF_EVM)}
