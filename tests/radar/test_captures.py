"""Read captures as their descriptions say: the synthetic inputs of ../shared/field, and a second set that this test writes itself."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_files import LFS, log_text, studio_json

from radartwin.radar.captures import load_capture
from radartwin.radar.chirp import Radar
from radartwin.radar.process_capture import process_capture

# Range in metres and azimuth in degrees of the only target, from ../shared/field/README.md; None where the README states no azimuth.
ROWS = {
    "std/std": (2.5, 15), "std/tx12": (2.5, 25), "isk/isk_az25": (2.5, 25), "few/few": (1.2, 15), "few/ns63": (1.0, None),
    "few/loops4": (2.5, 15), "lane4/lane4": (2.5, 15), "bits12/bits12": (2.5, 15), "c2x/c2x": (2.5, 15), "c2x/pseudo": (2.5, 15),
    "hsi/hsi": (2.5, 15), "hsi/hsi4": (2.5, 15), "aop/aop_az0": (2.5, 0), "aop/aop_az25": (2.5, 25), "ods/ods_az0": (2.5, 0),
    "ods/ods_az25": (2.5, 25), "redefine/redefine": (2.5, 15), "flush/flush": (2.5, 15), "twoprof/twoprof": (2.5, 15),
    "reorder/reorder": (2.5, 15), "studio/ok/ok": (2.5, 15), "studio/swap4/swap4": (2.5, 15), "studio/inter/inter": (2.5, 15),
    "pad/pad": (2.5, 15), "pad/cutmid": (2.5, 15),
    "studio/bits12/bits12": (2.5, 15), "studio/c2x/c2x": (2.5, 15), "studio/samename/samename": (2.5, 15),
}  # fmt: skip


@pytest.fixture
def field(shared_data: Path) -> Path:
    """Return the folder with captures of the kinds that other people have, beside the real captures."""
    if not (folder := shared_data.parent / "field").is_dir():
        pytest.skip(f"{folder} is not here: the captures of other people are not part of the repository")
    return folder


def capture_of(field: Path, name: str) -> tuple[Path, Path | None]:
    """Return a capture and its radar file; None if the radar file is a .json of the same name, which needs no --radar."""
    path = field / f"{name}.bin"
    return path, next((p for suffix in (".cfg", ".mmwave.json") if (p := path.with_suffix(suffix)).is_file()), None)


def assert_single_target(peaks: pd.DataFrame, radar: Radar, range_m: float, azimuth_deg: float | None) -> None:
    """Check place and direction of the strongest peak, and that no ghost of it is stronger than -30 dB."""
    assert peaks.range_m[0] == pytest.approx(range_m, abs=0.3 * radar.range_resolution_m)
    if azimuth_deg is not None:
        assert peaks.azimuth_deg[0] == pytest.approx(azimuth_deg, abs=1.5)
    far = np.abs(peaks.range_m - range_m) > 3 * radar.range_resolution_m
    assert not (far & (peaks.power_db > peaks.power_db[0] - 30)).any()


@pytest.mark.parametrize("name", ROWS)
def test_capture_is_read_as_its_description_says(name: str, field: Path) -> None:
    range_m, azimuth_deg = ROWS[name]
    path, description = capture_of(field, name)
    peaks = process_capture(path, radar=description, cut=name.startswith("pad/"))
    assert_single_target(peaks, Radar.from_file(description or path.with_suffix(".json")), range_m, azimuth_deg)


def test_awr294x_has_its_frame_period_and_speed(field: Path) -> None:
    path, description = capture_of(field, "awr2944/awr2944")
    assert load_capture(path, description).radar.frame_rate_hz == pytest.approx(1 / 0.3)
    peaks = process_capture(path, radar=description)
    assert peaks.doppler_mps[0] == pytest.approx(0.5, abs=0.01)
    assert peaks.range_m.min() == pytest.approx(2.5, abs=0.02)  # the target recedes by 0.15 m per frame


# The second set: a writer that shares no code with the package, with other numbers than those of ../shared/field.
SAMPLES, RATE_KSPS, SLOPE, START_GHZ, RANGE_M, AZIMUTH_DEG = 80, 4000.0, 45.0, 76.5, 4.2, -20.0
LIGHT = 299_792_458.0
PROFILE = f"profileCfg {{n}} {{start}} 80 7 40 0 {{phases}} {{slope}} 1 {SAMPLES} {RATE_KSPS} 0 0 30"
AOP0, AOP1, AOP_SIGN = "-1 -1 0 0 -3 -3 -2 -2 -1 -1 0 0", "-1 0 -1 0 -3 -2 -3 -2 -3 -2 -3 -2", "1 -1 1 -1 1 -1 1 -1 1 -1 1 -1"


def cfg(*lines: str, adc: str = "2 1", buffer: str = "-1 0 1 1 1", tx: tuple[int, ...] = (0, 2), loops: int = 6, start: float = START_GHZ,
        slope: float = SLOPE, phases: int = 0, frame: str | None = None) -> str:  # fmt: skip
    chirps = [f"chirpCfg {n} {n} 0 0 0 0 0 {1 << t}" for n, t in enumerate(tx)]
    profile = PROFILE.format(n=0, start=start, slope=slope, phases=phases)
    front = f"flushCfg\nchannelCfg 15 {sum(1 << t for t in tx)} 0\nadcCfg {adc}\nadcbufCfg {buffer}"
    return "\n".join([front, profile, *chirps, frame or f"frameCfg 0 {len(tx) - 1} {loops} 0 50 1 0", *lines, "sensorStart", ""])


def studio(swap: int = 0, separate: int = 1, bits: int = 2) -> str:
    values = json.loads(studio_json(0))
    device, rf = values["mmWaveDevices"][0], values["mmWaveDevices"][0]["rfConfig"]
    rf["rlProfiles"][0]["rlProfileCfg_t"] |= {
        "startFreqConst_GHz": START_GHZ, "idleTimeConst_usec": 80, "adcStartTimeConst_usec": 7, "rampEndTime_usec": 40,
        "freqSlopeConst_MHz_usec": SLOPE, "numAdcSamples": SAMPLES, "digOutSampleRate": RATE_KSPS,
    }  # fmt: skip
    rf["rlAdcOutCfg_t"]["fmt"]["b2AdcBits"] = bits
    rf["rlFrameCfg_t"] |= {"numLoops": 6, "framePeriodicity_msec": 50}
    device["rawDataCaptureConfig"] = {"rlDevDataFmtCfg_t": {"iqSwapSel": swap, "chInterleave": separate}}
    return json.dumps(values)


def echo(tx_m: list[float], rx_m: list[float], loops: int, frames: int = 3, start: float = START_GHZ, slope: float = SLOPE) -> np.ndarray:
    """Return the samples [frame, loop, tx, rx, sample] of a target at RANGE_M and AZIMUTH_DEG, for antennas at places along y in metres."""
    time = np.arange(SAMPLES) / (RATE_KSPS * 1e3)
    frequency = start * 1e9 + slope * 1e12 * (7e-6 + time)
    target = RANGE_M * np.array([np.cos(np.radians(AZIMUTH_DEG)), np.sin(np.radians(AZIMUTH_DEG))])
    path = np.array([[np.hypot(*(target - [0, t])) + np.hypot(*(target - [0, r])) for r in rx_m] for t in tx_m])
    signal = 250 * np.exp(2j * np.pi * frequency * path[:, :, None] / LIGHT)
    noise = np.random.default_rng(11).normal(scale=3, size=(2, frames, loops, *signal.shape))
    return signal + noise[0] + 1j * noise[1]


def words(iq: np.ndarray, order: str = "QQII", bits: int = 16) -> list[np.ndarray]:
    """Return the words of each chirp. The order names four successive words, or the words of one sample of four receivers (8 letters)."""
    chirps = []
    for chirp in np.rint(iq).reshape(-1, *iq.shape[-2:]):
        flat, size = (chirp.T if len(order) == 8 else chirp).reshape(-1), len(order) // 2
        line = flat.real.tolist() if order == "real" else []
        for n in range(0, flat.size, size) if order != "real" else ():
            parts = {"I": iter(flat.real[n : n + size].tolist()), "Q": iter(flat.imag[n : n + size].tolist())}
            line += [next(parts[letter]) for letter in order]
        chirps.append(np.array([int(value) % (1 << bits) for value in line], "<u2"))
    return chirps


def with_headers(chirps: list[np.ndarray], header: int = 96, user: int = 200) -> list[np.ndarray]:
    """Put a header before each chirp, and after each twelve chirps a packet of user data with the same header."""
    head = np.frombuffer(bytes.fromhex("dc0ada0cdc0ada0c") + bytes(range(header - 8)), "<u2")
    out = []
    for n, chirp in enumerate(chirps, start=1):
        out += [head, chirp] + ([head, np.arange(user, dtype="<u2")] if n % 12 == 0 else [])
    return out


HALF = LIGHT / 77e9 / 2
ROW = [HALF * n for n in range(4)]
PAIR = [0, 4 * HALF]  # TX1 and TX3 of the IWR1843BOOST
HALF60 = LIGHT / 60.25e9 / 2
AOP_RX = [-HALF60, -HALF60, 0, 0]
SIGNS = np.array([1, -1, 1, -1])[:, None]
KINDS = {
    "Q first by SampleSwap": (cfg(), words(echo(PAIR, ROW, 6))),
    "I first by SampleSwap": (cfg(buffer="-1 0 0 1 1"), words(echo(PAIR, ROW, 6), "IIQQ")),
    "Q first by iqSwapSel": (studio(swap=1), words(echo(PAIR, ROW, 6))),
    "real samples": (cfg(adc="2 0", buffer="-1 1 1 1 1"), words(echo(PAIR, ROW, 6), "real")),
    "four lanes": (cfg(buffer="0 1 0 1"), words(echo(PAIR, ROW, 6), "IIIIQQQQ")),
    "interleaved receivers by ChanInterleave": (cfg(buffer="-1 0 1 0 1"), words(echo(PAIR, ROW, 6), "QQQQIIII")),
    "interleaved receivers by chInterleave": (studio(separate=0, swap=1), words(echo(PAIR, ROW, 6), "QQQQIIII")),
    "14 bits": (cfg(adc="1 1"), words(echo(PAIR, ROW, 6), bits=14)),
    "12 bits of mmWave Studio": (studio(bits=0), words(echo(PAIR, ROW, 6), "IIQQ", bits=12)),
    "complex 2x": (cfg(adc="2 2", loops=12), words(echo(PAIR, ROW, 12))),
    "headers and user data": (cfg("lvdsStreamCfg -1 1 1 1"), with_headers(words(echo(PAIR, ROW, 6)))),
    "frameCfg of AWR294x": (
        cfg("antGeometryCfg 0 0 0 1 0 2 0 3 0 4 0 5 0 6 0 7 0.5 0.5", frame="frameCfg 0 1 6 0 80 50 1 0"),
        words(echo([0, 4 * LIGHT / 76.5e9 / 2], [n * LIGHT / 76.5e9 / 2 for n in range(4)], 6)),
    ),
    "two of three transmitters of the AOP": (
        cfg(f"antGeometry0 {AOP0}\nantGeometry1 {AOP1}\nantPhaseRot {AOP_SIGN}", tx=(0, 1), start=60.25),
        words(SIGNS * echo([0, -2 * HALF60], AOP_RX, 6, start=60.25)),
    ),
    "platform AOP": (
        cfg("% Platform:xWR68xx_AOP", tx=(1, 2), start=60.0),
        words(SIGNS * echo([-LIGHT / 60e9, 0], [y * 60.25 / 60 for y in AOP_RX], 6, start=60.0)),
    ),
    "geometry of the ISK": (
        cfg("antGeometry0 0 -1 -2 -3 -2 -3 -4 -5 -4 -5 -6 -7\nantGeometry1 0 0 0 0 -1 -1 -1 -1 0 0 0 0", tx=(0, 1, 2), start=60.0),
        words(echo([0, LIGHT / 62e9, 2 * LIGHT / 62e9], [n * LIGHT / 62e9 / 2 for n in range(4)], 6, start=60.0)),
    ),
    "phase of a transmitter": (cfg(phases=0x40 << 16), words(echo(PAIR, ROW, 6) * np.array([1, -1j])[:, None, None])),
    "the last profile, chirps and configuration count": (
        cfg(slope=20.0, tx=(0, 1, 2)) + cfg().replace("chirpCfg 0", PROFILE.format(n=0, start=70, slope=9, phases=0) + "\n"
        + PROFILE.format(n=0, start=START_GHZ, slope=SLOPE, phases=0) + "\nchirpCfg 0 0 0 0 0 0 0 2\nchirpCfg 0", 1),
        words(echo(PAIR, ROW, 6)),
    ),
    "equal profiles": (
        cfg().replace("chirpCfg 1 1 0", PROFILE.format(n=3, start=START_GHZ, slope=SLOPE, phases=0) + "\nchirpCfg 1 1 3"),
        words(echo(PAIR, ROW, 6)),
    ),
    "reorderEnable": (cfg(), words(echo(PAIR, ROW, 6), "QIQI"), {"reorderEnable": 1}),
    "MSBToggle": (cfg(), [chirp ^ 0x8000 for chirp in words(echo(PAIR, ROW, 6))], {"MSBToggle": 1}),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_second_set_of_captures_is_read_as_described(kind: str, tmp_path: Path) -> None:
    text, chirps, *settings = KINDS[kind]
    capitals = kind == "real samples"  # suffixes as some tools and file systems write them
    capture = tmp_path / ("a.BIN" if capitals else "a.bin")
    radar = tmp_path / ("a.mmwave.json" if text.startswith("{") else "a.CFG" if capitals else "a.cfg")
    radar.write_bytes(text.encode("utf-8").replace(b"sensorStart", b"sensorStart % caf\xe9"))
    capture.write_bytes(b"".join(chirp.tobytes() for chirp in chirps))
    if settings:
        (tmp_path / "cf.json").write_text(json.dumps(card(**settings[0])))
    recording = load_capture(capture, radar)
    assert recording.num_frames == 3
    assert recording.radar.frame_rate_hz == pytest.approx(20)
    assert_single_target(process_capture(capture, radar=radar), recording.radar, RANGE_M, AZIMUTH_DEG)


HEADED = b"".join(part.tobytes() for part in with_headers(words(echo(PAIR, ROW, 6))))
PLAIN = b"".join(chirp.tobytes() for chirp in words(echo(PAIR, ROW, 6)))
UNSIGNED = (np.frombuffer(PLAIN, "<u2") ^ 0x8000).tobytes()
REORDERED = np.concatenate(words(echo(PAIR, ROW, 6), "QIQI")).tobytes()
STUDIO = ["--radar", "a.mmwave.json"]
SETUP = {"configUsed": "C:\\captures\\walk.mmwave.json", "capturedFiles": {"files": [{"processedFileName": "walk.bin"}]}}
LOW_POWER = "channelCfg 7 3 0\nchirpComnCfg 8 0 0 256 4 28 0\nchirpTimingCfg 6 63 0 75 60\nframeCfg 2 0 200 64 250 0\n"


def card(mode: str = "raw", **settings: int) -> dict[str, object]:
    """Return the settings file cf.json of the capture card."""
    return {"DCA1000Config": {"dataLoggingMode": mode, "dataFormatConfig": settings}}


def packets(data: bytes, order: Sequence[int] = range(5)) -> bytes:
    """Put the sequence number and the byte count of the capture card before each 1456 bytes."""
    return b"".join((n + 5).to_bytes(4, "little") + (n * 1456).to_bytes(6, "little") + data[n * 1456 : (n + 1) * 1456] for n in order)


def with_phases(listed: str, **values: object) -> dict[str, object]:
    """Return a mmWave Studio file that changes the phase of one chirp."""
    content = json.loads(studio())
    content["mmWaveDevices"][0]["rfConfig"][listed] = [{"structure": {"chirpStartIdx": 1, "chirpEndIdx": 1, **values}}]
    return {"a.mmwave.json": content}


OTHER_CHIRPS = b"".join(part.tobytes()[:640] for part in with_headers([np.zeros(320, "<u2")] * 9))
# For each refusal: words of the message, the files, and the options of `radartwin process a.bin --radar a.cfg`.
REFUSALS: dict[str, tuple[str, dict[str, object], list[str]]] = {
    "packet headers": ("packet headers of the DCA1000", {"a.bin": packets(PLAIN)}, []),
    "lost packet without zeros": ("lacks 1 packet of 1456 bytes", {"a.bin": PLAIN[:2912] + PLAIN[4368:]}, ["--cut"]),
    "packet capture": ("packet capture", {"a.bin": bytes.fromhex("d4c3b2a102000400") + PLAIN[:-8]}, []),
    "two receivers of four lanes": (
        "fewer than four receivers",
        {"a.cfg": cfg(buffer="0 1 0 1").replace("channelCfg 15", "channelCfg 3")},
        [],
    ),
    "file of another kind": ("a.mat: it is no .bin, .npy", {"a.mat": b"MATLAB 5.0"}, ["a.mat"]),
    "packets in another order": ("packet headers of the DCA1000", {"a.bin": packets(PLAIN, (0, 2, 1, 4))}, []),
    "no header at the first chirp": ("bytes without a header", {"a.bin": HEADED[100:]}, ["--cut"]),
    "headers of other chirps": ("736 bytes apart", {"a.bin": OTHER_CHIRPS}, []),
    "lost header beside user data": ("headers .* were lost", {"a.bin": HEADED[:17008] + bytes(96) + HEADED[17104:]}, []),
    "pointer to samples": ("a.bin: it is a Git LFS pointer", {"a.bin": LFS}, []),
    "pointer to a part": ("p_Raw_1.bin: it is a Git LFS pointer", {"p_Raw_0.bin": PLAIN, "p_Raw_1.bin": LFS}, ["p_Raw_0.bin"]),
    "cut last frame": ("after 2 frames, 14360 are left over; .* --cut", {"a.bin": PLAIN[:-1000]}, []),
    "cut first frame": ("after 0 frames, 1000 are left over; .* record again", {"a.bin": PLAIN[:1000]}, ["--cut"]),
    "unsigned counts": ("counts seem unsigned; put the cf.json .*MSBToggle", {"a.bin": UNSIGNED}, []),
    "other order of words": ("I0 Q0 I1 Q1; put the cf.json .*reorderEnable", {"a.bin": REORDERED}, []),
    "order of words against the card": ("I0 I1 Q0 Q1; correct the cf.json .*reorderEnable", {"cf.json": card(reorderEnable=1)}, []),
    "signs against the card": ("counts seem signed; correct the cf.json .*MSBToggle", {"cf.json": card(MSBToggle=1)}, []),
    "separated data types": ("'multi' separates", {"cf.json": card("multi")}, []),
    "low-power format": ("line 2: chirpComnCfg: the low-power configuration format of xWRL6432", {"a.cfg": LOW_POWER}, []),
    "parameters beside samples": ("content 4 is not supported", {"a.cfg": cfg("lvdsStreamCfg -1 1 4 0")}, []),
    "binary phases": ("bpm 1 is not supported", {"a.cfg": cfg("bpmCfg -1 1 0 1")}, []),
    "binary phases of a chirp": ("rlBpmChirps changes the phases", with_phases("rlBpmChirps", constBpmVal="0x3"), STUDIO),
    "phase shifts of a chirp": ("rlRfPhaseShiftCfgs changes", with_phases("rlRfPhaseShiftCfgs", tx0PhaseShift=32), STUDIO),
    "unknown number of bits": ("adc_bits 3 is not supported", {"a.cfg": cfg(adc="3 1")}, []),
    "board without a known chip": ("'% Platform:xWR18xx_AOP' .* --board", {"a.cfg": cfg("% Platform:xWR18xx_AOP")}, []),
    "unknown board": ("board 'IWR9' is unknown; choose IWR1843BOOST, ", {}, ["--board", "IWR9"]),
    "board without TX3": ("do not fit a IWR1642BOOST", {}, ["--board", "IWR1642BOOST"]),
    "channels that are no sums": ("must be the sums", {"a.cfg": cfg("antGeometry0 0 1 2 3 4 5 6 9\nantGeometry1" + 8 * " 0")}, []),
    "signs that are no signs": ("1 or -1", {"a.cfg": cfg(f"antGeometry0 {AOP0}\nantGeometry1 {AOP1}\nantPhaseRot" + 12 * " 2")}, []),
    "command in another encoding": ("line 1: not readable text", {"a.cfg": b"frameCfg \xe9 1\n"}, []),
    "setup file": ("give walk.mmwave.json, which it names", {"s.setup.json": SETUP}, ["--radar", "s.setup.json"]),
    "setup file in place of samples": (r"give walk.bin, and walk.mmwave.json as radar", {"s.json": SETUP, "s.bin": None}, ["s.json"]),
    "description in place of samples": ("the .bin of the capture, and this file as radar", {"d.json": json.loads(studio())}, ["d.json"]),
}


@pytest.mark.parametrize("kind", REFUSALS)
def test_capture_is_refused_in_one_line(kind: str, tmp_path: Path, inside) -> None:
    message, changes, options = REFUSALS[kind]
    for name, content in {"a.bin": PLAIN, "a.cfg": cfg(), **changes}.items():
        if content is not None:
            data = json.dumps(content) if isinstance(content, dict) else content
            (tmp_path / name).write_bytes(data.encode() if isinstance(data, str) else data)
    recording = [] if options and not options[0].startswith("--") else ["a.bin"]
    radar = [] if "--radar" in options or ".json" in "".join(options) else ["--radar", "a.cfg"]
    done = inside("process", *recording, *options, *radar)
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1
    assert re.search(message, done.stderr), done.stderr


def test_more_frames_than_described_are_reported(tmp_path: Path) -> None:
    """The description begins with a byte order mark, as some editors write it."""
    (radar := tmp_path / "a.mmwave.json").write_text(studio().replace('"numFrames": 0', '"numFrames": 2'), encoding="utf-8-sig")
    (tmp_path / "a.bin").write_bytes(PLAIN)
    notes: list[str] = []
    assert load_capture(tmp_path / "a.bin", radar, say=notes.append).num_frames == 3
    assert "the capture holds 3 frames instead of the 2 of its description; check --radar" in notes


def test_process_and_import_take_the_same_options(tmp_path: Path, inside) -> None:
    """A capture in two parts with headers, a cut last frame, lost packets and a log, read as an AOP whose signs its file does not state."""
    iq = SIGNS * echo([-LIGHT / 60e9, 0], [y * 60.25 / 60 for y in AOP_RX], 6, start=60.0)
    data = bytearray(b"".join(part.tobytes() for part in with_headers(words(iq, "IIQQ")))[:-900])
    size = len(data) // 3
    data[size + 1000 : size + 2500] = bytes(1500)  # a packet and more in the second frame
    for n, part in enumerate((data[: size + 41], data[size + 41 :])):
        (tmp_path / f"w_Raw_{n}.bin").write_bytes(part)
    (tmp_path / "w.cfg").write_text(cfg(tx=(1, 2), start=60.0))
    (tmp_path / "w_Raw_LogFile.csv").write_text(log_text(40, lost=1))
    shared = ("--radar", "w.cfg", "--board", "iwr6843aop", "--no-iq-swapped", "--cut")
    done = inside("process", "w_Raw_1.bin", *shared, "--out", "seen")
    assert done.returncode == 0, done.stderr
    lines = ["board: IWR6843AOP, chosen", "1 of 2 frames hold lost packets", "1 of 41 packets were lost", "the last frame is incomplete"]
    assert not [line for line in lines if line not in done.stderr], done.stderr
    peaks = pd.read_csv(tmp_path / "seen/peaks.csv")
    assert (peaks.range_m[0], peaks.azimuth_deg[0]) == (pytest.approx(RANGE_M, abs=0.05), pytest.approx(AZIMUTH_DEG, abs=1.5))
    about = ("object=can", "distance_m=4.2", "room=lab", "motion=static", "licence=MIT", "sensor=AOP", "who=A", "when=2026")
    done = inside("import", "w_Raw_0.bin", "--out", "set", *shared, *about)
    assert done.returncode == 0, done.stderr
    assert not [line for line in lines if line not in done.stderr], done.stderr
    assert inside("process", "set/recordings/w", "--out", "again").returncode == 0
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "again/peaks.csv"), peaks)


def test_lost_packets_do_not_decide_the_order_of_i_and_q(tmp_path: Path) -> None:
    """Seven of eight frames are lost, and the noise of the last frame shows that Q comes first although the description says I."""
    (radar := tmp_path / "a.cfg").write_text(cfg(buffer="-1 0 0 1 1", loops=32))
    spectrum = np.random.default_rng(1).normal(size=(2, 32, 2, 4, SAMPLES))
    spectrum[..., round(0.9 * SAMPLES) :] *= 0.2
    noise = np.fft.ifft(spectrum[0] + 1j * spectrum[1], axis=-1)[None] * 2000
    frame = b"".join(chirp.tobytes() for chirp in words(noise))
    (tmp_path / "a.bin").write_bytes(7 * (frame[:4096] + bytes(len(frame) - 4096)) + frame)
    notes: list[str] = []
    recording = load_capture(tmp_path / "a.bin", radar, say=notes.append)
    assert recording.iq_swapped
    assert "its description says I first, but its noise shows the other order, which is used (--iq-swapped)" in notes
    assert "7 of 8 frames hold lost packets, which are zeros: frame 0, 1, 2, 3, 4, ..." in notes


@pytest.mark.slow
def test_capture_of_4_gb_needs_at_most_1_5_gb_of_memory(tmp_path: Path) -> None:
    """The file is sparse: only each 512th frame holds samples. It is read in another process, whose peak memory is measured."""
    (radar := tmp_path / "a.cfg").write_text(cfg(loops=400).replace("50 1 0", "500 1 0"))
    frame = np.concatenate(words(echo(PAIR, ROW, 400, frames=1))).tobytes()
    with (tmp_path / "a.bin").open("wb") as stream:
        stream.truncate((4 << 30) // len(frame) * len(frame))
        for n in range(0, (4 << 30) // len(frame), 512):
            stream.seek(n * len(frame))
            stream.write(frame)
    script = (
        "import resource, sys; from radartwin.radar.captures import load_capture; from radartwin.radar.power_maps import spectra\n"
        "recording = load_capture(sys.argv[1], sys.argv[2])\n"
        "for count, _ in enumerate(spectra(recording.iq, recording.radar, False)):\n    if count > 40: break\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20)"
    )
    done = subprocess.run([sys.executable, "-c", script, tmp_path / "a.bin", radar], capture_output=True, text=True, check=True)
    assert float(done.stdout) < 1.5
