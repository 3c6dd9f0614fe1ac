"""TI's radar descriptions: mmWave SDK .cfg and mmWave Studio .mmwave.json.

Both TI formats describe a profile (one chirp), the chirps with their transmitters, and the frame. The radar of this
package starts at the first ADC sample: start_frequency_hz = startFreq + slope * adcStart; chirp_interval = idle +
rampEnd.

References: mmWave SDK user's guide (TI), section "Configuration (.cfg) file format"; rlProfileCfg_t, rlChirpCfg_t,
rlFrameCfg_t and rlChanCfg_t of the mmWaveLink interface, which mmWave Studio writes under the same names.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from radartwin.errors import RecordingError
from radartwin.radar.boards import BOARDS, IWR1642BOOST, IWR1843BOOST, IWR6843ISK, Board
from radartwin.radar.chirp import Radar

_MAX_POWER_DBM = 12.0  # one transmitter without back-off: IWR1843 (TI SWRS228) and IWR6843 (TI SWRS219) data sheets
_NOISE_FIGURE_DB = 15.0  # the same data sheets give 12 to 15 dB


@dataclass(frozen=True)
class _Profile:
    identity: int
    start_ghz: float
    idle_us: float
    adc_start_us: float
    ramp_end_us: float
    power_backoff: int  # dB, one byte per transmitter
    slope_mhz_us: float
    num_samples: int
    rate_ksps: float


@dataclass(frozen=True)
class _Chirp:
    first: int
    last: int
    profile: int
    variations: tuple[float, ...]
    tx_mask: int


@dataclass(frozen=True)
class _Setup:
    rx_mask: int
    tx_mask: int
    profiles: Sequence[_Profile]
    chirps: Sequence[_Chirp]
    first: int
    last: int
    loops: int
    period_ms: float
    real_sampling: bool


def radar_from_cfg(text: str, name: str, board: str | None = None) -> Radar:
    """The radar of a mmWave SDK .cfg.

    Args:
        name: what to call it.
        board: one of BOARDS. None takes the IWR6843ISK below 70 GHz, otherwise the xWR1843BOOST, or the xWR1642BOOST where
            only TX1 and TX2 are enabled.
    Raises:
        RecordingError: malformed (with its line), or a mode other than time-division chirps of one profile.
    """
    return _assemble(name, _parse_cfg(text), board)


def radar_from_studio(values: Mapping[str, Any], name: str, board: str | None = None) -> Radar:
    """The radar of a parsed mmWave Studio .mmwave.json; arguments and errors as radar_from_cfg."""
    return _assemble(name, _parse_studio(values), board)


def _parse_cfg(text: str) -> _Setup:
    """The four commands of a mmWave SDK .cfg that shape the waveform; the others do not concern the raw data."""
    commands: dict[str, list[tuple[int, list[float]]]] = {}
    wanted = {"channelCfg": 2, "profileCfg": 11, "chirpCfg": 8, "frameCfg": 5, "adcCfg": 2}
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("%", 1)[0].split()
        if not words:
            continue
        if words[0] == "advFrameCfg":
            raise RecordingError(f"line {number}: advFrameCfg (sub-frames) is not supported; use frameCfg")
        if words[0] not in wanted:
            continue
        values = [_number(word, f"line {number}: {words[0]}") for word in words[1:]]
        if len(values) < wanted[words[0]]:
            raise RecordingError(f"line {number}: {words[0]} needs at least {wanted[words[0]]} numbers, it has {len(values)}")
        commands.setdefault(words[0], []).append((number, values))
    for command in ("channelCfg", "profileCfg", "chirpCfg", "frameCfg"):
        if command not in commands:
            raise RecordingError(f"it has no {command} line; is it a mmWave SDK configuration?")
    profiles = [
        _Profile(_whole(n, v[0]), v[1], v[2], v[3], v[4], _whole(n, v[5]), v[7], _whole(n, v[9]), v[10]) for n, v in commands["profileCfg"]
    ]
    chirps = [_Chirp(_whole(n, v[0]), _whole(n, v[1]), _whole(n, v[2]), tuple(v[3:7]), _whole(n, v[7])) for n, v in commands["chirpCfg"]]
    line, channel = commands["channelCfg"][-1]
    frame_line, frame = commands["frameCfg"][-1]
    return _Setup(
        rx_mask=_whole(line, channel[0]),
        tx_mask=_whole(line, channel[1]),
        profiles=profiles,
        chirps=chirps,
        first=_whole(frame_line, frame[0]),
        last=_whole(frame_line, frame[1]),
        loops=_whole(frame_line, frame[2]),
        period_ms=frame[4],
        real_sampling="adcCfg" in commands and commands["adcCfg"][-1][1][1] == 0,
    )


def _parse_studio(values: Mapping[str, Any]) -> _Setup:
    """The first device of a mmWave Studio .mmwave.json."""

    def get(mapping: Any, *keys: str | int) -> Any:
        for depth, key in enumerate(keys):
            try:
                mapping = mapping[key]
            except (KeyError, IndexError, TypeError):
                raise RecordingError(f"it has no {'.'.join(map(str, keys[: depth + 1]))}") from None
        return mapping

    def section(mapping: Any, key: str, kind: type, default: Any = None) -> Any:
        found = get(mapping, key) if default is None else mapping.get(key, default)
        if not isinstance(found, kind):
            raise RecordingError(f"its {key} is not a JSON {'object' if kind is dict else 'list'}; was it edited?")
        return found

    def number(mapping: Any, *keys: str | int) -> float:
        return _number(get(mapping, *keys), ".".join(map(str, keys)))

    device = get(values, "mmWaveDevices", 0)
    rf = section(device, "rfConfig", dict)
    if (waveform := rf.get("waveformType", "legacyFrameChirp")) != "legacyFrameChirp":
        raise RecordingError(f"waveformType {waveform} is not supported; use legacyFrameChirp")
    capture = section(device, "rawDataCaptureConfig", dict, {})
    lanes = section(capture, "rlDevLaneEnable_t", dict, {}).get("laneEn", 3)
    if int(_number(lanes, "laneEn")) != 3:
        raise RecordingError(f"laneEn {lanes} is not the two LVDS lanes (0x3) of xWR16xx, xWR18xx and xWR68xx captures")
    profiles = []
    for entry in section(rf, "rlProfiles", list):
        p = get(entry, "rlProfileCfg_t")
        profiles.append(
            _Profile(
                int(number(p, "profileId")),
                number(p, "startFreqConst_GHz"),
                number(p, "idleTimeConst_usec"),
                number(p, "adcStartTimeConst_usec"),
                number(p, "rampEndTime_usec"),
                int(number(p, "txOutPowerBackoffCode")),
                number(p, "freqSlopeConst_MHz_usec"),
                int(number(p, "numAdcSamples")),
                number(p, "digOutSampleRate"),
            )
        )
    chirps = []
    for entry in section(rf, "rlChirps", list):
        c = get(entry, "rlChirpCfg_t")
        varied = ("startFreqVar_MHz", "freqSlopeVar_KHz_usec", "idleTimeVar_usec", "adcStartTimeVar_usec")
        chirps.append(
            _Chirp(
                int(number(c, "chirpStartIdx")),
                int(number(c, "chirpEndIdx")),
                int(number(c, "profileId")),
                tuple(number(c, name) for name in varied),
                int(number(c, "txEnable")),
            )
        )
    frame = get(rf, "rlFrameCfg_t")
    return _Setup(
        rx_mask=int(number(rf, "rlChanCfg_t", "rxChannelEn")),
        tx_mask=int(number(rf, "rlChanCfg_t", "txChannelEn")),
        profiles=profiles,
        chirps=chirps,
        first=int(number(frame, "chirpStartIdx")),
        last=int(number(frame, "chirpEndIdx")),
        loops=int(number(frame, "numLoops")),
        period_ms=number(frame, "framePeriodicity_msec"),
        real_sampling=int(number(rf, "rlAdcOutCfg_t", "fmt", "b2AdcOutFmt")) == 0,
    )


def _assemble(name: str, setup: _Setup, board_name: str | None) -> Radar:
    fired = []
    for index in range(setup.first, setup.last + 1):
        matching = [chirp for chirp in setup.chirps if chirp.first <= index <= chirp.last]
        if not matching:
            raise RecordingError(f"the frame fires chirp {index}, which no chirp entry describes")
        fired.append(matching[-1])
    if not fired:
        raise RecordingError(f"the frame fires chirps {setup.first} to {setup.last}: none")
    for chirp in fired:
        if any(chirp.variations):
            raise RecordingError(f"chirp {chirp.first} varies its profile; only chirps of one constant profile are supported")
        if bin(chirp.tx_mask).count("1") != 1:
            raise RecordingError(
                f"chirp {chirp.first} enables transmitters {chirp.tx_mask:#x}; only time division (one at a time) is supported"
            )
    transmitters = [chirp.tx_mask.bit_length() - 1 for chirp in fired]
    if len(set(transmitters)) < len(transmitters):
        raise RecordingError("a transmitter fires twice in one loop; raise numLoops instead")
    if len({chirp.profile for chirp in fired}) > 1:
        raise RecordingError("its chirps use several profiles; one is supported")
    profile = next((p for p in setup.profiles if p.identity == fired[0].profile), None)
    if profile is None:
        raise RecordingError(f"chirp {fired[0].first} uses profile {fired[0].profile}, which is not defined")
    board = BOARDS[board_name] if board_name else _likely_board(profile, setup.tx_mask)
    receivers = [n for n in range(len(board.rx_positions_m)) if setup.rx_mask >> n & 1]
    if not receivers or max(transmitters) >= len(board.tx_positions_m):
        raise RecordingError(f"channels rx {setup.rx_mask:#x} tx {setup.tx_mask:#x} do not fit a {board.name}; name the board")
    if setup.period_ms <= 0 or profile.rate_ksps <= 0:
        raise RecordingError("frame period and ADC rate must be above zero")
    return Radar(
        name=name,
        start_frequency_hz=profile.start_ghz * 1e9 + profile.slope_mhz_us * 1e6 * profile.adc_start_us,
        slope_hz_per_s=profile.slope_mhz_us * 1e12,
        sample_rate_hz=profile.rate_ksps * 1e3,
        num_samples=profile.num_samples,
        num_chirps=setup.loops,
        tx_positions_m=tuple(board.tx_positions_m[n] for n in transmitters),
        rx_positions_m=tuple(board.rx_positions_m[n] for n in receivers),
        chirp_interval=(profile.idle_us + profile.ramp_end_us) * 1e-6,
        frame_rate_hz=1e3 / setup.period_ms,
        element=board.element,
        noise_figure_db=_NOISE_FIGURE_DB,
        transmit_power_dbm=_MAX_POWER_DBM - (profile.power_backoff >> 8 * transmitters[0] & 0xFF),
        real_sampling=setup.real_sampling,
    )


def _likely_board(profile: _Profile, tx_mask: int) -> Board:
    if profile.start_ghz < 70:
        return IWR6843ISK
    return IWR1642BOOST if tx_mask == 0b011 else IWR1843BOOST


def _number(text: Any, where: str) -> float:
    try:
        value = float(int(text, 0)) if isinstance(text, str) and text.lower().startswith("0x") else float(text)
    except (TypeError, ValueError, OverflowError):
        raise RecordingError(f"{where}: {reprlib.repr(text)} is not a number") from None
    if not math.isfinite(value):
        raise RecordingError(f"{where}: {text} is not a finite number")
    return value


def _whole(line: int, value: float) -> int:
    if value != int(value):
        raise RecordingError(f"line {line}: {value:g} must be a whole number")
    return int(value)
