"""Plug-ins of an installed package are found by name, count in run keys, and their mistakes are one line with exit status 2."""

from __future__ import annotations

import csv
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from radartwin import plugins, source_files
from radartwin.config import plugged
from radartwin.config.compose import compose
from radartwin.config.config import SCHEMAS
from radartwin.config.plugged import GROUPS
from radartwin.errors import ConfigError
from radartwin.label.material_sources import material_source
from radartwin.plugins import PluginError
from radartwin.recognize.learners import LEARNERS, learner
from radartwin.runs.run import run_key
from radartwin.store import digest

PACKAGE = Path(__file__).resolve().parents[1] / "plugin_package"
NAMES = {
    plugins.SIMULATORS: "echoes", plugins.MATERIALS: "by_height", plugins.FEATURES: "decay", plugins.ENCODERS: "nearest",
    plugins.EXPERIMENTS: "level",
}  # fmt: skip


@pytest.fixture(scope="module")
def target(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("installed")
    offline = ["--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check", "--quiet"]
    subprocess.run([sys.executable, "-m", "pip", "install", *offline, "--target", str(folder), str(PACKAGE)], check=True)
    yield folder
    digest.forget()


def clear() -> None:
    """Forget what this process has learned of plug-ins."""
    from hydra.core.config_store import ConfigStore

    for group, options in SCHEMAS.items():
        for option in [name for name, schema in options.items() if schema.__module__ == "radartwin.config.plugged"]:
            del options[option]
            ConfigStore.instance().repo[group].pop(f"{option}.yaml", None)
    for group, entry_points in GROUPS.items():
        stored = ConfigStore.instance().repo.get(group, {})
        for name in (NAMES[entry_points], "clashing", "broken"):
            stored.pop(f"{name}.yaml", None)
    for name in [module for module in sys.modules if module.partition(".")[0] in ("radartwin_example", "other_package")]:
        del sys.modules[name]
    plugins.load.cache_clear()
    plugins._installed.cache_clear()
    plugged._schema.cache_clear()
    source_files._tops.difference_update({"radartwin_example", "other_package"})


@pytest.fixture
def installed(target: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.syspath_prepend(target)
    clear()
    yield target
    clear()


def distribution(folder: Path, package: str, group: str, entry: str, module: str = "") -> None:
    """Write an installed package with one entry point."""
    info = folder / f"{package.replace('-', '_')}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{group}]\n{entry}\n")
    if module:
        (folder / "other_package.py").write_text(module)


def test_every_group_finds_its_name_without_an_import(installed: Path) -> None:
    for group in plugins.GROUPS:
        assert plugins.names(group) == [NAMES[group]]
        entry = plugins.find(group, NAMES[group])
        assert entry is not None
        assert entry.package == "radartwin-example"
    assert "radartwin_example" not in sys.modules


def test_simulator_is_found_by_name_and_gives_the_radar_equation(installed: Path, inside: Callable) -> None:
    """The echo of a cross-section of 2 m^2 at distance d is lambda sqrt(sigma/(4 pi)^3)/d^2. The gain of an isotropic antenna is 1.

    The only surface is the plate of 10 cm at 1.7 m. The plug-in puts the echo at the nearest vertex, and all four vertices are corners.
    """
    done = inside(
        "simulate", "scene=plate", "trajectory=static", "trajectory.distance_m=1.7", "simulator=echoes", "simulator.cross_section_m2=2",
        "radar.element=isotropic",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    from radartwin.radar.recording import Recording

    recording = Recording.load("outputs/recordings/plate")
    assert recording.provenance["simulator"] == "echoes"
    assert recording.provenance["cross_section_m2"] == 2
    radar, distance_m = recording.radar, np.sqrt(1.7**2 + 0.05**2 + 0.05**2)
    expected = 299_792_458.0 / radar.center_frequency_hz * np.sqrt(2 / (4 * np.pi) ** 3) / distance_m**2
    window = np.hanning(radar.num_samples)
    # 16 times as many bins as samples, so that the peak is within 1e-3 of the level between bins.
    spectrum = np.abs(np.fft.fft(recording.iq * window, 16 * radar.num_samples)) / window.sum()
    np.testing.assert_allclose(spectrum.max(axis=-1), expected, rtol=5e-3)  # the file holds 16-bit samples


def test_materials_are_found_by_name(installed: Path, inside: Callable) -> None:
    words = ["simulate", "scene=lab", "scene.detail=shell", "scene.target=none", "trajectory=static", "simulator=echoes"]
    done = inside(*words, "materials=by_height", "materials.above=glass")
    assert done.returncode == 0, done.stderr
    assert "glass on 7, concrete on 1; materials=by_height" in done.stderr
    assert material_source("by_height", above="wood").name == "by_height"


def test_experiment_and_features_are_found_by_name(installed: Path, inside: Callable) -> None:
    words = ["run", "experiment=level", "simulator=echoes", "features=decay", "tracking=off"]
    done = inside(*words)
    assert done.returncode == 0, done.stderr
    assert "level: 1 row (no verdicts)" in done.stdout
    again = inside(*words)
    assert "simulated 0, reused 1" in again.stdout
    config = compose(words[1:])
    assert (config.scene.name, config.experiment.module) == ("void", "radartwin_example.level"), "OVERRIDES chose the scene"
    without = compose([*words[1:], "features.without=[extent]"])
    assert without.features.without == ["extent"]


def test_encoder_is_found_by_name(installed: Path) -> None:
    made = learner("nearest")
    assert made.reads == "features"
    from experiments.recognition import encoder_comparison

    assert encoder_comparison.methods()["nearest"] == ("nearest", "radar_description")
    assert encoder_comparison.identity()["encoders"].keys() == {"nearest"}
    with pytest.raises(ConfigError, match="choose one of network, convolution, trees, nearest"):
        learner("forest")


def test_benchmark_scores_a_plug_in(installed: Path, inside: Callable) -> None:
    done = inside("benchmark", "--method", "echoes", "--problem", "near")
    assert done.returncode == 0, done.stderr
    (row,) = csv.DictReader(Path("outputs/benchmark/leaderboard.csv").read_text().splitlines())
    assert (row["method"], row["problem"]) == ("echoes", "near")


def test_run_key_depends_on_the_code_of_the_plug_in(installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ["experiment=level", "simulator=echoes"]
    before = run_key(compose(words))
    assert run_key(compose([*words, "simulator.cross_section_m2=3"])) != before
    copy = tmp_path / "copy"
    for path in installed.rglob("*"):
        if path.is_file() and "__pycache__" not in path.parts:
            (copy / path.relative_to(installed)).parent.mkdir(parents=True, exist_ok=True)
            (copy / path.relative_to(installed)).write_bytes(path.read_bytes())
    source = copy / "radartwin_example" / "echoes.py"
    source.write_text(source.read_text().replace("1.0", "1.5"))
    monkeypatch.setattr(sys, "path", [str(copy), *(folder for folder in sys.path if folder != str(installed))])
    clear()
    digest.forget()
    assert run_key(compose(words)) != before
    digest.forget()


def test_worker_process_reads_a_configuration_with_plug_ins(installed: Path) -> None:
    config = compose(["simulator=echoes", "simulator.cross_section_m2=4", "materials=by_height", "features=decay"])
    code = "import pickle, sys; c = pickle.load(sys.stdin.buffer); print(c.simulator.settings(), c.materials.arguments(0), c.features.name)"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(installed), *sys.path])}
    done = subprocess.run([sys.executable, "-c", code], input=pickle.dumps(config), capture_output=True, check=True, env=environment)
    assert done.stdout.decode().startswith("{'cross_section_m2': 4.0, 'label': None} {'below_m': 0.05, 'above': 'plasterboard'} decay")


