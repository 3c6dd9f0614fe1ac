"""Estimate depth from single pictures: the test loads tiny networks with random weights, and fuses pictures of known depth."""

import json

import numpy as np
import pytest
from made_files import refused

from radartwin.errors import MissingError, ScanError
from radartwin.reconstruct.fusion.fusion import fuse
from radartwin.reconstruct.fusion.monocular import DepthModel, with_depth
from radartwin.scene import rooms
from radartwin.testbed.scanner import Sensor, scan


def tiny(folder, kind: str):
    """Save a Depth Anything network with two layers of 32 channels and random weights."""
    torch = pytest.importorskip("torch", reason="torch is not installed; pip install 'radartwin[mono]'")
    transformers = pytest.importorskip("transformers", reason="transformers is not installed; pip install 'radartwin[mono]'")
    backbone = transformers.Dinov2Config(
        hidden_size=32, num_hidden_layers=4, num_attention_heads=2, mlp_ratio=2, image_size=56, patch_size=14,
        out_indices=[1, 2, 3, 4], reshape_hidden_states=False, apply_layernorm=True,
    )  # fmt: skip
    config = transformers.DepthAnythingConfig(
        backbone_config=backbone, patch_size=14, reassemble_hidden_size=32, neck_hidden_sizes=[8, 8, 8, 8], fusion_hidden_size=8,
        head_hidden_size=8, depth_estimation_type=kind, max_depth=20 if kind == "metric" else None,
    )  # fmt: skip
    torch.manual_seed(0)
    transformers.DepthAnythingForDepthEstimation(config).save_pretrained(folder)
    return folder


@pytest.fixture(scope="module")
def model_folder(tmp_path_factory):
    return tiny(tmp_path_factory.mktemp("model"), "metric")


@pytest.fixture(scope="module")
def lab():
    return scan(rooms.lab(detail="shell"), seed=1, frames=16, strength=0.0, sensor=Sensor(colour_size=(320, 240)))


def test_saved_network_estimates_metric_depth(model_folder):
    model = DepthModel.load(model_folder)
    depth = model(np.random.default_rng(0).integers(0, 255, (120, 160, 3)).astype(np.uint8))
    assert depth.ndim == 2
    assert depth.shape[1] / depth.shape[0] == pytest.approx(4 / 3, abs=0.15)
    assert ((depth >= 0) & (depth <= 20)).all()  # 20 m is the option max_depth of the network
    assert "not measured" in model.scale
    assert np.array_equal(depth, DepthModel.load(model_folder)(np.random.default_rng(0).integers(0, 255, (120, 160, 3)).astype(np.uint8)))


def test_preprocessor_file_sets_normalisation_and_size(model_folder):
    file = model_folder / "preprocessor_config.json"
    file.write_text(json.dumps({"image_mean": [0.1, 0.2, 0.3], "image_std": [1, 1, 1], "size": {"height": 70, "width": 70}}))
    model = DepthModel.load(model_folder)
    assert (model.mean, model.std, model.height, model.multiple) == ((0.1, 0.2, 0.3), (1, 1, 1), 70, 14)
    assert model(np.zeros((200, 200, 3), np.uint8)).shape == (70, 70)
    file.write_text("[")
    refused(["preprocessor_config.json: damaged"], DepthModel.load, model_folder, error=ScanError)
    file.unlink()


def test_estimated_depth_has_the_view_of_the_colour(model_folder, lab):
    frames, _ = lab
    filled = with_depth(frames[:2], DepthModel.load(model_folder))
    frame = filled[0]
    assert frame.depth_m.shape[1] <= 320
    assert frame.depth_m.any()
    assert frame.colour_intrinsics is not None
    # The same ray through the corner of either picture.
    depth_corner = (-0.5 - frame.intrinsics[:2, 2]) / np.diag(frame.intrinsics)[:2]
    colour_corner = (-0.5 - frame.colour_intrinsics[:2, 2]) / np.diag(frame.colour_intrinsics)[:2]
    assert np.allclose(depth_corner, colour_corner)


def test_estimated_depth_is_fused_and_its_scale_is_reported(lab):
    """The estimated depth is the true depth times 1.05, so that the fused mesh has the shape of the room times 1.05."""
    frames, truth = lab
    known = {f.colour.tobytes(): np.where(d > 0, 1.05 * d, 9).astype(np.float32) for f, d in zip(frames, truth.depth_m, strict=True)}
    mesh, report = fuse(
        with_depth(frames, lambda colour: known[colour.tobytes()]), voxel_m=0.05, refine=False, scale="estimated, not measured"
    )
    assert report.scale == "estimated, not measured"
    assert "estimated" in report.lines()[0]
    assert mesh.extents[2] == pytest.approx(1.05 * 2.8, abs=0.1)


def test_relative_and_missing_models_are_refused(tmp_path, model_folder):
    relative = tiny(tmp_path / "relative", "relative")
    refused(["relative depth, so lengths have no scale"], DepthModel.load, relative, error=ScanError)
    refused(["no such folder of weights"], DepthModel.load, tmp_path / "nowhere", error=MissingError)
    (tmp_path / "empty").mkdir()
    refused(["empty: no"], DepthModel.load, tmp_path / "empty", error=(MissingError, ScanError))
