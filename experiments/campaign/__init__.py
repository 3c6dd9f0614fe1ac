"""The recordings that the tables share, of the measured domain and of its twin, each made once, kept, and processed alike.

Names load on first use, so that what traces one domain (truth, twin) does not depend, and its key neither, on what else stands here.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from experiments.campaign.campaign import DOMAINS, Campaign
    from experiments.campaign.cases import Case, Log

_HOMES = {
    "DOMAINS": "experiments.campaign.campaign",
    "Campaign": "experiments.campaign.campaign",
    "Case": "experiments.campaign.cases",
    "Log": "experiments.campaign.cases",
}

__all__ = ["DOMAINS", "Campaign", "Case", "Log"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'experiments.campaign' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value
