"""Convert TI's radar descriptions, mmWave SDK .cfg and mmWave Studio .mmwave.json, to the fields of `radartwin.radar.chirp.Radar`.

Both formats describe a profile (the waveform of a chirp), the chirps with their transmitters, and the frame. The sampled part of the
frequency sweep starts at the first ADC sample, so that start_frequency_hz = startFreq + slope * adcStart. The time between chirps is
chirp_interval = idle + rampEnd.

References: mmWave SDK user's guide (TI), section "Configuration (.cfg) file format"; rlProfileCfg_t, rlChirpCfg_t, rlFrameCfg_t and
rlChanCfg_t of the mmWaveLink interface. mmWave Studio writes the values of these structures under the same names.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from radartwin.errors import RecordingError
from radartwin.radar.boards import IWR1642BOOST, IWR1843BOOST, IWR6843ISK

# Transmit power of one transmitter without back-off in dBm, from the data sheets of IWR1843 (TI SWRS228) and IWR6843 (TI SWRS219).
_MAX_POWER_DBM = 12.0
_NOISE_FIGURE_DB = 15.0  # receiver noise figure in dB; the data sheets of IWR1843 and IWR6843 give 12 to 15 dB

# Commands of a .cfg that define the waveform, with the smallest number of arguments of each.
_CFG_COMMANDS = {"channelCfg": 2, "profileCfg": 11, "chirpCfg": 8, "frameCfg": 5, "adcCfg": 2}
# Keys of a .mmwave.json in the order of the fields of _Profile and _Chirp.
_PROFILE_KEYS = (
    "profileId", "startFreqConst_GHz", "idleTimeConst_usec", "adcStartTimeConst_usec", "rampEndTime_usec", "txOutPowerBackoffCode",
    "freqSlopeConst_MHz_usec", "numAdcSamples", "digOutSampleRate",
)  # fmt: skip
_CHIRP_KEYS = (
    "chirpStartIdx", "chirpEndIdx", "profileId", "startFreqVar_MHz", "freqSlopeVar_KHz_usec", "idleTimeVar_usec",
    "adcStartTimeVar_usec", "txEnable",
)  # fmt: skip


class _Profile(NamedTuple):
    identity: int
    start_ghz: float
    idle_us: float
    adc_start_us: float
    ramp_end_us: float
    power_backoff: int  # reduction of the transmit power in dB, one byte per transmitter
    slope_mhz_us: float
    num_samples: int
    rate_ksps: float

    @classmethod
    def of(cls, place: str, values: Sequence[float]) -> _Profile:
        identity, start, idle, adc_start, ramp_end, backoff, slope, samples, rate = values
        identity, backoff, samples = (_whole(place, value) for value in (identity, backoff, samples))
        return cls(identity, start, idle, adc_start, ramp_end, backoff, slope, samples, rate)


class _Chirp(NamedTuple):
    first: int
    last: int
    profile: int
    variations: Sequence[float]  # differences of start frequency, slope, idle time and ADC start time from the profile
    tx_mask: int

    @classmethod
    def of(cls, place: str, values: Sequence[float]) -> _Chirp:
        first, last, profile, tx_mask = (_whole(place, value) for value in (*values[:3], values[7]))
        return cls(first, last, profile, values[3:7], tx_mask)


class Setup(NamedTuple):
    """Hold the values of a radar description that a .cfg file and a .mmwave.json file have in common."""

    rx_mask: int
    tx_mask: int
    profiles: Sequence[_Profile]
    chirps: Sequence[_Chirp]
    first: int
    last: int
    loops: int
    period_ms: float
    real_sampling: bool


def parse_cfg(text: str) -> Setup:
    """Parse the text of a mmWave SDK .cfg file. Raise RecordingError if the text is malformed; the message names the line."""
    commands: dict[str, list[tuple[str, list[float]]]] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        command, *words = line.split("%", 1)[0].split() or [""]
        place = f"line {number}"
        if command == "advFrameCfg":
            raise RecordingError(f"{place}: advFrameCfg (sub-frames) is not supported; use frameCfg")
        if command not in _CFG_COMMANDS:
            continue
        values = [_number(word, f"{place}: {command}") for word in words]
        if len(values) < _CFG_COMMANDS[command]:
            raise RecordingError(f"{place}: {command} needs at least {_CFG_COMMANDS[command]} numbers, it has {len(values)}")
        commands.setdefault(command, []).append((place, values))
    for command in ("channelCfg", "profileCfg", "chirpCfg", "frameCfg"):
        if command not in commands:
            raise RecordingError(f"it has no {command} line; give a mmWave SDK configuration")
    channel_place, channel = commands["channelCfg"][-1]
    frame_place, frame = commands["frameCfg"][-1]
    rx_mask, tx_mask = (_whole(channel_place, value) for value in channel[:2])
    first, last, loops = (_whole(frame_place, value) for value in frame[:3])
    return Setup(
        rx_mask,
        tx_mask,
        [_Profile.of(place, [*v[:6], v[7], *v[9:11]]) for place, v in commands["profileCfg"]],
        [_Chirp.of(place, v[:8]) for place, v in commands["chirpCfg"]],
        first,
        last,
        loops,
        period_ms=frame[4],
        real_sampling="adcCfg" in commands and commands["adcCfg"][-1][1][1] == 0,
    )


def parse_studio(values: Mapping[str, Any]) -> Setup:
    """Parse the first device in the content of a mmWave Studio .mmwave.json file. Raise RecordingError if a value is malformed."""
    device = _get(values, "mmWaveDevices", 0)
    rf = _section(device, "rfConfig", dict)
    if (waveform := rf.get("waveformType", "legacyFrameChirp")) != "legacyFrameChirp":
        raise RecordingError(f"waveformType {waveform} is not supported; use legacyFrameChirp")
    capture = _section(device, "rawDataCaptureConfig", dict, {})
    lanes = _section(capture, "rlDevLaneEnable_t", dict, {}).get("laneEn", 3)
    if int(_number(lanes, "laneEn")) != 3:
        raise RecordingError(f"laneEn {lanes} is not supported; use the two LVDS lanes (0x3) of xWR16xx, xWR18xx and xWR68xx captures")

    def numbers(mapping: Any, *keys: str) -> list[float]:
        return [_number(_get(mapping, key), key) for key in keys]

    def integers(mapping: Any, *keys: str) -> list[int]:
        return [_whole(key, _number(_get(mapping, key), key)) for key in keys]

    frame = _get(rf, "rlFrameCfg_t")
    rx_mask, tx_mask = integers(_get(rf, "rlChanCfg_t"), "rxChannelEn", "txChannelEn")
    first, last, loops = integers(frame, "chirpStartIdx", "chirpEndIdx", "numLoops")
    (period_ms,) = numbers(frame, "framePeriodicity_msec")
    return Setup(
        rx_mask,
        tx_mask,
        [_Profile.of("rlProfiles", numbers(_get(p, "rlProfileCfg_t"), *_PROFILE_KEYS)) for p in _section(rf, "rlProfiles", list)],
        [_Chirp.of("rlChirps", numbers(_get(c, "rlChirpCfg_t"), *_CHIRP_KEYS)) for c in _section(rf, "rlChirps", list)],
        first,
        last,
        loops,
        period_ms,
        real_sampling=integers(_get(rf, "rlAdcOutCfg_t", "fmt"), "b2AdcOutFmt") == [0],
    )


def _fired_chirps(setup: Setup) -> list[_Chirp]:
    """Return the chirps of one loop in firing order.

    Raises:
        RecordingError: the frame does not consist of chirps of a single profile with one transmitter at a time (time division).
    """
    fired = []
    for index in range(setup.first, setup.last + 1):
        matching = [chirp for chirp in setup.chirps if chirp.first <= index <= chirp.last]
        if not matching:
            raise RecordingError(f"the frame fires chirp {index}, which no chirp entry describes; add its chirpCfg or rlChirps entry")
        chirp = matching[-1]
        if any(chirp.variations):
            raise RecordingError(f"chirp {chirp.first} changes frequency, slope or times of its profile; set these changes to 0")
        if chirp.tx_mask.bit_count() != 1:
            raise RecordingError(
                f"chirp {chirp.first} enables the transmitters {chirp.tx_mask:#x}; enable exactly one, because only time division is "
                "supported"
            )
        fired.append(chirp)
    if not fired:
        raise RecordingError(f"the frame fires no chirp, because it goes from chirp {setup.first} to {setup.last}; correct these numbers")
    if len({chirp.tx_mask for chirp in fired}) < len(fired):
        raise RecordingError("a transmitter fires twice in one loop; raise numLoops instead")
    if len({chirp.profile for chirp in fired}) > 1:
        raise RecordingError("its chirps use several profiles; use one profile for all chirps")
    return fired


def radar_fields(name: str, setup: Setup) -> dict[str, Any]:
    """Convert a parsed TI radar description to the fields of `Radar`.

    TI's files do not name their board. Below 70 GHz, the function assumes the IWR6843ISK. At 70 GHz and above, it assumes the xWR1642BOOST
    if only TX1 and TX2 are enabled, and otherwise the xWR1843BOOST.

    Args:
        name: name of the radar.
        setup: result of `parse_cfg` or `parse_studio`.
    Raises:
        RecordingError: the frame does not consist of chirps of a single profile with one transmitter at a time (time division).
    """
    fired = _fired_chirps(setup)
    transmitters = [chirp.tx_mask.bit_length() - 1 for chirp in fired]
    profile = next((p for p in setup.profiles if p.identity == fired[0].profile), None)
    if profile is None:
        raise RecordingError(f"chirp {fired[0].first} uses profile {fired[0].profile}, which is not defined; add this profile")
    board = IWR1642BOOST if setup.tx_mask == 0b011 else IWR1843BOOST
    if profile.start_ghz < 70:
        board = IWR6843ISK
    receivers = [n for n in range(len(board.rx_positions_m)) if setup.rx_mask >> n & 1]
    if not receivers or max(transmitters) >= len(board.tx_positions_m):
        raise RecordingError(
            f"channels rx {setup.rx_mask:#x} tx {setup.tx_mask:#x} do not fit a {board.name}; give a .yaml with the antenna positions"
        )
    if setup.period_ms <= 0 or profile.rate_ksps <= 0:
        raise RecordingError("frame period and ADC rate must be above zero")
    return {
        "name": name,
        "start_frequency_hz": profile.start_ghz * 1e9 + profile.slope_mhz_us * 1e6 * profile.adc_start_us,
        "slope_hz_per_s": profile.slope_mhz_us * 1e12,
        "sample_rate_hz": profile.rate_ksps * 1e3,
        "num_samples": profile.num_samples,
        "num_chirps": setup.loops,
        "tx_positions_m": tuple(board.tx_positions_m[n] for n in transmitters),
        "rx_positions_m": tuple(board.rx_positions_m[n] for n in receivers),
        "chirp_interval": (profile.idle_us + profile.ramp_end_us) * 1e-6,
        "frame_rate_hz": 1e3 / setup.period_ms,
        "element": board.element,
        "noise_figure_db": _NOISE_FIGURE_DB,
        "transmit_power_dbm": _MAX_POWER_DBM - (profile.power_backoff >> 8 * transmitters[0] & 0xFF),
        "real_sampling": setup.real_sampling,
    }


def _get(mapping: Any, *keys: str | int) -> Any:
    for depth, key in enumerate(keys):
        try:
            mapping = mapping[key]
        except (KeyError, IndexError, TypeError):
            raise RecordingError(f"it has no {'.'.join(map(str, keys[: depth + 1]))}; export it again") from None
    return mapping


def _section(mapping: Any, key: str, kind: type, default: Any = None) -> Any:
    found = _get(mapping, key) if default is None else mapping.get(key, default)
    if not isinstance(found, kind):
        raise RecordingError(f"its {key} is not a JSON {'object' if kind is dict else 'list'}; export it again")
    return found


def _number(text: Any, place: str) -> float:
    try:
        value = float(int(text, 0)) if isinstance(text, str) and text.lower().startswith("0x") else float(text)
    except (TypeError, ValueError, OverflowError):
        raise RecordingError(f"{place}: {reprlib.repr(text)} is not a number") from None
    if not math.isfinite(value):
        raise RecordingError(f"{place}: {text} is not a finite number")
    return value


def _whole(place: str, value: float) -> int:
    if value != int(value):
        raise RecordingError(f"{place}: {value:g} must be a whole number")
    return int(value)
