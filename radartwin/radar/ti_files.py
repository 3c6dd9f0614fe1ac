"""Convert TI's radar descriptions, mmWave SDK .cfg and mmWave Studio .mmwave.json, to the fields of `radartwin.radar.chirp.Radar`, to the
layout of the samples in the capture, and to the board.

The table FIELDS lists every number of both formats that changes waveform, timing, antennas or samples. Both formats describe a profile (the
waveform of a chirp), the chirps with their transmitters, and the frame. The sampled part of the frequency sweep starts at the first ADC
sample, so that start_frequency_hz = startFreq + slope * adcStart. The time between chirps is chirp_interval = idle + rampEnd.
"""

from __future__ import annotations

import cmath
import math
import re
import reprlib
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import RecordingError
from radartwin.radar.boards import AWR2944EVM, BOARDS, GEOMETRY, IWR1642BOOST, IWR1843BOOST, IWR6843ISK, Board, board_of_channels
from radartwin.radar.word_order import Layout

# Transmit power of one transmitter without back-off in dBm, from the data sheets of IWR1843 (TI SWRS228) and IWR6843 (TI SWRS219).
_MAX_POWER_DBM = 12.0
_NOISE_FIGURE_DB = 15.0  # receiver noise figure in dB; the data sheets of IWR1843 and IWR6843 give 12 to 15 dB


class Field(NamedTuple):
    """Describe one number of TI's files, a row of the table below."""

    name: str
    cfg: str
    studio: str
    default: str
    allowed: str
    meaning: str
    source: str

    @property
    def command(self) -> str:
        return self.cfg.partition(" ")[0]

    @property
    def position(self) -> int:
        return int(self.cfg.partition(" ")[2])


