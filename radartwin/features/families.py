"""Define the names of the feature sets and of their feature families.

The module imports no NumPy, so that the configuration can import it without delay. A feature family is a group of features that are
computed together (radartwin/features/sets.py). A feature set lists the families for one kind of motion and follows the section
"motion-specific feature design" of the RadarTwin paper. A rotation shows the target's shape from all sides. A drive along the line of
sight ("depth") shows range and multipath. A drive past the target, at right angles to the line of sight ("lateral"), shows the target over
a limited span of viewing angles. The family brightness depends on the material of the target.
"""

from __future__ import annotations

from collections.abc import Sequence

from radartwin.errors import ConfigError

# The feature vector of a set contains the families in the listed order.
SETS: dict[str, tuple[str, ...]] = {
    "rotation": ("harmonics", "envelope", "extent", "brightness"),
    "depth": ("track", "multipath", "window", "extent", "brightness"),
    "lateral": ("harmonics", "envelope", "multipath", "window", "extent", "brightness"),
    "raw": ("profile",),
}


def families(name: str, without: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the names of the feature families of a feature set, without the excluded families.

    Args:
        name: name of the feature set.
        without: names of the families to exclude.
    Raises:
        ConfigError: the feature set or a family is unknown, or no family remains.

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
