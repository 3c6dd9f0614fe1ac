"""Recordings and features for the study of single gaps. A gap is a known difference between virtual measurement (testbed) and simulation.

In the base configuration every gap is off, so the simulation has the true materials and the exact room. The function `alone` switches a
single gap on. A `Reading` holds the features of one recording (target gate of +-3 range bins, ranges from 0.3 to 5.5 m) and the complex
signal, which also shows changes of phase.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from experiments.campaign.campaign import Campaign, load_clean
from experiments.campaign.cases import Case
from experiments.interface import Config, Progress, Store
from radartwin.config.materials import MaterialsConfig, TrueMaterials
from radartwin.config.study import GapConfig
from radartwin.errors import ConfigError
from radartwin.features import envelope, peak_track
from radartwin.features.log import Log, distances
from radartwin.features.processed import Processed, process
from radartwin.features.profile import FAR_M, GATE_BINS, NEAR_M, gate_energies, multipath_share, profile_correlation

GAPS = tuple(f.name for f in fields(GapConfig))
ZERO_M = 0.2  # the coupling between antennas appears below this range
METAL = (Case("corner_reflector", "lab", "turntable", 1.0), Case("drink_can_355", "lab", "turntable", 1.0))
FILLED = (Case("mustard", "lab", "turntable", 1.0),)
DRIVE = (Case("corner_reflector", "squash_court", "depth", 1.0),)
GROUPS: dict[str, tuple[Case, ...]] = {
    "turntable": (*METAL, *FILLED), "turntable, metal": METAL, "turntable, filled bottle": FILLED, "drive": DRIVE,
}  # fmt: skip
CASES = (*METAL, *FILLED, *DRIVE)
ROOM_BINS = 12  # 0.5 m on each side of the target; further away the Hann window suppresses the target's echo by 70 dB
FRAMES, EVERY = 24, 5  # 24 frames per revolution, and every fifth frame of a drive, in all profiles
LOWEST_DB = -200.0  # level that stands for zero power
SPAN_DB = 60.0  # range profiles are compared over bins down to this level below the strongest bin


def alone(config: Config, gap: str | None = None, strength: float = 1.0, turns: int = 1) -> Config:
    """Return the configuration with one gap at a strength and all other gaps off. `gap=None` switches all gaps off.

    A measured turntable makes `turns` revolutions. If the recording then has more frames than traced angles, its frames are interpolated
    (experiments/campaign/truth.py). Raises ConfigError for an unknown gap.
    """
    if gap is not None and gap not in GAPS:
        raise ConfigError(f"measured.gap.{gap}: unknown gap; choose {', '.join(GAPS)}")
    strengths = {} if gap is None else {gap: strength}
    return with_gaps(config, strengths, TrueMaterials(), frames_per_turn=FRAMES, rover_every=EVERY, turns=turns)


def with_gaps(config: Config, strengths: Mapping[str, float], materials: MaterialsConfig, **campaign: int) -> Config:
    """Return the configuration with these gap strengths (all other gaps off), simulated materials, and campaign settings."""
    measured = replace(config.measured, gap=GapConfig(**{**dict.fromkeys(GAPS, 0.0), **strengths}))
    profile = replace(config.profile, campaign=replace(config.profile.campaign, **campaign))
    return replace(config, materials=materials, measured=measured, profile=profile)


def check_untouched(config: Config) -> None:
    """Raise ConfigError if the measured recordings come from a recording set, or if the configuration sets measured.gap."""
    if config.measured.provider != "testbed":
        raise ConfigError("measured=recordings has no gaps that could be switched; use measured=testbed")
    if config.measured.gap != GapConfig():
        raise ConfigError(f"experiment={config.experiment.name} switches every measured.gap itself; leave measured.gap out")


@dataclass(frozen=True, eq=False)
class Reading:
    """Features of one recording. All features except zero_db are computed over ranges from NEAR_M to FAR_M."""

    key: str  # store key of the product that was read
    range_m: NDArray[np.float64]  # (B,) range of each bin
    channels: NDArray[np.complex64]  # (F, A, B) complex range profiles
    target: NDArray[np.bool_]  # (F, B) mask of the target gate
    room: NDArray[np.bool_]  # (F, B) mask of the bins more than ROOM_BINS from the target
    profile: NDArray[np.float64]  # (B,) mean power
    brightness_db: float  # energy in the target gate, corrected for the range law
    room_db: float  # energy in the cells of `room`
    multipath: float  # share of the energy outside the target gate (multipath share)
    harmonic_ratio: float  # angular harmonic ratio of a revolution; NaN for a drive
    track_m: NDArray[np.floating]  # (F,) range in metres of the target's peak in each frame
    energy: NDArray[np.float64]  # (F,) energy in the target gate
    noise_db: float  # median noise of a range bin
    zero_db: float  # mean power of the bins within ZERO_M


def recorded(config: Config, store: Store, progress: Progress, domain: str, case: Case, frames: int | None = None) -> Reading:
    """Compute the features of a case, or of its first `frames` frames; simulated recordings are read without receiver noise."""
    campaign = Campaign(config, store, progress)
    log = campaign.log(case, domain)
    if domain == "measured":
        key, processed = campaign.processed(domain, case)
    else:
        product = campaign.clean(domain, case)
        key, processed = product.key, process(load_clean(product), doppler=False)
    return read(key, processed.frames(slice(frames)), log)


def read(key: str, processed: Processed, log: Log) -> Reading:
    """Compute the features of a recording. Log entries after the recording's last frame are ignored."""
    count = processed.num_frames
    nominal = distances(log, len(log.distance_m))[:count]
    inside = (processed.range_m >= NEAR_M) & (processed.range_m <= FAR_M)
    energy = envelope.target_energy(processed, nominal)
    in_gate, _ = gate_energies(processed.power, processed.range_m, nominal)
    centre = np.abs(processed.range_m - nominal[:, None]).argmin(axis=1)
    bins_away = np.abs(np.arange(len(processed.range_m)) - centre[:, None])[:, inside]
    room = bins_away > ROOM_BINS
    ratio = float("nan")
    if log.angle_rad is not None:
        ratio = envelope.harmonic_ratio(envelope.revolution(energy, log.angle_rad[:count]))
    return Reading(
        key=key,
        range_m=processed.range_m[inside],
        channels=processed.channels[..., inside],
        target=bins_away <= GATE_BINS,
        room=room,
        profile=processed.power[:, inside].mean(axis=0, dtype=np.float64),
        brightness_db=envelope.brightness_db(energy, nominal),
        room_db=decibels(float(np.sum(processed.power[:, inside], where=room, dtype=np.float64)) / count),
        multipath=multipath_share(processed.power, processed.range_m, nominal),
        harmonic_ratio=ratio,
        track_m=peak_track.around(processed, nominal, log.frame_rate_hz),
        energy=in_gate,
        noise_db=decibels(float(np.median(processed.noise_floor))),
        zero_db=decibels(float(processed.power[:, processed.range_m <= ZERO_M].mean())),
    )