# The columns are the name of a number; the command of a .cfg and the position after it; the place in a .mmwave.json below a device, or
# below a profile or chirp; the default (? for a required number); the values that can be read, if not all; its effect on waveform, timing,
# antennas or samples; and TI's definition. SDK is the mmWave SDK user's guide, section "Configuration (.cfg) file format"; RAW is "Mmwave
# Radar Device ADC Raw Data Capture" (SWRA581B); SPRUIJ4 is the user's guide of the DCA1000EVM; structures are those of mmWaveLink.
_RF, _DATA = "rfConfig", "rawDataCaptureConfig"
FIELDS = tuple(Field(*map(str.strip, row.split("|"))) for row in f"""\
rx_mask | channelCfg 0 | {_RF}.rlChanCfg_t.rxChannelEn | ? | | bit n enables receiver n + 1 | rlChanCfg_t
tx_mask | channelCfg 1 | {_RF}.rlChanCfg_t.txChannelEn | ? | | bit n enables transmitter n + 1 | rlChanCfg_t
adc_bits | adcCfg 0 | {_RF}.rlAdcOutCfg_t.fmt.b2AdcBits | 2 | 0 1 2 | 12, 14 or 16 low bits of a word, without repeated sign | SPRUIJ4
adc_format | adcCfg 1 | {_RF}.rlAdcOutCfg_t.fmt.b2AdcOutFmt | 1 | 0 1 2 3 | real, complex 1x, complex 2x, pseudo-real | rlAdcBitFormat_t
buffer_real | adcbufCfg 1 | | 0 | 0 1 | 1: the buffer holds only real samples | SDK, adcOutputFmt
q_first | adcbufCfg 2 | {_DATA}.rlDevDataFmtCfg_t.iqSwapSel | | 0 1 | 1: Q comes before I | SDK, SampleSwap; RAW
separate | adcbufCfg 3 | {_DATA}.rlDevDataFmtCfg_t.chInterleave | 1 | 0 1 | 0: the receivers alternate | SDK, ChanInterleave; RAW
content | lvdsStreamCfg 2 | | 1 | 0 1 | 4: chirp parameters and quality stand beside the samples | SDK, dataFmt
packet | | {_DATA}.rlDevDataPathCfg_t.transferFmtPkt0 | 1 | 1 | 1: only samples are sent | rlDevDataPathCfg_t
lanes | | {_DATA}.rlDevLaneEnable_t.laneEn | 3 | 3 15 | bit mask of the LVDS lanes | rlDevLaneEnable_t
second_packet | | {_DATA}.rlDevDataPathCfg_t.transferFmtPkt1 | 0 | 0 | other data follow the samples of each chirp | rlDevDataPathCfg_t
frame_mode | dfeDataOutputMode 0 | | 1 | 1 | 1: equal frames of chirps, 2: no chirps, 3: sub-frames | SDK
bpm | bpmCfg 1 | | 0 | 0 | 1: two transmitters send at once with binary phases | SDK
first | frameCfg 0 | {_RF}.rlFrameCfg_t.chirpStartIdx | ? | | first chirp of a loop | rlFrameCfg_t
last | frameCfg 1 | {_RF}.rlFrameCfg_t.chirpEndIdx | ? | | last chirp of a loop | rlFrameCfg_t
loops | frameCfg 2 | {_RF}.rlFrameCfg_t.numLoops | ? | | loops per frame | rlFrameCfg_t
frames | frameCfg 3 | {_RF}.rlFrameCfg_t.numFrames | 0 | | frames of the capture, 0 for no limit | rlFrameCfg_t
period_ms | frameCfg 4 | {_RF}.rlFrameCfg_t.framePeriodicity_msec | ? | | frame period in ms | rlFrameCfg_t
identity | profileCfg 0 | profileId | ? | | number of the profile | rlProfileCfg_t
start_ghz | profileCfg 1 | startFreqConst_GHz | ? | | start of the sweep in GHz | rlProfileCfg_t
idle_us | profileCfg 2 | idleTimeConst_usec | ? | | pause before a chirp in us | rlProfileCfg_t
adc_start_us | profileCfg 3 | adcStartTimeConst_usec | ? | | time of the first sample in us | rlProfileCfg_t
ramp_end_us | profileCfg 4 | rampEndTime_usec | ? | | duration of a chirp in us | rlProfileCfg_t
backoff | profileCfg 5 | txOutPowerBackoffCode | ? | | one byte per transmitter: reduction of its power in dB | rlProfileCfg_t
phases | profileCfg 6 | txPhaseShifter | 0 | | one byte per transmitter: its phase in 1/256 of a turn | rlProfileCfg_t
slope_mhz_us | profileCfg 7 | freqSlopeConst_MHz_usec | ? | | slope of the sweep in MHz/us | rlProfileCfg_t
samples | profileCfg 9 | numAdcSamples | ? | | samples of a chirp | rlProfileCfg_t
rate_ksps | profileCfg 10 | digOutSampleRate | ? | | sample rate in ksps | rlProfileCfg_t
first | chirpCfg 0 | chirpStartIdx | ? | | first chirp that this entry describes | rlChirpCfg_t
last | chirpCfg 1 | chirpEndIdx | ? | | last chirp that this entry describes | rlChirpCfg_t
profile | chirpCfg 2 | profileId | ? | | number of the profile | rlChirpCfg_t
start_change_mhz | chirpCfg 3 | startFreqVar_MHz | ? | | change of the start frequency | rlChirpCfg_t
slope_change_khz_us | chirpCfg 4 | freqSlopeVar_KHz_usec | ? | | change of the slope | rlChirpCfg_t
idle_change_us | chirpCfg 5 | idleTimeVar_usec | ? | | change of the pause | rlChirpCfg_t
adc_change_us | chirpCfg 6 | adcStartTimeVar_usec | ? | | change of the time of the first sample | rlChirpCfg_t
tx_mask | chirpCfg 7 | txEnable | ? | | bit n: transmitter n + 1 sends this chirp | rlChirpCfg_t
""".splitlines())  # fmt: skip
_WITH_UNIT = ("_ghz", "_mhz", "_us", "_ms", "_ksps")  # ends of the names of the numbers that need not be whole
_REQUIRED = "?"
# Further words of a .cfg:
# - lvdsStreamCfg 1 announces a header before each chirp. The reader finds headers by their magic words (radartwin.radar.dca1000).
# - flushCfg clears all commands before it (SDK).
# - The comment "% Platform:NAME" of TI's visualizer names the chip, and NAME_AOP its package with antennas.
# - antGeometry0, antGeometry1, antPhaseRot: azimuth, elevation and sign of each virtual antenna in half wavelengths (3D people tracking
#   detection layer tuning guide, TI Radar Toolbox).
# - antGeometryCfg: row and column of each virtual antenna, then the spacing of columns and rows in wavelengths (MMWAVE-MCUPLUS SDK).
_LISTS = ("antGeometry0", "antGeometry1", "antPhaseRot", "antGeometryCfg")
_PHASES_OF_CHIRPS = ("rlBpmChirps", "rlRfPhaseShiftCfgs")  # of a .mmwave.json: binary phases and phase shifts (rlBpmChirpCfg_t)
_CHANGES = ("rlDynChirpCfgs", "rlDynPerChirpPhShftCfgs", "rlLoopbackBursts")  # of a .mmwave.json: chirps that change during the capture
_PARTS = {"profileCfg": ("rlProfiles", "rlProfileCfg_t"), "chirpCfg": ("rlChirps", "rlChirpCfg_t")}  # commands that a file repeats
# Commands with two forms: the number of arguments of the rarer form, and the conversion to the other form. The frameCfg of AWR294x has the
# number of samples before the period (MMWAVE-MCUPLUS SDK). The adcbufCfg of SDK 1 has no sub-frame before its four numbers (SDK). The four
# lanes of xWR14xx carry I before Q, although their only adcbufCfg (0 1 0 1) has SampleSwap 1.
_FORMS = {("frameCfg", 8): lambda v: [*v[:4], *v[5:]], ("adcbufCfg", 4): lambda v: [-1.0, v[0], v[1] if v[2] else 0.0, *v[2:]]}
_REFUSED = {
    "advFrameCfg": "sub-frames are not supported; use frameCfg",
    **dict.fromkeys(
        ("chirpComnCfg", "chirpTimingCfg"),
        "the low-power configuration format of xWRL6432 and xWRL1432 is not supported; give a .yaml with the fields of the radar",
    ),
}
_PLATFORMS = {
    "xwr14xx": "IWR1843BOOST", "xwr16xx": "IWR1642BOOST", "xwr18xx": "IWR1843BOOST", "xwr68xx": "IWR6843ISK", "xwr68xx_aop": "IWR6843AOP",
    "xwr68xx_ods": "IWR6843ISK-ODS", "xwr64xx": "IWR6843ISK", "xwr294x": "AWR2944EVM", "awr294x": "AWR2944EVM", "awr2944": "AWR2944EVM",
}  # fmt: skip

