"""Make data that several tests use: a capture log, a .glb, a mmWave Studio description, a data card, noise, and a trained classifier."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from radartwin.errors import UserError
from radartwin.radar.chirp import Radar
from radartwin.radar.dca1000 import PACKET_BYTES
from radartwin.radar.recording import Recording
from radartwin.recognize.encoder import Encoder
from radartwin.recognize.model import Recogniser
from radartwin.recordings.card import Card

LFS = b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 5\n"
CFG = """% made with the mmWave SDK visualizer
sensorStop
flushCfg
dfeDataOutputMode 1
channelCfg 15 5 0
adcCfg 2 1
adcbufCfg -1 0 1 1 1
profileCfg 0 77 7 5 60 0 0 70 1 256 5210 0 0 30   % comment
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 1 0 0 0 0 0 4
frameCfg 0 1 16 0 100 1 0
lowPower 0 0
sensorStart
"""
CARD = Card("bench", "CC-BY-4.0", "amplitude", "IWR1843BOOST", "A. Researcher", "2026-03-01")


def refused(
    words: Iterable[str],
    call: Callable[..., object],
    *arguments: object,
    error: type[Exception] | tuple[type[Exception], ...] = UserError,
    **options: object,
) -> None:
    """Check that a call raises an error whose message is one short line with the given words."""
    with pytest.raises(error) as caught:
        call(*arguments, **options)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 400
    assert not [word for word in words if word not in message], message


def noise(radar: Radar, seed: int = 0, frames: int = 4) -> Recording:
    """Return noise far below the receiver's full scale, in amplitude units."""
    rng = np.random.default_rng(seed)
    shape = (frames, radar.num_chirps, radar.num_tx, radar.num_rx, radar.num_samples)
    iq = 1e-5 * (rng.normal(size=shape) + 1j * rng.normal(size=shape))
    return Recording(iq.astype(np.complex64), radar, scale=2e-9)


def log_text(received: int, lost: int = 0, lanes: int = 2, mode: str = "Raw") -> str:
    """Return the text of the file LogFile.csv, which the capture tool writes."""
    return (
        f"Start record configuration : \n,\nLog mode : {mode}\nLVDS lane mode : {lanes} lane\nRecord stop mode : Infinite\n"
        f"Max file size (MB) : 1024,\n,*DT 1,\n\nRaw Data :\nOut of sequence count - {lost}\nOut of sequence seen from 3 to 9\n"
        f"First Packet ID - 1\nLast Packet ID - {received + lost}\nNumber of received packets - {received}\n"
        f"Number of zero filled packets - {lost}\nNumber of zero filled bytes - {lost * PACKET_BYTES}\n"
        "Capture start time - Mon Mar  2 09:05:07 2026\nCapture end time - Mon Mar  2 09:05:09 2026\nDuration(sec) - 2"
    )


def studio_json(frames: int = 4) -> str:
    """Return a minimal .mmwave.json file for 77 GHz, transmitters TX1 and TX3, 128 samples and 16 chirp loops."""
    profile = {
        "profileId": 0, "startFreqConst_GHz": 77.0, "idleTimeConst_usec": 7.0, "adcStartTimeConst_usec": 0.0, "rampEndTime_usec": 57.0,
        "txOutPowerBackoffCode": "0x0", "freqSlopeConst_MHz_usec": 70.0, "numAdcSamples": 128, "digOutSampleRate": 5210,
    }  # fmt: skip
    varied = {"startFreqVar_MHz": 0, "freqSlopeVar_KHz_usec": 0, "idleTimeVar_usec": 0, "adcStartTimeVar_usec": 0, "profileId": 0}
    chirps = [{"rlChirpCfg_t": {"chirpStartIdx": i, "chirpEndIdx": i, "txEnable": hex(4**i), **varied}} for i in (0, 1)]
    rf = {
        "rlProfiles": [{"rlProfileCfg_t": profile}], "rlChirps": chirps,
        "rlFrameCfg_t": {"chirpStartIdx": 0, "chirpEndIdx": 1, "numLoops": 16, "numFrames": frames, "framePeriodicity_msec": 100.0},
        "rlChanCfg_t": {"rxChannelEn": "0xF", "txChannelEn": "0x5"}, "rlAdcOutCfg_t": {"fmt": {"b2AdcOutFmt": 1}},
    }  # fmt: skip
    return json.dumps({"mmWaveDevices": [{"rfConfig": rf}]})


def edit_json(path: Path, **changes: object) -> None:
    """Change keys of the object in a JSON file. A key whose new value is `...` is removed."""
    values = json.loads(path.read_text()) | changes
    path.write_text(json.dumps({key: value for key, value in values.items() if value is not ...}))


def recogniser(classes: int = 3, features: int = 4, text: int = 5) -> Recogniser:
    rng = np.random.default_rng(0)
    shapes = {"hidden_weight": (6, features), "hidden_bias": (6,), "output_weight": (text, 6), "output_bias": (text,)}
    encoder = Encoder({name: rng.normal(size=shape).astype(np.float32) for name, shape in shapes.items()})
    prototypes = rng.normal(size=(classes, text)).astype(np.float32)
    spread = np.array([1.0, 2.0, 0.0, 0.5])
    return Recogniser(
        encoder, ("can", "mug", "bottle"), prototypes, 0.07, ("a", "b", "c", "d"), {"set": "rotation", "without": ["brightness"]},
        rng.normal(size=features), spread, {"seed": 3},
    )  # fmt: skip


def glb(document: dict[str, Any], binary: bytes = b"") -> bytes:
    """Return the bytes of a binary glTF file with this JSON document."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text
    if binary:
        body += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body
