"""Define the names of the feature sets and of their families. The module imports no NumPy, so that the configuration can import it.

A family is a group of features that are computed together (radartwin/features/sets.py). The sets follow the paper (motion-specific feature
design). A rotation shows the target's shape from all sides, a drive towards the target shows range and multipath, and a lateral drive shows
the target over a limited span of aspect angles. Brightness depends on the material.
"""

from __future__ import annotations

from collections.abc import Sequence

from radartwin.errors import ConfigError

# The feature vector has the families in this order.
SETS: dict[str, tuple[str, ...]] = {
    "rotation": ("harmonics", "envelope", "extent", "brightness"),
    "depth": ("track", "multipath", "window", "extent", "brightness"),
    "lateral": ("harmonics", "envelope", "multipath", "window", "extent", "brightness"),
    "raw": ("profile",),
}


def families(name: str, without: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the families of a set, without the excluded families.

    Raises:
        ConfigError: the set or a family is unknown, or no family remains.

    >>> families("depth", ["window", "brightness"])
    ('track', 'multipath', 'extent')
    """
    if name not in SETS:
        raise ConfigError(f"features.name={name} is unknown; options: {', '.join(SETS)}")
    for family in without:
        if family not in SETS[name]:
            raise ConfigError(f"features.without: {family} is not in features={name}, which has {', '.join(SETS[name])}")
    remaining = tuple(family for family in SETS[name] if family not in without)
    if not remaining:
        raise ConfigError(f"features.without excludes every family of features={name}; keep one of {', '.join(SETS[name])}")
    return remaining