Numbers = dict[str, Any]


class Setup(NamedTuple):
    """Hold the numbers of a radar description by the names of FIELDS, and what a .cfg says about the antennas.

    Attributes:
        lists: numbers of the commands in _LISTS.
        platform: name after "% Platform:", or None.
        assumed: name of the board to assume if nothing else names it, or None.
    """

    numbers: Numbers
    profiles: list[Numbers]
    chirps: list[Numbers]
    lists: Mapping[str, list[float]]
    platform: str | None = None
    assumed: str | None = None


class Description(NamedTuple):
    """Hold what a radar file says about a capture.

    Attributes:
        fields: fields of `Radar`.
        layout: layout of the samples.
        board: name of the board and how it was chosen, as text; "" if the file gives the antenna positions.
        frames: number of frames of the capture; 0 for no limit.
        factors: factor (tx, rx) of each channel that undoes the signs and phases of its antennas; None for 1.
    """

    fields: dict[str, Any]
    layout: Layout = Layout()
    board: str = ""
    frames: int = 0
    factors: tuple[tuple[complex, ...], ...] | None = None


def parse_cfg(text: str) -> Setup:
    """Parse the text of a mmWave SDK .cfg file. Raise RecordingError if the text is malformed; the message names the line."""
    needed = dict.fromkeys((*_LISTS, *(field.command for field in FIELDS if field.cfg)), 0)  # smallest number of arguments of each command
    needed |= {field.command: field.position + 1 for field in FIELDS if field.cfg and field.default == _REQUIRED}
    sections: list[dict[str, list[tuple[str, list[float]]]]] = [{}]
    assumed = None
    for number, line in enumerate(text.splitlines(), start=1):
        command, *words = line.split("%", 1)[0].split() or [""]
        place = f"line {number}"
        if command == "flushCfg":
            sections.append({})
        if command in _REFUSED:
            raise RecordingError(f"{place}: {command}: {_REFUSED[command]}")
        if command not in needed:
            continue
        values = [_number(word, f"{place}: {command}") for word in words]
        if (command, len(values)) in _FORMS:
            form, assumed = _FORMS[command, len(values)], "AWR2944EVM" if command == "frameCfg" else assumed
            values = form(values)
        if len(values) < needed[command]:
            raise RecordingError(f"{place}: {command} needs at least {needed[command]} numbers, it has {len(values)}")
        sections[-1].setdefault(command, []).append((place, values))
    commands = next((section for section in sections[::-1] if "frameCfg" in section), sections[-1])
    for command in ("channelCfg", *_PARTS, "frameCfg"):
        if command not in commands:
            raise RecordingError(f"it has no {command} line; give a mmWave SDK configuration")

    def numbers(fields: Sequence[Field], entry: int = -1) -> Numbers:
        out: Numbers = {}
        for field in fields:
            place, values = commands[field.command][entry] if field.command in commands else ("", [])
            out[field.name] = _checked(field, values[field.position] if len(values) > field.position else field.default, place)
        return out

    general = numbers([field for field in FIELDS if field.cfg and field.command not in _PARTS])
    platforms = re.findall(r"(?i)%\s*Platform\s*:\s*(\S+)", text)
    return Setup(
        general,
        *([numbers(_fields_of(part), n) for n in range(len(commands[part]))] for part in _PARTS),
        lists={name: commands[name][-1][1] for name in _LISTS if name in commands},
        platform=platforms[-1] if platforms else None,
        assumed=assumed,
    )


