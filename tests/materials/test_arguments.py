"""Arguments of the wrong type raise an error that names the argument."""

import numpy as np
import pytest
import trimesh

import radartwin as rt
from radartwin.errors import InputError, MaterialError
from radartwin.materials import Layered

BOX = trimesh.creation.box((0.1, 0.1, 0.1))
SCENE = rt.Scene([rt.Surface(BOX, "metal", "box")])
POSE = np.eye(4)[None]
POSE[0, 0, 3] = -1.0


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"scene": BOX}, "scene"),
        ({"radar": "iwr1843"}, "radar"),
        ({"sensor_poses": "x"}, "sensor_poses"),
        ({"sensor_poses": [[1, 2], [3]]}, "sensor_poses"),
        ({"sensor_poses": None}, "sensor_poses"),
        ({"motion": [1]}, "motion"),
        ({"motion": {"box": "x"}}, "motion of 'box'"),
        ({"motion": {5: POSE}}, "motion names surface 5"),
        ({"rays": "a"}, "rays"),
        ({"rays": 1e5}, "rays"),
        ({"rays": float("nan")}, "rays"),
        ({"rays": True}, "rays"),
        ({"max_bounces": 1.5}, "max_bounces"),
        ({"max_bounces": 0}, "max_bounces"),
        ({"seed": 1.5}, "seed"),
        ({"seed": -1}, "seed"),
        ({"rays": 10**12}, "rays must be a whole number from 1 to"),
        ({"rays_per_wavelength2": 1e300}, "rays_per_wavelength2"),
        ({"rays_per_wavelength2": "x"}, "rays_per_wavelength2"),
        ({"rays_per_wavelength2": np.inf}, "rays_per_wavelength2"),
        ({"rays_per_wavelength2": np.nan}, "rays_per_wavelength2"),
    ],
)
def test_simulate_names_the_wrong_argument(change, word):
    arguments = {"scene": SCENE, "radar": rt.Radar.iwr1843(), "sensor_poses": POSE} | change
    with pytest.raises(InputError, match=word) as caught:
        rt.simulate(**arguments)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"material": None}, "material"),
        ({"material": 5}, "material"),
        ({"material": Layered([])}, "reflects nothing"),
        ({"roughness_m": "x"}, "roughness_m"),
        ({"roughness_m": None}, "roughness_m"),
        ({"roughness_m": True}, "roughness_m"),
        ({"roughness_m": np.inf}, "roughness_m"),
    ],
)
def test_a_surface_names_the_wrong_field(change, word):
    with pytest.raises(InputError, match=word):
        rt.Surface(**({"mesh": BOX, "material": "metal"} | change))


def test_a_stack_without_layers_is_a_half_space():
    assert rt.Surface(BOX, Layered([], backing="concrete")).material == Layered([], backing="concrete")


@pytest.mark.parametrize("layers", [[5], ["ab"], [("wood",)], [("wood", "x")], [("wood", True)], [("wood", np.nan)]])
def test_an_invalid_layer_is_refused(layers):
    with pytest.raises(MaterialError, match="Layered"):
        Layered(layers)
