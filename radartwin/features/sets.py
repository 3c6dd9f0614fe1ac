"""Define the feature sets as lists of the names of their feature families.

The module imports no NumPy, so that the configuration can import it without delay. A feature family is a group of features that are
computed together (radartwin/features/families.py). A feature set lists the families for one kind of motion and follows the section
"motion-specific feature design" of the RadarTwin paper. A rotation shows the target's shape from all sides. A drive along the line of sight
("depth") shows range and multipath. A drive past the target, at right angles to the line of sight ("lateral"), shows the target over a
limited span of viewing angles. The family brightness depends on the material of the target. Another package may provide a feature set as an
entry point of the group `radartwin.features` (docs/extending.md). The families that such a feature set adds are named SET/FAMILY.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from radartwin import plugins
from radartwin.errors import ConfigError

if TYPE_CHECKING:
    import numpy as np

    from radartwin.features.processed import Processed

# The feature vector of a set contains the families in the listed order.
SETS: dict[str, tuple[str, ...]] = {
    "rotation": ("harmonics", "envelope", "extent", "brightness"),
    "depth": ("track", "multipath", "window", "extent", "brightness"),
    "lateral": ("harmonics", "envelope", "multipath", "window", "extent", "brightness"),
    "raw": ("profile",),
}


@dataclass(frozen=True)
class FeatureSet:
    """A feature set of another package.

    Attributes:
        families: names of the families in the order of the feature vector: built-in families, and names in `functions`.
        functions: function of each family that the package adds. Such a function takes a processed recording and the target's range (F,) in
            metres, and returns feature values by name, each (F,) or a scalar. The feature of a recording is the mean over its F frames.
        turntable: True if the target is on a turntable; the target's range is then the nominal range, and otherwise the tracked range.
    """

    families: tuple[str, ...]
    functions: Mapping[str, Callable[[Processed, np.ndarray], Mapping[str, Any]]] = field(default_factory=dict)
    turntable: bool = False


def feature_set(name: str) -> tuple[str, ...]:
    """Return the names of all families of a feature set.

    Raises:
        ConfigError: the feature set is unknown. PluginError: a plug-in of this name cannot be used.
    """
    plugin = plugins.find(plugins.FEATURES, name, SETS)
    if plugin is not None:
        provided = plugged_in(plugin)
        return tuple(f"{name}/{family}" if family in provided.functions else family for family in provided.families)
    if name not in SETS:
        raise ConfigError(f"features.name={name} is unknown; options: {', '.join([*SETS, *plugins.names(plugins.FEATURES)])}")
    return SETS[name]


def plugged_in(plugin: plugins.Plugin) -> FeatureSet:
    """Return the feature set of a plug-in. Raises PluginError if its object is no feature set of known families."""
    provided = plugins.load(plugin)
    if not isinstance(provided, FeatureSet):
        raise plugins.refusal(plugin, f"{plugin.value} is no radartwin.features.sets.FeatureSet")
    known = {family for families in SETS.values() for family in families}
    unknown = [family for family in provided.families if family not in known and family not in provided.functions]
    if unknown or not provided.families or known & set(provided.functions):
        reason = f"its families must be among {', '.join(sorted(known))}, or be functions with other names in the attribute functions"
        raise plugins.refusal(plugin, f"family '{unknown[0]}' is unknown; {reason}" if unknown else reason)
    return provided


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
    known = feature_set(name)
    for family in without:
        if family not in known:
            raise ConfigError(f"features.without: {family} is not in features={name}, which has {', '.join(known)}")
    remaining = tuple(family for family in known if family not in without)
    if not remaining:
        raise ConfigError(f"features.without excludes every family of features={name}; keep one of {', '.join(known)}")
    return remaining