def parse_studio(values: Mapping[str, Any]) -> Setup:
    """Parse the only device in the content of a mmWave Studio .mmwave.json file. Raise RecordingError if a value is malformed."""
    device = _get(values, "mmWaveDevices", 0)
    if (count := len(values["mmWaveDevices"])) > 1:
        raise RecordingError(f"it describes {count} devices; for four AWR2243 of the cascade, give --radar awr2243_cascade")
    if changes := [listed for listed in _CHANGES if _get(device, _RF, listed, default=[])]:
        raise RecordingError(f"{changes[0]} changes chirps during the capture, which is not supported; leave it empty")
    if (waveform := _get(device, _RF, "waveformType", default="legacyFrameChirp")) != "legacyFrameChirp":
        raise RecordingError(f"waveformType {waveform} is not supported; use legacyFrameChirp")

    def numbers(mapping: Any, fields: Sequence[Field]) -> Numbers:
        return {field.name: _checked(field, _get(mapping, *field.studio.split("."), default=field.default)) for field in fields}

    for listed in _PHASES_OF_CHIRPS:
        for structure in (
            s for entry in _get(device, _RF, listed, default=[]) for s in (entry.values() if isinstance(entry, dict) else ())
        ):
            if any(_number(value, f"{listed}.{key}") for key, value in structure.items() if not key.endswith("Idx")):
                raise RecordingError(f"{listed} changes the phases of single chirps, which is not supported; set its values to 0")
    parts = []
    for part, (listed, structure) in _PARTS.items():
        if not isinstance(entries := _get(device, _RF, listed), list):
            raise RecordingError(f"its {listed} is not a JSON list; export it again")
        parts.append([numbers(_get(entry, structure), _fields_of(part)) for entry in entries])
    return Setup(numbers(device, [field for field in FIELDS if field.studio and field.command not in _PARTS]), *parts, lists={})


def _fields_of(part: str) -> list[Field]:
    return [field for field in FIELDS if field.command == part]


