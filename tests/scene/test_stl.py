"""A .stl repeats the corners of every triangle. The reader joins them, so that a round object is smooth as from any other format."""

from pathlib import Path

import numpy as np
import pytest

from radartwin.scene import objects
from radartwin.scene.layouts.stock import from_mesh
from radartwin.scene.mesh_file import read_meshes


@pytest.mark.parametrize("kind", ["stl", "stl_ascii"])
def test_a_sphere_is_the_same_solid_from_stl(kind: str, tmp_path: Path) -> None:
    sphere = objects.sphere(0.05)
    sphere.export(tmp_path / "ball.stl", file_type=kind)
    (mesh,) = read_meshes(tmp_path / "ball.stl").values()
    assert (len(mesh.faces), mesh.is_watertight) == (len(sphere.faces), True)
    assert mesh.volume == pytest.approx(sphere.volume, rel=1e-4)  # the file stores single precision or few digits
    (surface,) = from_mesh(tmp_path / "ball.stl", "metal")
    assert surface.is_curved()
    np.testing.assert_allclose(surface.mesh.bounds, [[-0.05, -0.05, 0], [0.05, 0.05, 0.1]], atol=1e-4)
