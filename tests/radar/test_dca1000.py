"""Compare the raw data layout of the DCA1000 capture card with bytes that are written by hand."""

import dataclasses
import struct

import numpy as np
import pytest
from numpy.typing import NDArray

from radartwin.errors import RecordingError
from radartwin.radar import dca1000
from radartwin.radar.chirp import Radar
from radartwin.radar.layouts import Layout

# Two samples of two receivers, one chirp of each of two transmitters: the smallest radar with every axis.
SMALL = dataclasses.replace(Radar.iwr1843(), num_samples=2, num_chirps=1, rx_positions_m=((0.0, 0.0, 0.0), (0.0, 0.002, 0.0)))


def decode(data: bytes, radar: Radar, swapped: bool = False) -> NDArray[np.complex64]:
    layout = Layout(real=radar.real_sampling, q_first=swapped)
    return layout.samples(np.frombuffer(data, "<i2"), (-1, *dca1000.frame_shape(radar)))


def _sample(tx: int, rx: int, n: int) -> complex:
    i = 100 * tx + 10 * rx + n
    return complex(i, -i - 1000)


IQ: NDArray[np.complex128] = np.array([[[[[_sample(t, r, n) for n in range(2)] for r in range(2)] for t in range(2)]]])
# Little-endian int16 I0 I1 Q0 Q1: tx 0 rx 0, tx 0 rx 1, tx 1 rx 0, tx 1 rx 1.
I_FIRST = [0, 1, -1000, -1001, 10, 11, -1010, -1011, 100, 101, -1100, -1101, 110, 111, -1110, -1111]
Q_FIRST = [-1000, -1001, 0, 1, -1010, -1011, 10, 11, -1100, -1101, 100, 101, -1110, -1111, 110, 111]


@pytest.mark.parametrize(("swapped", "values"), [(False, I_FIRST), (True, Q_FIRST)])
def test_bytes_follow_the_two_lane_layout_in_both_orders(swapped, values):
    expected = struct.pack("<16h", *values)
    assert dca1000.encode(IQ, 1.0, iq_swapped=swapped) == (expected, 0)
    np.testing.assert_array_equal(decode(expected, SMALL, swapped), IQ)


def test_counts_are_little_endian():
    data, _ = dca1000.encode(np.array([-2 + 258j, 0]).reshape(1, 1, 1, 1, 2), 1.0)
    assert data == bytes([0xFE, 0xFF, 0, 0, 0x02, 0x01, 0, 0])


def test_real_sampling_has_one_value_per_sample():
    radar = dataclasses.replace(SMALL, real_sampling=True)
    data, clipped = dca1000.encode(IQ, 1.0, real_sampling=True)
    assert clipped == 0
    assert data == struct.pack("<8h", 0, 1, 10, 11, 100, 101, 110, 111)
    np.testing.assert_array_equal(decode(data, radar), IQ.real)


def test_counts_beyond_16_bits_are_clipped_and_counted():
    iq = np.array([40_000 + 0j, -40_000 - 32_768j, 32_767 + 5j, 0 + 32_768j]).reshape(1, 1, 1, 1, 4)
    data, clipped = dca1000.encode(iq, 1.0)
    assert clipped == 3
    assert struct.unpack("<8h", data) == (32767, -32768, 0, -32768, 32767, 0, 5, 32767)


def test_every_int16_round_trips():
    counts = np.arange(-32768, 32768, dtype="<i2")
    radar = dataclasses.replace(SMALL, num_samples=32, num_chirps=256)
    iq = decode(counts.tobytes(), radar)
    assert dca1000.encode(iq, 1.0)[0] == counts.tobytes()
    scale = 3.1e-9
    assert dca1000.encode(iq * np.float32(scale), scale)[0] == counts.tobytes()


def test_invalid_samples_are_refused():
    with pytest.raises(RecordingError, match="NaN"):
        dca1000.encode(np.full((1, 1, 1, 1, 2), np.nan + 0j), 1.0)
    with pytest.raises(RecordingError, match="even"):
        dca1000.encode(np.zeros((1, 1, 1, 1, 3), complex), 1.0)
