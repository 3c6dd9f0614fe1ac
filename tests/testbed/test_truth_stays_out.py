"""Truth and twin are independent: by imports, and by the products that a gap's strength changes."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import radartwin
from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import Case
from radartwin.config.compose import compose
from radartwin.io.progress import Progress
from radartwin.store.digest import import_closure, spec_digest
from radartwin.store.products import Product

TESTBED = ("testbed", "variation", "motion_errors", "fixtures")
TRUTHS = ("materials", "roughness", "contents", "clutter", "hardware", "trajectory", "placement", "solver")
PACKAGE = Path(radartwin.__file__).parent


@pytest.mark.parametrize("module", TESTBED)
def test_testbed_imports_no_scan_label_or_settings(module):
    forbidden = (
        "radartwin.label", "radartwin.reconstruct", "radartwin.config", "radartwin.builders",
    )  # fmt: skip
    code = f"import sys, radartwin.testbed.{module}; sys.exit(' '.join(m for m in sys.modules if m.startswith({forbidden})) or None)"
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def imports(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield from (node.module, *(f"{node.module}.{alias.name}" for alias in node.names))
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def test_packages_of_the_twin_do_not_import_the_testbed():
    truth = tuple(f"radartwin.testbed.{name}" for name in TESTBED)
    for folder in ("label", "reconstruct", "scene", "materials", "simulation", "radar", "features"):
        for path in (PACKAGE / folder).rglob("*.py"):
            assert not [name for name in imports(path) if name.startswith(truth)], path


class Store:
    """Records the requested specifications and makes nothing."""

    def __init__(self):
        self.requested = {}

    def key(self, kind, spec, roots):
        return spec_digest([kind, spec])

    def fetch(self, kind, spec, roots, build):
        self.requested[kind] = spec
        return Product(Path(), spec_digest([kind, spec]), False)


CASE = Case("corner_reflector", "lab", "turntable", 1.0)


def requested(config, domain):
    store = Store()
    Campaign(config, store, Progress(quiet=True)).clean(domain, CASE)  # pyright: ignore[reportArgumentType]
    return spec_digest(store.requested["clean"])


@pytest.mark.parametrize("gap", TRUTHS)
def test_gap_of_the_truth_leaves_the_twin_unchanged(gap):
    """Neither its simulation nor its scan changes; the measured domain does."""
    base = ["experiment=environment", "measured=testbed", "materials=uniform", "profile=quick"]
    one, two = (compose([*base, f"measured.gap.{gap}={s}"]) for s in (0, 2))
    for domain in ("twin", "void"):
        assert requested(one, domain) == requested(two, domain)
    assert requested(one, "measured") != requested(two, "measured")


def test_gap_of_the_scan_changes_only_the_twin():
    base = ["experiment=environment", "measured=testbed", "materials=uniform", "profile=quick"]
    one, two = (compose([*base, f"measured.gap.geometry={s}"]) for s in (0, 2))
    assert requested(one, "measured") == requested(two, "measured")
    assert requested(one, "twin") != requested(two, "twin")
    assert requested(one, "void") == requested(two, "void")


def test_truth_and_twin_of_a_campaign_do_not_import_each_other():
    assert not import_closure(("experiments.campaign.truth",)) & {"experiments.campaign.twin", "experiments.scans.virtual_scan"}
    assert not import_closure(("experiments.campaign.twin",)) & {"experiments.campaign.truth", "radartwin.testbed.testbed"}
