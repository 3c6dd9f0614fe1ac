"""An argument of the wrong type raises an error that names the argument."""

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
TWO, THREE = np.repeat(POSE, 2, axis=0), np.repeat(POSE, 3, axis=0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"scene": BOX}, "scene must be"),
        ({"radar": "iwr1843"}, "radar must be"),
        ({"sensor_poses": [[1, 2], [3]]}, "sensor_poses must be numbers"),
        ({"sensor_poses": np.eye(3)[None]}, r"sensor_poses must have shape \(F, 4, 4\)"),
        ({"sensor_poses": np.zeros((0, 4, 4))}, "sensor_poses holds zero frames"),
        ({"sensor_poses": 2 * POSE}, "sensor_poses, frame 0: not a rigid pose"),
        ({"sensor_poses": np.full((1, 4, 4), np.nan)}, "sensor_poses, frame 0: not a rigid pose"),
        ({"sensor_poses": np.eye(4)[None]}, "inside surface 'box'"),
        ({"motion": [1]}, "motion must map"),
        ({"motion": {"box": "x"}}, "motion of 'box'"),
        ({"motion": {"nobody": POSE}}, "motion names surface 'nobody'"),
        ({"sensor_poses": TWO, "motion": {"box": THREE}}, r"sensor poses and motion have \[2, 3\] frames; give one number"),
        ({"rays": "a"}, "rays must be"),
        ({"rays": True}, "rays must be"),
        ({"rays": 10**12}, "rays must be a whole number from 1 to"),
        ({"max_bounces": 0}, "max_bounces must be"),
        ({"seed": -1}, "seed must be"),
        ({"rays_per_wavelength2": 1e300}, "rays_per_wavelength2 must be"),
        ({"rays_per_wavelength2": np.nan}, "rays_per_wavelength2 must be"),
        ({"elements": "spherical"}, "exact, planar"),
    ],
)
def test_simulate_names_the_wrong_argument(change, words):
    arguments = {"scene": SCENE, "radar": rt.Radar.iwr1843(), "sensor_poses": POSE} | change
    with pytest.raises(InputError, match=words) as caught:
        rt.simulate(**arguments)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"material": None}, "material"),
        ({"material": Layered([])}, "reflects nothing"),
        ({"roughness_m": "x"}, "roughness_m"),
        ({"roughness_m": True}, "roughness_m"),
        ({"roughness_m": np.inf}, "roughness_m"),
        ({"correlation_m": "x"}, "correlation_m"),
    ],
)
def test_a_surface_names_the_wrong_field(change, word):
    with pytest.raises(InputError, match=word):
        rt.Surface(**({"mesh": BOX, "material": "metal"} | change))


def test_a_stack_without_layers_is_a_half_space():
    assert rt.Surface(BOX, Layered([], backing="concrete")).material == Layered([], backing="concrete")


@pytest.mark.parametrize("layers", [["ab"], [("wood",)], [("wood", True)], [("wood", np.nan)]])
def test_an_invalid_layer_is_refused(layers):
    with pytest.raises(MaterialError, match="Layered"):
        Layered(layers)
