"""Well-formed malicious files run no code, reach no file outside their folder, and are refused in one line."""

from __future__ import annotations

import ast
import hashlib
import json
import pickle
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign import photo_index, textured
from PIL import Image

from radartwin.config.compose import Composer
from radartwin.errors import ConfigError, InputError, LabelError, OutputError, RecordingError, UserError
from radartwin.io import files
from radartwin.label.journal import Journal
from radartwin.label.photos import load_photos
from radartwin.radar.captures import load_capture
from radartwin.radar.chirp import Radar
from radartwin.recognize.model import Recogniser
from radartwin.reconstruct.frames.folder import load_own
from radartwin.reconstruct.frames.layouts import load_frames
from radartwin.runs.experiment import read
from radartwin.scene import rooms
from radartwin.scene.mesh_file import MeshWarning, read_meshes
from radartwin.scene.scene import Scene
from radartwin.scene.viewer.page import view
from radartwin.store.products import Product, save_json

ROOT = Path(__file__).resolve().parents[2]
Command = Callable[..., subprocess.CompletedProcess[str]]
OWNED = "owned"


class Evil:
    """The pickle of this object calls the function `open` as soon as Python loads the pickle."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return open, (str(self.mark), "w")


@pytest.fixture
def mark(tmp_path: Path) -> Iterator[Path]:
    """Return the path of a file that exists only if the code of an attack has run."""
    path = tmp_path / OWNED
    pickle.loads(pickle.dumps(Evil(path))).close()
    assert path.exists(), "the attack does not work, so the test shows nothing"
    path.unlink()
    yield path
    assert not path.exists(), "the code of the attack has run"


FORBIDDEN = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "shelve", "marshal", "tarfile"}
CALLS = {"eval", "exec", "compile", "__import__"}


@pytest.mark.parametrize("package", ["radartwin", "experiments", "analysis"])
def test_no_module_unpickles_evaluates_text_or_calls_a_shell(package: str) -> None:
    for path in sorted((ROOT / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            where = f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}"
            if isinstance(node, ast.Import | ast.ImportFrom):
                names = {alias.name.partition(".")[0] for alias in node.names} | {str(getattr(node, "module", "")).partition(".")[0]}
                assert not names & FORBIDDEN, where
            if not isinstance(node, ast.Call):
                continue
            called = ast.unparse(node.func)
            given = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
            assert called not in CALLS, where
            assert given.get("shell", "False") == "False", where
            if called in ("np.load", "numpy.load"):
                assert given.get("allow_pickle") == "False", where
            if called.startswith("yaml.") and "load" in called:
                assert called == "yaml.load", where
                assert "loader" in ast.unparse(node.args[1]), where
            if called.endswith(".from_pretrained") and "Model" in called:
                assert given.get("use_safetensors") == "True", where
            assert called not in ("torch.load", "pyfunc.load_model", "mlflow.pyfunc.load_model", "os.system", "os.popen"), where
            assert "trust_remote_code" not in given, where


def test_arrays_and_models_are_not_unpickled(tmp_path: Path, mark: Path) -> None:
    array = np.array([Evil(mark)], dtype=object)
    np.save(tmp_path / "a.npy", array, allow_pickle=True)
    np.savez(tmp_path / "a.npz", a=array)
    with pytest.raises(InputError, match=r"a\.npz"):
        files.read_arrays(tmp_path / "a.npz")
    with pytest.raises(RecordingError, match=r"a\.npy"):
        load_capture(tmp_path / "a.npy", Radar.iwr1843())
    content = pickle.dumps(Evil(mark))
    (tmp_path / "b.npy").write_bytes(content)
    with pytest.raises(RecordingError, match=r"b\.npy"):
        load_capture(tmp_path / "b.npy", Radar.iwr1843())
    (tmp_path / "model.json").write_text(json.dumps({"format": "radartwin recogniser 1", "sha256": hashlib.sha256(content).hexdigest()}))
    (tmp_path / "model.safetensors").write_bytes(content)
    with pytest.raises(InputError, match="not a usable model"):
        Recogniser.load(tmp_path)


@pytest.mark.parametrize(
    "node",
    [
        {"job_logging": {"version": 1, "handlers": {"x": {"()": "os.open", "path": OWNED, "flags": 65}}, "root": {"handlers": ["x"]}}},
        {"job_logging": {"version": 1, "handlers": {"x": {"class": "logging.os.open", "path": OWNED, "flags": 65}}}},
        {"hydra_logging": {"version": 1, "filters": {"x": {"()": "ext://os.open"}}}},
        {"job": {"env_set": {"PYTHONPATH": "/tmp/evil"}}},
        {"launcher": {"_target_": "radartwin.runs.dashboard.subprocess.Popen"}},
        {"launcher": {"_target_": "radartwin.runs.dashboard.os.system"}},
        {"callbacks": {"x": {"_target_": "os.system"}}},
        {"sweeper": {"_target_": "builtins.exec"}},
    ],
)
def test_an_experiment_file_cannot_make_hydra_call_code(node: dict[str, Any], tmp_path: Path, mark: Path) -> None:
    (tmp_path / "experiment").mkdir()
    content = {"experiment": {"name": "evil", "module": "evil"}, "hydra": node}
    (tmp_path / "experiment" / "evil.yaml").write_text(f"# @package _global_\n{json.dumps(content).replace(OWNED, str(mark))}\n")
    with pytest.raises(ConfigError, match="refused"):
        Composer([tmp_path]).compose(["experiment=evil", "seed=1"])


@pytest.mark.parametrize("override", ["hydra.launcher._target_=os.system", "+hydra.callbacks.x._target_=radartwinx.run"])
def test_an_override_cannot_make_hydra_call_code(override: str) -> None:
    with pytest.raises(ConfigError, match="_target_"):
        Composer().compose([override])


def frame_index(folder: Path, name: str) -> None:
    frame = {"name": "0", "pose": np.eye(4).tolist(), "intrinsics": np.eye(3).tolist(), "colour_intrinsics": None}
    frame |= {"depth": name, "colour": None, "confidence": None}
    content = {"format": "radartwin-frames", "version": 1, "depth_unit_m": 0.001, "frames": [frame]}
    (folder / "frames.json").write_text(json.dumps(content))


def tum_folder(folder: Path, name: str) -> None:
    (folder / "depth.txt").write_text(f"0.0 {name}\n")
    (folder / "groundtruth.txt").write_text("0.0 0 0 0 0 0 0 1\n")


INDICES: dict[str, tuple[Callable[[Path, str], object], Callable[[Path], object]]] = {
    "photos.json": (lambda folder, name: (folder / "photos.json").write_text(photo_index(name)), load_photos),
    "frames.json": (frame_index, lambda folder: load_own(folder, False)),
    "depth.txt": (tum_folder, lambda folder: load_frames(folder, (500, 500, 320, 240), up="z")),
}


@pytest.mark.parametrize("index", INDICES)
@pytest.mark.parametrize("path", ["up", "root", "link"])
def test_an_index_cannot_name_a_file_outside_its_folder(index: str, path: str, tmp_path: Path) -> None:
    write, reader = INDICES[index]
    folder, private = tmp_path / "foreign", tmp_path / "private.png"
    folder.mkdir()
    Image.fromarray(np.full((480, 640), 2000, np.uint16)).save(private)
    (folder / "link.png").symlink_to(private)
    write(folder, {"up": "../private.png", "root": str(private), "link": "link.png"}[path])
    with pytest.raises(UserError, match="outside this folder"):
        reader(folder)


@pytest.mark.parametrize("uri", ["../private.png", "{private}", "file://{private}", "link.png"])
def test_a_mesh_reads_no_picture_outside_its_folder(uri: str, tmp_path: Path) -> None:
    folder, private = tmp_path / "foreign", tmp_path / "private.png"
    folder.mkdir()
    Image.fromarray(np.full((8, 8, 3), 77, np.uint8)).save(private)
    (folder / "link.png").symlink_to(private)
    (folder / "a.glb").write_bytes(textured([{"uri": uri.format(private=private)}], b""))
    (folder / "b.mtl").write_text(f"newmtl m\nmap_Kd {uri.format(private=private)}\n")
    (folder / "b.obj").write_text("mtllib b.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n")
    for name in ("a.glb", "b.obj"):
        with pytest.warns(MeshWarning):
            (mesh,) = read_meshes(folder / name).values()
        visual: Any = mesh.visual
        material = getattr(visual, "material", None)
        assert getattr(material, "baseColorTexture", None) is None
        assert visual.kind == "vertex"  # the plain colour of the material
        assert getattr(material, "image", None) is None
    (folder / "c.obj").write_text("mtllib /dev/zero\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.warns(UserWarning, match="/dev/zero"):
        assert len(read_meshes(folder / "c.obj")) == 1


def test_a_journal_behind_a_link_does_not_change_the_linked_file(tmp_path: Path) -> None:
    thesis = tmp_path / "thesis"
    thesis.write_bytes(b"years of work without a line's end")
    (tmp_path / "scene").mkdir()
    (tmp_path / "scene" / "answers.jsonl").symlink_to(thesis)
    with pytest.raises(LabelError, match="is a symbolic link"):
        Journal(tmp_path / "scene" / "answers.jsonl")
    assert thesis.read_bytes() == b"years of work without a line's end"


def test_locks_and_writes_do_not_follow_links(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    (tmp_path / "lock").symlink_to(victim)
    with pytest.raises(OutputError, match="lock"), files.lock(tmp_path / "lock"):
        pass
    with pytest.raises(OutputError, match="lock"):
        files.drop_stale(tmp_path / "lock")
    target = tmp_path / "manifest.json"
    files.unfinished(target).symlink_to(victim)
    files.write_atomically(target, "mine")
    assert target.read_text() == "mine"
    assert not target.is_symlink()
    assert not victim.exists()


@pytest.mark.parametrize("name", ["../../../x", "/x", "a\0b"])
def test_a_foreign_cache_cannot_name_files_outside_its_folder(name: str, tmp_path: Path) -> None:
    content = {"table": "t", "rows": [], "metrics": {}, "keys": [], "figures": [name], "models": []}
    save_json(tmp_path, "result", content)
    with pytest.raises(InputError, match="not the result of a run"):
        read(Product(tmp_path, "0" * 32, True))
    from analysis.main import report_verb

    (tmp_path / "tables").mkdir()
    index = {"environment": {"run_key": "0", "profile": "quick", "figures": [name]}}
    (tmp_path / "tables" / "index.json").write_text(json.dumps(index))
    with pytest.raises(InputError, match="damaged"):
        report_verb(tmp_path)


def test_names_are_escaped_in_a_page_and_send_no_control_characters(tmp_path: Path, inside: Command) -> None:
    nasty = "</script><script>alert(1)</script>"
    surfaces = [replace(surface, name=nasty, provenance={"source": nasty}) for surface in rooms.lab().surfaces[:2]]
    view(Scene(surfaces, {"room": nasty}), tmp_path / "view.html")
    assert "<script>alert" not in (tmp_path / "view.html").read_text()
    done = inside("process", "\x1b]0;owned\x07\x1b[2J.bin")
    assert done.returncode == 2
    assert "\x1b" not in done.stderr
    assert "\x07" not in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_known_launchers_and_their_keys_are_accepted() -> None:
    assert Composer().launching(["hydra/launcher=joblib", "hydra.launcher.n_jobs=3"]) == ("joblib", {"n_jobs": 3}, "")
    keys = [f"hydra.launcher.{key}" for key in ("partition=gpu", "gpus_per_node=1", "mem_gb=32", "cpus_per_task=8", "array_parallelism=8")]
    assert Composer().launching(["hydra/launcher=slurm", *keys])[1]["gpus_per_node"] == 1