HEAD = "import dataclasses\nimport typing\n"
BACKEND = (
    "@dataclasses.dataclass\nclass Thing:\n    settings: S = S()\n    name = 'broken'\n    def paths(self, *a, **o):\n        return 1\n"
)
SETTINGS = "@dataclasses.dataclass(frozen=True)\nclass S:\n    "
SIMULATE, STATIC = ["simulate", "simulator=broken"], ["simulate", "scene=plate", "trajectory=static", "simulator=broken"]
RUN, ECHOES = ["run", "experiment=broken", "tracking=off"], ["simulate", "scene=plate", "trajectory=static", "simulator=echoes"]
SIMULATORS, MATERIALS, FEATURES, EXPERIMENTS = plugins.SIMULATORS, plugins.MATERIALS, plugins.FEATURES, plugins.EXPERIMENTS
BUILT_IN = "plug-in '{1}' of package other-package ({0}) has the name of a built-in option"
TWICE = "packages other-package and radartwin-example both provide '{1}' in {0}"
BROKEN = "plug-in 'broken' of package other-package"
# command, words of the message, and the group, the name and the code of a plug-in of another package
FAULTS: dict[str, tuple[list[str], str] | tuple[list[str], str, str, str, str]] = {
    "unknown name": (["simulate", "simulator=echo"], "did you mean echoes?"),
    "unknown key": (["simulate", "simulator=echoes", "simulator.foo=1"], "there is no configuration key 'simulator.foo'"),
    "wrong value": (["simulate", "simulator=echoes", "simulator.cross_section_m2=big"], "simulator.cross_section_m2"),
    "digest": (["simulate", "simulator=echoes", "simulator.code=1"], "digest of the plug-in's source code and cannot be set"),
    "failure": ([*ECHOES, "simulator.label=broken"], "plug-in 'echoes' of package radartwin-example (radartwin.simulators) cannot be used: "
                "paths raised RuntimeError: the solver broke (echoes.py, line 24)"),
    "other family": (["run", "experiment=level", "features=decay", "features.without=[window]"], "window is not in features=decay"),
    "built-in simulator": (["simulate", "simulator=points"], BUILT_IN, SIMULATORS, "points", ""),
    "built-in material": (["simulate", "materials=uniform"], BUILT_IN, MATERIALS, "uniform", ""),
    "built-in features": (["simulate", "features=raw"], BUILT_IN, FEATURES, "raw", ""),
    "built-in experiment": (["run", "experiment=validation"], BUILT_IN, EXPERIMENTS, "validation", ""),
    "built-in method": (["benchmark", "--method", "points"], BUILT_IN, SIMULATORS, "points", ""),
    "plug-in of two packages": (["simulate", "simulator=echoes"], TWICE, SIMULATORS, "echoes", ""),
    "method of two packages": (["benchmark", "--method", "echoes"], TWICE, SIMULATORS, "echoes", ""),
    "import": (SIMULATE, "its import raised ValueError: first;", SIMULATORS, "broken", "raise ValueError('first\\nsecond')"),
    "exit": (["simulate", "materials=broken"], "its import raised SystemExit: 7", MATERIALS, "broken", "raise SystemExit(7)"),
    "absent": (SIMULATE, "its import raised AttributeError", SIMULATORS, "broken", "x = 1"),
    "no class": (SIMULATE, "is no class with a method paths", SIMULATORS, "broken", "Thing = 1"),
    "no default": (SIMULATE, "the setting 'a' needs a default value", SIMULATORS, "broken",
                   f"{HEAD}{SETTINGS}a: int\n{BACKEND.replace('S()', 'S(1)')}"),
    "type": (SIMULATE, "the setting 'a' must be int", SIMULATORS, "broken", f"{HEAD}{SETTINGS}a: complex = 1j\n{BACKEND}"),
    "taken": (SIMULATE, "the setting 'elements' has the name of a key", SIMULATORS, "broken",
              f"{HEAD}{SETTINGS}elements: str = ''\n{BACKEND}"),
    "paths": (STATIC, "paths raised TypeError", SIMULATORS, "broken", f"{HEAD}{SETTINGS}a: int = 1\n{BACKEND}"),
    "benchmark": (["benchmark", "--method", "broken"], "its import raised ZeroDivisionError", SIMULATORS, "broken", "1/0"),
    "materials": (["simulate", "materials=broken"], "is no dataclass with name = 'broken'", MATERIALS, "broken", "Thing = 1"),
    "features": (["simulate", "features=broken"], "is no radartwin.features.sets.FeatureSet", FEATURES, "broken", "Thing = 1"),
    "family": (["simulate", "features=broken"], "family 'speed' is unknown", FEATURES, "broken",
               "from radartwin.features.sets import FeatureSet\nThing = FeatureSet(('speed',))"),
    "experiment": (["run", "experiment=broken"], "is no module with a function run", EXPERIMENTS, "broken", "Thing = 1"),
    "run": (RUN, "run raised ZeroDivisionError: division by zero (other_package.py, line 2)", EXPERIMENTS, "broken",
            "def run(*_):\n    1 / 0"),
    "result": (RUN, "the experiment returned int and not", EXPERIMENTS, "broken", "def run(*_):\n    return 3"),
    "identity": (RUN, "identity raised ZeroDivisionError", EXPERIMENTS, "broken", "def run(*_): ...\ndef identity():\n    1 / 0"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_is_one_line_that_names_the_package(
    fault: str, installed: Path, tmp_path: Path, inside: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    words, message, *other = FAULTS[fault]
    if other:
        group, name, code = other
        distribution(tmp_path / "site", "other-package", group, f"{name} = other_package{'' if words is RUN else ':Thing'}", code)
        monkeypatch.syspath_prepend(tmp_path / "site")
        message = message.format(group, name)
    done = inside(*words)
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1), done.stderr
    assert message in done.stderr
    assert BROKEN in done.stderr or other[1:2] != ["broken"]
    if fault in ("import", "exit"):
        assert inside(*ECHOES).returncode == 0, "other plug-ins still work"


def test_encoder_clash_is_an_error(installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    distribution(tmp_path / "site", "other-package", plugins.ENCODERS, f"{next(iter(LEARNERS))} = other_package:Thing")
    monkeypatch.syspath_prepend(tmp_path / "site")
    with pytest.raises(PluginError, match="has the name of a built-in option"):
        learner(next(iter(LEARNERS)))


def test_features_of_a_plug_in_match_their_definition(installed: Path) -> None:
    """Behind the target, the profile falls by 5 dB per metre, so the slope is -5."""
    from radartwin.features.families import frames, vector
    from radartwin.features.log import Nominal
    from radartwin.features.processed import process
    from radartwin.radar.chirp import Radar
    from radartwin.radar.recording import Recording

    axis = np.arange(256) * Radar.iwr1843().range_resolution_m
    echoes = np.fft.ifft(10 ** (-(5.0 * axis) / 20)) * 256
    seen = process(Recording(np.broadcast_to(echoes.astype(np.complex64), (2, 16, 2, 4, 256)), Radar.iwr1843()))
    nominal = Nominal(10.0, np.ones(2), np.zeros(2))
    names, values = vector(seen, nominal, "decay")
    assert values[names.index("decay_db_per_m")] == pytest.approx(-5.0, abs=0.1)  # the Hann window rounds the profile
    assert "brightness_db" in names
    rows = frames(seen, nominal, "decay")[1]
    assert rows[:, 0] == pytest.approx([-5.0, -5.0], abs=0.1)
    assert vector(seen, nominal, "decay", ["decay/slope"])[0] == [name for name in names if name != "decay_db_per_m"]
