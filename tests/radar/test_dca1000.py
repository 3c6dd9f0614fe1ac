"""Compare the word orders of the capture hardware with words that are written by hand."""

import struct

import numpy as np
import pytest
from made_files import refused

from radartwin.errors import RecordingError
from radartwin.radar.word_order import Layout

# One chirp of each of two transmitters, with two receivers and two samples; the sample is 100 tx + 10 rx + n, and its Q is that + 1000 j.
IQ = np.array([[[[complex(i := 100 * tx + 10 * rx + n, -i - 1000) for n in range(2)] for rx in range(2)] for tx in range(2)]])
PAIRS = [0, 1, -1000, -1001, 10, 11, -1010, -1011, 100, 101, -1100, -1101, 110, 111, -1110, -1111]
LAYOUTS = {
    "pairs": (Layout(), PAIRS),
    "Q first": (Layout(q_first=True), [-1000, -1001, 0, 1, -1010, -1011, 10, 11, -1100, -1101, 100, 101, -1110, -1111, 110, 111]),
    "alternating": (Layout(alternating=True), [0, -1000, 1, -1001, 10, -1010, 11, -1011, 100, -1100, 101, -1101, 110, -1110, 111, -1111]),
    "interleaved": (Layout(interleaved=True), [0, 10, -1000, -1010, 1, 11, -1001, -1011, 100, 110, -1100, -1110, 101, 111, -1101, -1111]),
    "both": (
        Layout(interleaved=True, alternating=True),
        [0, -1000, 10, -1010, 1, -1001, 11, -1011, 100, -1100, 110, -1110, 101, -1101, 111, -1111],
    ),
    "real": (Layout(real=True), [0, 1, 10, 11, 100, 101, 110, 111]),
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_words_follow_each_layout(name):
    layout, words = LAYOUTS[name]
    written, clipped = layout.words(IQ, 1.0)
    assert (written.tobytes(), clipped) == (struct.pack(f"<{len(words)}h", *words), 0)
    samples = layout.samples(np.array(words, "<i2"), IQ.shape)
    np.testing.assert_array_equal(samples, np.real(IQ) if layout.real else IQ)


@pytest.mark.parametrize(("layout", "code"), [(Layout(bits=12), 0xFFF), (Layout(bits=14), 0x3FFF), (Layout(unsigned=True), 0x7FFF)])
def test_short_and_unsigned_words_have_their_sign(layout, code):
    words = np.array([1 if not layout.unsigned else 0x8001, code, code, code], np.uint16).view(np.int16)
    np.testing.assert_array_equal(layout.samples(words, (1, 1, 1, 2)), [[[[1 - 1j, -1 - 1j]]]])


def test_counts_beyond_16_bits_are_clipped_and_counted_and_invalid_samples_refused():
    iq = np.array([40_000 + 0j, -40_000 - 32_768j, 32_767 + 5j, 0 + 32_768j]).reshape(1, 1, 1, 1, 4)
    words, clipped = Layout().words(iq, 1.0)
    assert clipped == 3
    assert tuple(words.reshape(-1).tolist()) == (32767, -32768, 0, -32768, 32767, 0, 5, 32767)
    for wrong, word in ((np.full((1, 2), np.nan + 0j), "NaN"), (np.zeros((1, 3), complex), "even")):
        refused([word], Layout().words, wrong, 1.0, error=RecordingError)


def test_every_int16_round_trips():
    counts = np.arange(-32768, 32768, dtype="<i2")
    iq = Layout().samples(counts, (1, 256, 2, 2, 32))
    for scale in (1.0, 3.1e-9):
        assert Layout().words(iq * np.float32(scale), scale)[0].tobytes() == counts.tobytes()