def describe(name: str, setup: Setup, board: str | None = None) -> Description:
    """Convert a parsed TI radar description to the fields of `Radar`, the layout of the samples, and the board.

    Args:
        name: name of the radar.
        setup: result of `parse_cfg` or `parse_studio`.
        board: name of the board; None takes the board from the antenna geometry or the platform in the file. If the file has neither, the
            function assumes the IWR6843ISK below 70 GHz, the AWR2944EVM if TX4 is enabled, the IWR1642BOOST if only TX1 and TX2 are
            enabled, and otherwise the IWR1843BOOST.
    Raises:
        RecordingError: the frame does not consist of equal chirps with one transmitter at a time (time division), or the board is unknown
            or lacks antennas.
    """
    (transmitters, profile), numbers = _fired(setup), setup.numbers
    if min(numbers["period_ms"], profile["rate_ksps"], profile["start_ghz"]) <= 0:
        raise RecordingError("frame period, ADC rate and start frequency must be above zero")
    receivers = [n for n in range(numbers["rx_mask"].bit_length()) if numbers["rx_mask"] >> n & 1]
    antennas, reason = _antennas(setup, profile, board, transmitters, receivers)
    phases_rad = [2 * math.pi / 256 * (profile["phases"] >> 8 * n & 0xFF) for n in transmitters]
    signs = antennas.signs or ((1,) * len(receivers),) * len(transmitters)
    # The mixer subtracts the phase of the received wave from that of the oscillator, so that the samples have the negative phase.
    factors = tuple(tuple(sign * cmath.exp(1j * phase) for sign in row) for row, phase in zip(signs, phases_rad, strict=True))
    real = numbers["adc_format"] == 0 or numbers.get("buffer_real") == 1
    if real and any(phases_rad):
        raise RecordingError("txPhaseShifter is not supported with real samples; give a .yaml with the fields of the radar")
    fields = {
        "name": name,
        "start_frequency_hz": profile["start_ghz"] * 1e9 + profile["slope_mhz_us"] * 1e6 * profile["adc_start_us"],
        "slope_hz_per_s": profile["slope_mhz_us"] * 1e12,
        "sample_rate_hz": profile["rate_ksps"] * 1e3,
        "num_samples": profile["samples"],
        "num_chirps": numbers["loops"],
        "tx_positions_m": antennas.tx_positions_m,
        "rx_positions_m": antennas.rx_positions_m,
        "chirp_interval": (profile["idle_us"] + profile["ramp_end_us"]) * 1e-6,
        "frame_rate_hz": 1e3 / numbers["period_ms"],
        "element": antennas.element,
        "noise_figure_db": _NOISE_FIGURE_DB,
        "transmit_power_dbm": _MAX_POWER_DBM - (profile["backoff"] >> 8 * transmitters[0] & 0xFF),
        "real_sampling": real,
    }
    interleaved = numbers["separate"] == 0
    if numbers.get("lanes") == 15 and not interleaved:
        raise RecordingError("laneEn 0xf is not supported with chInterleave 1; use two LVDS lanes (0x3), or four lanes with chInterleave 0")
    layout = Layout(
        real=real,
        q_first=None if numbers["q_first"] is None else numbers["q_first"] == 1,
        interleaved=interleaved,
        bits=12 + 2 * numbers["adc_bits"],
        image_filtered=numbers["adc_format"] == 1,
    )
    plain = all(abs(factor - 1) < 1e-9 for row in factors for factor in row)
    return Description(fields, layout, f"{antennas.name}, {reason}", numbers["frames"], None if plain else factors)


def _fired(setup: Setup) -> tuple[list[int], Numbers]:
    """Return the transmitters of one loop by their numbers from 0, in firing order, and the only profile of their chirps."""
    masks: list[int] = []
    profiles: list[Numbers] = []
    known = {profile["identity"]: profile for profile in setup.profiles}  # the last of several profiles with the same number counts
    first, last = setup.numbers["first"], setup.numbers["last"]
    for index in range(first, last + 1):
        chirp = next((chirp for chirp in setup.chirps[::-1] if chirp["first"] <= index <= chirp["last"]), None)
        if chirp is None:
            raise RecordingError(f"the frame fires chirp {index}, which no chirp entry describes; add its chirpCfg or rlChirps entry")
        place, mask = f"chirp {chirp['first']}", chirp["tx_mask"]
        if any(value for name, value in chirp.items() if "_change_" in name):
            raise RecordingError(f"{place} changes frequency, slope or times of its profile; set these changes to 0")
        if mask.bit_count() != 1:
            raise RecordingError(f"{place} enables the transmitters {mask:#x}; enable exactly one, because only time division is supported")
        if mask in masks:
            raise RecordingError("a transmitter fires twice in one loop; raise numLoops instead")
        if chirp["profile"] not in known:
            raise RecordingError(f"{place} uses profile {chirp['profile']}, which is not defined; add this profile")
        masks.append(mask)
        profiles.append({**known[chirp["profile"]], "identity": 0})
    if not masks:
        raise RecordingError(f"the frame fires no chirp, because it goes from chirp {first} to {last}; correct these numbers")
    if any(profile != profiles[0] for profile in profiles):
        raise RecordingError("its chirps use several profiles; use one profile for all chirps")
    return [mask.bit_length() - 1 for mask in masks], profiles[0]


