"""A validation case: a claim about physics, the value of an independent reference, RadarTwin's value, and the limit of their difference."""

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

SPEED_OF_LIGHT = 299_792_458.0
FREQUENCY_HZ = 77e9
WAVELENGTH_M = SPEED_OF_LIGHT / FREQUENCY_HZ
WAVENUMBER = 2 * np.pi / WAVELENGTH_M
# Folder of reference tables beside the checkout. A case whose table is absent has no verdict.
REFERENCE = Path(__file__).resolve().parents[4] / "shared" / "reference"
OBJECTS = REFERENCE.parent / "data" / "objects"


@dataclass(frozen=True)
class Finding:
    """The result of a validation case, which compares RadarTwin `n` times with a reference."""

    # Reference and our value where they differ most, in the unit of the case; NaN if the claim is about many values at once.
    reference: float
    simulated: float
    error: float  # error that is compared with the limit, never negative
    n: int = 1  # number of comparisons


class Untestable(Exception):
    """Exception: a file or package that the case needs is absent. The message of the exception names the absent file or package."""


@dataclass(frozen=True)
class Case:
    """One validation case. Each validation case is one row of the validation table (card) and one physics test."""

    name: str  # unique, lower case with hyphens
    subject: str  # group of the card
    claim: str  # the claim in words, as the card shows it
    oracle: str  # how the reference value is computed, and its source
    metric: str  # the compared quantity, with unit
    limit: float  # largest error for which the claim holds
    unit: str  # unit of error and limit
    compare: Callable[[bool], Finding]  # the comparison. The argument True takes all sizes, seeds, angles and densities; False takes a few
    cost: str = "quick"  # "quick" cases run in every profile, "full" cases in the paper profile only


def db(power: Any) -> Any:
    """Convert a power to decibels (10 log10)."""
    return 10 * np.log10(power)


def worst(pairs: Sequence[tuple[float, float]]) -> Finding:
    """Return the finding of the (reference, RadarTwin) pair with the largest difference."""
    reference, simulated = max(pairs, key=lambda pair: abs(pair[1] - pair[0]))
    return Finding(reference, simulated, abs(simulated - reference), len(pairs))


def rms(differences: Sequence[float] | np.ndarray) -> Finding:
    """Return a finding whose error is the root mean square of differences that should be zero."""
    value = float(np.sqrt(np.mean(np.square(differences))))
    return Finding(0.0, value, value, len(differences))


def reference_rows(name: str) -> list[dict[str, str]]:
    """Return the rows of the reference table `name`. Raises Untestable if the file is absent."""
    path = REFERENCE / name
    if not path.is_file():
        raise Untestable(f"reference table {name} is missing")
    return list(csv.DictReader(path.read_text().splitlines()))
