"""All validation cases, in the order of the card."""

from experiments.validation.oracles import dielectrics, energy, motion, near, rooms, sampling, targets
from experiments.validation.oracles.case import Case

SUBJECTS = ("targets", "near field", "rooms", "dielectrics", "energy", "motion", "samples")
CASES: tuple[Case, ...] = tuple(
    sorted(
        (case for module in (targets, near, rooms, dielectrics, energy, motion, sampling) for case in module.CASES),
        key=lambda case: SUBJECTS.index(case.subject),
    )
)
