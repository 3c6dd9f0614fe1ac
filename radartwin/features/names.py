"""Names of the feature sets and of the families each is made of; light, for the configuration.

A family is a few features that are read together (radartwin/features/sets.py says how). Paper, motion-specific feature design: rotation
exposes shape by the whole turn, depth range and multipath, lateral a slice of aspects; brightness carries the material in all of them.
"""

from __future__ import annotations

from collections.abc import Sequence

from radartwin.errors import ConfigError

# In the order of their values.
SETS: dict[str, tuple[str, ...]] = {
    "rotation": ("harmonics", "envelope", "extent", "brightness"),
    "depth": ("track", "multipath", "window", "extent", "brightness"),
    "lateral": ("harmonics", "envelope", "multipath", "window", "extent", "brightness"),
    "raw": ("profile",),
}


def families(name: str, without: Sequence[str] = ()) -> tuple[str, ...]:
    """Families of a set less those left out.

    Raises:
        ConfigError: an unknown set or family, or nothing is left.

    >>> families("depth", ["window", "brightness"])
    ('track', 'multipath', 'extent')
    """
    if name not in SETS:
        raise ConfigError(f"features.name={name} is not known; options: {', '.join(SETS)}")
    for family in without:
        if family not in SETS[name]:
            raise ConfigError(f"features.without: {family} is not in features={name}, which has {', '.join(SETS[name])}")
    left = tuple(family for family in SETS[name] if family not in without)
    if not left:
        raise ConfigError(f"features.without leaves nothing of features={name}; keep one of {', '.join(SETS[name])}")
    return left
