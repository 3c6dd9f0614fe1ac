"""The recordings that the tables share, of the measured domain and of its twin, each made once, kept, and processed alike.

Names load on first use, so that what traces one domain (truth, twin) does not depend, and its key neither, on what else stands here.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from experiments.campaigns.campaign import DOMAINS, Campaign
    from experiments.campaigns.cases import Case, Log

_HOMES = {
    "DOMAINS": "experiments.campaigns.campaign",
    "Campaign": "experiments.campaigns.campaign",
    "Case": "experiments.campaigns.cases",
    "Log": "experiments.campaigns.cases",
}

__all__ = ["DOMAINS", "Campaign", "Case", "Log"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'experiments.campaigns' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value
