"""Define the radars that have a name: the board with its antennas, and a waveform that the board can send.

| name | board | band | transmitters x receivers |
|---|---|---|---|
| iwr1843 | IWR1843BOOST | 77 GHz | 2 x 4, in azimuth |
| iwr6843 | IWR6843ISK | 60 GHz | 3 x 4 |
| awr2243_cascade | MMWCAS-RF-EVM | 77 GHz | 12 x 16 |

The waveform of awr2243_cascade comes from TI's MIMO script for this board. The waveform of iwr6843 is a choice of this project within the
limits of the data sheet, because the board has no waveform of its own. Every field can be changed by an option of the configuration group
`radar`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from radartwin.radar.boards import IWR6843ISK, MMWCAS_RF_EVM
from radartwin.radar.chirp import Radar


def iwr6843() -> Radar:
    """Return the 60 GHz radar IWR6843ISK with its three transmitters.

    The waveform is the profile of `Radar.iwr1843` in the band from 60 to 64 GHz: the ramp of 57.14 us starts at 60 GHz, and the first
    sample is 7 us later, at 60.49 GHz. The idle time between ramps is 7 us. Noise figure and transmit power are those of
    radartwin.radar.ti_files (IWR6843 data sheet, TI SWRS219).

    >>> round(1e3 * iwr6843().wavelength_m, 2)
    4.96
    """
    return replace(
        Radar.iwr1843(IWR6843ISK.element),
        name="iwr6843",
        start_frequency_hz=60.49e9,
        tx_positions_m=IWR6843ISK.tx_positions_m,
        rx_positions_m=IWR6843ISK.rx_positions_m,
        chirp_interval=64.14e-6,
    )


def awr2243_cascade() -> Radar:
    """Return the cascade of four AWR2243 on the board MMWCAS-RF-EVM, whose twelve transmitters send one after the other (TDM).

    The waveform and the firing order are those of TI's script Cascade_Configuration_MIMO.lua (mmWave Studio). In this script, chirp 0 is
    TX2 of device 4, and chirp 11 is TX0 of device 1. In the numbering of the board (MMWCAS_RF_EVM), the transmitters therefore fire from
    TX12 down to TX1, and `tx_positions_m` lists them in this order.

    Each transmitter sends 64 chirps per frame (TI E2E 997761 confirms this number, 256 samples and 12 transmitters). The ramp starts at
    77 GHz with 79 MHz/us; the first of 256 samples at 8 Msps is 6 us later. Ramp (40 us) and idle time (5 us) make a chirp interval of
    45 us. Transmit power and noise figure are from the list of features of the AWR2243 data sheet (TI SWRS223A).

    >>> awr2243_cascade().num_tx * awr2243_cascade().num_rx
    192
    """
    return Radar(
        name="awr2243_cascade",
        start_frequency_hz=77.474e9,
        slope_hz_per_s=79e12,
        sample_rate_hz=8e6,
        num_samples=256,
        num_chirps=64,
        tx_positions_m=MMWCAS_RF_EVM.tx_positions_m[::-1],
        rx_positions_m=MMWCAS_RF_EVM.rx_positions_m,
        chirp_interval=45e-6,
        frame_rate_hz=10.0,
        element=MMWCAS_RF_EVM.element,
        noise_figure_db=12.0,
        transmit_power_dbm=13.0,
    )


NAMED: dict[str, Callable[[], Radar]] = {"iwr1843": Radar.iwr1843, "iwr6843": iwr6843, "awr2243_cascade": awr2243_cascade}
