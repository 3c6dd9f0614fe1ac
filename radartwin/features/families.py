"""Names of the feature sets and their families; imports no NumPy, so that the configuration can use it.

A family is a few features that are computed together (radartwin/features/sets.py). Paper, motion-specific feature design: rotation exposes
the shape over a whole turn, depth exposes range and multipath, lateral exposes a slice of aspects. Brightness carries the material.
"""

from __future__ import annotations

from collections.abc import Sequence

from radartwin.errors import ConfigError

# The order is that of the feature values.
SETS: dict[str, tuple[str, ...]] = {
    "rotation": ("harmonics", "envelope", "extent", "brightness"),
    "depth": ("track", "multipath", "window", "extent", "brightness"),
    "lateral": ("harmonics", "envelope", "multipath", "window", "extent", "brightness"),
    "raw": ("profile",),
}


def families(name: str, without: Sequence[str] = ()) -> tuple[str, ...]:
    """The families of a set without the excluded families.

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