def _antennas(setup: Setup, profile: Numbers, name: str | None, transmitters: Sequence[int], receivers: Sequence[int]) -> tuple[Board, str]:
    """Return the fired transmitters and the enabled receivers of a description's board, and how the board was chosen, as text."""
    lists, mask = setup.lists, setup.numbers["tx_mask"]
    by_name = {known.casefold(): board for known, board in BOARDS.items()}
    if name is not None:
        if name.casefold() not in by_name:
            raise RecordingError(f"board {name!r} is unknown; choose {', '.join(BOARDS)}")
        board, reason = by_name[name.casefold()], "chosen"
    elif geometry := _geometry(lists):
        command, places = geometry
        shipped = next((known for known, row in GEOMETRY.items() if tuple(map(tuple, places)) == row), "antennas")
        # The list has an entry for each channel, or for each channel of the whole board, which has four receivers.
        partial = len(places[0]) == len(transmitters) * len(receivers)
        half_wavelength_m = SPEED_OF_LIGHT / (profile["start_ghz"] * 1e9) / 2
        board = board_of_channels(shipped, half_wavelength_m, *places, receivers=len(receivers) if partial else 4)
        if shipped == IWR6843ISK.name:
            board = IWR6843ISK
        elif partial:
            return board, f"from {command}"
        reason = f"from {command}"
    elif setup.platform is not None:
        if (known := _PLATFORMS.get(setup.platform.casefold())) is None:
            raise RecordingError(f"'% Platform:{setup.platform}' names a chip without a known board; choose the board with --board")
        board, reason = BOARDS[known], f"from '% Platform:{setup.platform}'"
    else:
        by_carrier = IWR6843ISK if profile["start_ghz"] < 70 else AWR2944EVM if mask > 7 else IWR1642BOOST if mask == 3 else IWR1843BOOST
        board, reason = BOARDS[setup.assumed] if setup.assumed else by_carrier, "assumed"
    if not receivers or max(receivers) >= len(board.rx_positions_m) or max(transmitters) >= len(board.tx_positions_m):
        channels = f"channels rx {setup.numbers['rx_mask']:#x} tx {mask:#x} do not fit a {board.name}"
        raise RecordingError(f"{channels}; choose the board with --board, or give a .yaml with the antenna positions")
    return board.part(transmitters, receivers), reason


def _geometry(lists: Mapping[str, list[float]]) -> tuple[str, tuple[list[float], list[float], list[float]]] | None:
    """Return the command that gives the antenna geometry, and azimuth, elevation and sign of each channel in half wavelengths."""
    if "antGeometry0" in lists and "antGeometry1" in lists:
        azimuth = lists["antGeometry0"]
        return "antGeometry0", (azimuth, lists["antGeometry1"], lists.get("antPhaseRot", [1.0] * len(azimuth)))
    if len(values := lists.get("antGeometryCfg", [])) > 2:
        *places, column_spacing, row_spacing = values
        azimuth, elevation = [2 * column_spacing * n for n in places[1::2]], [-2 * row_spacing * n for n in places[::2]]
        return "antGeometryCfg", (azimuth, elevation, [1.0] * len(azimuth))
    return None


def _checked(field: Field, value: Any, place: str = "") -> Any:
    """Return a value of a description as a number, or None for an empty default. Raise RecordingError if the field does not allow it."""
    if value == field.default == "":
        return None
    number, place = _number(value, place or field.studio), place or field.studio
    if field.name.endswith(_WITH_UNIT):
        return number
    if number != int(number):
        raise RecordingError(f"{place}: {number:g} must be a whole number")
    if field.allowed and str(int(number)) not in field.allowed.split():
        raise RecordingError(f"{place}: {field.name} {number:g} is not supported ({field.meaning}); use {field.allowed}")
    return int(number)


def _get(mapping: Any, *keys: str | int, default: Any = _REQUIRED) -> Any:
    for depth, key in enumerate(keys):
        if isinstance(mapping, dict) and key not in mapping and default is not _REQUIRED:
            return default
        try:
            mapping = mapping[key]
        except (KeyError, IndexError, TypeError):
            raise RecordingError(f"it has no {'.'.join(map(str, keys[: depth + 1]))}; export it again") from None
    return mapping


def _number(text: Any, place: str) -> float:
    try:
        value = float(int(text, 0)) if isinstance(text, str) and text.lower().startswith("0x") else float(text)
    except (TypeError, ValueError, OverflowError):
        raise RecordingError(f"{place}: {reprlib.repr(text)} is not a number") from None
    if not math.isfinite(value):
        raise RecordingError(f"{place}: {text} is not a finite number")
    return value
