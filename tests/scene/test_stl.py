"""A .stl repeats the corners of every triangle. The reader joins them, so that a round object is smooth as from any other format."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from radartwin.errors import MeshError
from radartwin.scene import objects
from radartwin.scene.layouts.stock import from_mesh
from radartwin.scene.mesh_file import read_meshes
from radartwin.scene.surface import Surface


@pytest.mark.parametrize("kind", ["stl", "stl_ascii"])
def test_a_sphere_is_the_same_solid_from_stl_and_from_obj(kind: str, tmp_path: Path) -> None:
    sphere = objects.sphere(0.05)
    content: Any = sphere.export(file_type=kind)
    (tmp_path / "ball.stl").write_bytes(content if isinstance(content, bytes) else content.encode())
    (mesh,) = read_meshes(tmp_path / "ball.stl").values()
    assert len(mesh.faces) == len(sphere.faces)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(sphere.volume, rel=1e-4)  # the file stores single precision or few digits
    assert Surface(mesh, "metal", "ball").is_curved()
    (surface,) = from_mesh(tmp_path / "ball.stl", "metal")
    np.testing.assert_allclose(surface.mesh.bounds, [[-0.05, -0.05, 0], [0.05, 0.05, 0.1]], atol=1e-4)


def test_a_stl_without_triangles_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.stl").write_bytes(b"solid nothing\nendsolid nothing\n")
    with pytest.raises(MeshError, match=r"empty\.stl"):
        from_mesh(tmp_path / "empty.stl", "metal")
