"""Truth and twin are independent in their imports and in the stored results that each gap of the testbed changes."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from experiments.campaign import truth
from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import Case
from radartwin.config.compose import compose
from radartwin.config.config import Config
from radartwin.config.study import GapConfig
from radartwin.io.progress import Progress
from radartwin.radar.antenna_errors import AntennaErrors
from radartwin.radar.dca1000 import frame_shape
from radartwin.source_files import closure
from radartwin.store.digest import spec_digest
from radartwin.store.products import Product

TRUTHS = ("materials", "roughness", "contents", "clutter", "antenna", "hardware", "trajectory", "placement", "solver")
CASE = Case("corner_reflector", "lab", "turntable", 1.0)


def test_truth_and_twin_do_not_import_each_other_and_the_testbed_no_scan_label_or_settings():
    forbidden = ("radartwin.label", "radartwin.reconstruct", "radartwin.config", "radartwin.builders")
    modules = tuple(f"radartwin.testbed.{name}" for name in ("testbed", "variation", "motion_errors", "fixtures", "unscanned"))
    assert not [name for name in closure(modules) if name.startswith(forbidden)]
    assert not closure(("experiments.campaign.truth",)) & {"experiments.campaign.twin", "experiments.scans.virtual_scan"}
    assert not closure(("experiments.campaign.twin",)) & {"experiments.campaign.truth", "radartwin.testbed.testbed"}


class Store:
    """This store records which specifications a test requests, and computes nothing."""

    def __init__(self):
        self.requested = {}

    def key(self, kind, spec, roots):
        return spec_digest([kind, spec])

    def fetch(self, kind, spec, roots, build):
        self.requested[kind] = spec
        return Product(Path(), spec_digest([kind, spec]), False)


@pytest.fixture(scope="module")
def base() -> Config:
    return compose(["experiment=environment", "measured=testbed", "materials=uniform", "profile=quick"])


def changed_domains(base: Config, gap: str) -> set[str]:
    """Return the domains (measured or simulated) whose simulation changes if the strength of a deviation changes from 0 to 2."""

    def requested(strength: float, domain: str) -> str:
        store = Store()
        config = replace(base, measured=replace(base.measured, gap=replace(GapConfig(), **{gap: strength})))
        Campaign(config, store, Progress(quiet=True)).clean(domain, CASE)  # pyright: ignore[reportArgumentType]
        return spec_digest(store.requested["clean"])

    return {domain for domain in ("measured", "twin", "void") if requested(0.0, domain) != requested(2.0, domain)}


@pytest.mark.parametrize("gap", [*TRUTHS, "geometry"])
def test_gap_changes_the_twin_if_it_is_of_the_scan_and_else_the_measured_domain(base, gap):
    assert changed_domains(base, gap) == {"twin" if gap == "geometry" else "measured"}


@pytest.mark.parametrize("strength", [0.0, 2.0])
def test_antennas_deviate_only_in_the_truth(base, strength, monkeypatch):
    """The radar that the truth simulates is the nominal radar at strength 0. The recording always holds the nominal radar."""
    places = []

    def moved(case, place, seed, root, shadow):
        places.append(place)
        return np.zeros((1, *frame_shape(place.radar)), np.complex64)

    monkeypatch.setattr(truth, "_moved", moved)
    off = GapConfig(**{f.name: 0.0 for f in fields(GapConfig)})
    config = replace(base, measured=replace(base.measured, gap=replace(off, antenna=strength)))
    made = truth.record(Case("corner_reflector", "squash_court", "depth", 1.0), config)
    assert made.radar.antenna_errors is None
    assert places[0].radar.antenna_errors == AntennaErrors().scaled(strength)
    assert replace(places[0].radar, antenna_errors=None) == made.radar