def moved(reading: Reading, base: Reading) -> dict[str, float]:
    """Return the effect of a gap on each feature: its value in `reading` minus that in `base`, or for profiles the correlation of both.

    Differences of the tracked range are weighted by the energy in `base`, because the range of a weak target's peak jumps. The change of
    the complex signal is |reading - base| / |base| in decibels.
    """
    return {
        "target brightness (dB)": reading.brightness_db - base.brightness_db,
        "room level (dB)": reading.room_db - base.room_db,
        "multipath share": reading.multipath - base.multipath,
        "angular harmonic ratio": reading.harmonic_ratio - base.harmonic_ratio,
        "profile correlation": profile_correlation(reading.profile, base.profile, base.range_m, "db"),
        "track rms (mm)": 1e3 * float(np.sqrt(np.average((reading.track_m - base.track_m) ** 2, weights=base.energy))),
        "target change (dB)": change_db(reading, base, base.target),
        "room change (dB)": change_db(reading, base, base.room),
    }


def change_db(reading: Reading, base: Reading, mask: NDArray[np.bool_]) -> float:
    """Return the relative change |reading - base| / |base| of the complex signals in the cells of a mask (F, B), in decibels."""
    where = mask[:, None]
    difference = np.sum(np.abs(reading.channels - base.channels) ** 2, where=where, dtype=np.float64)
    return decibels(float(difference / np.sum(np.abs(base.channels) ** 2, where=where, dtype=np.float64)))


def profile_difference_db(reading: Reading, base: Reading) -> float:
    """Return the rms difference of the two mean range profiles in decibels, over bins within SPAN_DB of the strongest bin of `base`."""
    strong = base.profile >= base.profile.max() * 10 ** (-SPAN_DB / 10)
    return float(np.sqrt(np.mean((10 * np.log10(reading.profile[strong] / base.profile[strong])) ** 2)))


def decibels(power: float) -> float:
    """Convert a power ratio to decibels; values below LOWEST_DB become LOWEST_DB."""
    return 10 * float(np.log10(max(power, 10 ** (LOWEST_DB / 10))))
