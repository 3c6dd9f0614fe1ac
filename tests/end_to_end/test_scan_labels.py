"""The simulation uses the material labels in a scene folder, unless the user selects another material source."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
import trimesh

import radartwin as rt

POSE = np.eye(4)
POSE[:3, 3] = 1.0, 1.2, 1.0


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    """Return the mesh of an empty room of 4 x 3 x 2.5 m whose normals point into the room."""
    room = trimesh.creation.box(bounds=[[0, 0, 0], [4, 3, 2.5]]).subdivide().subdivide()
    room.invert()
    path = tmp_path / "room.glb"
    room.export(path)
    return path


def simulate(inside, folder: str, *more: str) -> tuple[rt.Recording, str]:
    done = inside(
        "simulate", "scene=scan", f"scene.path={folder}", "trajectory=static", "trajectory.frames=1", "trajectory.position_m=[1.0,1.2,1.0]",
        "simulator.rays=20000", *more, "--out", "made",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return rt.Recording.load("made"), done.stderr


def level_db(recording: rt.Recording) -> float:
    return float(10 * np.log10(np.mean(np.abs(recording.iq) ** 2)))


def test_labels_of_the_folder_are_simulated_unless_a_source_is_given(inside, scan: Path, tmp_path: Path) -> None:
    recordings = {}
    for material in ("metal", "plasterboard"):
        assert inside("reconstruct", scan, "--out", material, "--material", material).returncode == 0
        recordings[material], said = simulate(inside, material)
        assert f"materials of the room's 6 surfaces: {material} on 6; as labelled in {material} by uniform" in said
    again = rt.simulate(rt.Scene.load("plasterboard"), rt.Radar.iwr1843(), POSE[None], rays=20000)
    again.save(tmp_path / "again")
    assert (tmp_path / "again.bin").read_bytes() == (tmp_path / "made.bin").read_bytes()
    assert recordings["plasterboard"].scale == pytest.approx(again.scale)
    assert level_db(recordings["metal"]) - level_db(recordings["plasterboard"]) > 5  # plasterboard returns -9.8 dB at normal incidence
    provenance = recordings["metal"].provenance
    assert provenance["materials"] == {"source": "scene", "said_by": {"uniform": 6}, "surfaces": {"metal": 6}}
    digest = hashlib.sha256((tmp_path / "metal" / "manifest.json").read_bytes()).hexdigest()
    assert provenance["scene"] == {"name": "scan", "path": "metal", "manifest_sha256": digest}
    named, said = simulate(inside, "metal", "materials=uniform")
    assert "plasterboard on 6; materials=uniform; the labels in metal are not used" in said
    assert named.provenance["materials"]["source"] == "uniform"
    assert np.array_equal(named.iq, recordings["plasterboard"].iq)


def test_mesh_without_labels_needs_a_source(inside, scan: Path) -> None:
    done = inside("simulate", "scene=scan", f"scene.path={scan}", "trajectory=static", "--out", "x")
    assert done.returncode == 2
    assert "room.glb carries no material labels" in done.stderr
    assert "materials=uniform materials.material=NAME" in done.stderr
    viewed = inside("view", scan)
    assert viewed.returncode == 2
    assert f"radartwin reconstruct {scan} --out FOLDER --material NAME" in viewed.stderr
    assert "material=" not in viewed.stderr
    _, said = simulate(inside, "room.glb", "materials=uniform", "materials.material=concrete")
    assert "concrete on 1; materials=uniform" in said
