"""Estimate depth from single pictures: the test loads tiny networks with random weights, and fuses pictures of known depth."""

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
    return scan(rooms.lab(detail="shell"), seed=1, frames=16, strength=0.0, sensor=Sensor(colour_size=(160, 120)))


def test_saved_network_estimates_metric_depth_with_the_view_of_the_colour(model_folder, lab):
    model = DepthModel.load(model_folder)
    depth = model(np.random.default_rng(0).integers(0, 255, (120, 160, 3)).astype(np.uint8))
    assert depth.ndim == 2
    assert depth.shape[1] / depth.shape[0] == pytest.approx(4 / 3, abs=0.15)
    assert ((depth >= 0) & (depth <= 20)).all()  # 20 m is the option max_depth of the network
    assert "not measured" in model.scale
    frame = with_depth(lab[0][:2], model)[0]
    assert frame.colour_intrinsics is not None
    # The same ray through the corner of either picture.
    first, second = [(-0.5 - lens[:2, 2]) / np.diag(lens)[:2] for lens in (frame.intrinsics, frame.colour_intrinsics)]
    assert np.allclose(first, second)


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
