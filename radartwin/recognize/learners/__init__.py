"""Learners of object classes, all with one interface: a two-layer network, a convolutional network, and gradient-boosted trees. Another
package adds a learner as an entry point of the group `radartwin.encoders`.
"""

from __future__ import annotations

from radartwin import plugins
from radartwin.errors import ConfigError
from radartwin.recognize.learners.convolution import Convolution
from radartwin.recognize.learners.interface import Fitted, Learner
from radartwin.recognize.learners.network import Network
from radartwin.recognize.learners.trees import Trees

LEARNERS: dict[str, Learner] = {"network": Network(), "convolution": Convolution(), "trees": Trees()}

__all__ = ["LEARNERS", "Convolution", "Fitted", "Learner", "Network", "Trees", "learner"]


def learner(name: str) -> Learner:
    """Return a learner before its training, by name. The object of a plug-in is a class that needs no arguments.

    Raises:
        ConfigError: the name is unknown. PluginError: a plug-in of this name cannot be used.

    >>> learner("trees").reads
    'features'
    """
    plugin = plugins.find(plugins.ENCODERS, name, LEARNERS)
    if plugin is None:
        if name not in LEARNERS:
            raise ConfigError(f"learner {name!r} is not known; choose one of {', '.join([*LEARNERS, *plugins.names(plugins.ENCODERS)])}")
        return LEARNERS[name]
    kind = plugins.load(plugin)
    with plugins.calling(plugin, f"{plugin.value}()"):
        made = kind()
    if getattr(made, "reads", None) not in ("features", "pictures") or not callable(getattr(made, "fit", None)):
        raise plugins.refusal(plugin, f"{plugin.value}() has no method fit, or reads is neither 'features' nor 'pictures'")
    return made
