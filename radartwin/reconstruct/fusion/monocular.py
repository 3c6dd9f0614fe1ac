"""Estimate depth from single colour pictures with metric depth models of the transformers library.

    frames = load_frames(folder, colour_only=True)
    model = DepthModel.load("depth-anything/Depth-Anything-V2-Metric-Indoor-Small-hf")    # or a folder with the weights
    mesh, report = fuse(with_depth(frames, model), scale=model.scale)

The user chooses the model's weights. The weights are downloaded only if the user gives a name on the Hugging Face hub. All lengths of the
fused scan come from the model, not from a measurement. The lengths estimated by metric models have errors of several per cent that differ
between cameras. The fusion report therefore states that the unit of length comes from the model. This module resizes and normalises the
pictures itself, because the fast image processors of transformers need torchvision.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from radartwin.errors import BackendError, MissingError, ScanError
from radartwin.io import untrusted_json
from radartwin.reconstruct.frames.frames import Frame, Frames, rescaled

DEPTH_WIDTH = 320  # width in pixels of the estimated depth picture that is kept; the models hardly resolve finer details
METRIC_TYPES = {"zoedepth", "glpn", "depth_pro"}  # model types of transformers whose output is always in metres
IMAGENET_MEAN, IMAGENET_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
DEFAULT_HEIGHT = 518  # input height of Depth Anything: 37 patches of 14 pixels

Estimator = Callable[[np.ndarray], np.ndarray]  # colour (H, W, 3) uint8 -> depth (h, w) metres of the same view


@dataclasses.dataclass(frozen=True, eq=False)
class DepthModel:
    """A depth model that is loaded into memory and estimates depth in metres.

    Attributes:
        network: model object of the transformers library.
        name: name or folder of the model, as given by the user.
        mean, std: mean and standard deviation that normalise each colour channel of the input picture.
        height: height in pixels of the input picture of the network.
        multiple: number of pixels that divides the height and the width of the input picture.
    """

    network: Any
    name: str
    mean: tuple[float, ...] = IMAGENET_MEAN
    std: tuple[float, ...] = IMAGENET_STD
    height: int = DEFAULT_HEIGHT
    multiple: int = 14

    @classmethod
    def load(cls, name: str | Path) -> DepthModel:
        """Load a model from a folder with config.json and weights, or by a name on the Hugging Face hub.

        Raises:
            BackendError: the package transformers or torch is not installed.
            MissingError: no folder or model with the given name exists.
            ScanError: the model estimates relative depth, which has no unit of length.
        """
        try:
            import torch  # noqa: F401 - a missing torch gives a shorter message here than in transformers
            from transformers import AutoConfig, AutoModelForDepthEstimation  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            raise BackendError(f"depth from single pictures needs {error.name}; run pip install 'radartwin[mono]'") from error
        if not Path(name).is_dir() and (Path(name).is_absolute() or str(name).count("/") != 1):
            raise MissingError(f"{name}: no such folder of weights; give a folder with config.json, or a model name such as owner/model")
        try:
            config = AutoConfig.from_pretrained(str(name))
            metric = config.model_type in METRIC_TYPES or getattr(config, "depth_estimation_type", None) == "metric"
            network = AutoModelForDepthEstimation.from_pretrained(str(name), use_safetensors=True).eval() if metric else None
        except OSError as error:
            reason = str(error).splitlines()[0]
            raise MissingError(f"{name}: no depth model ({reason}); check the name, the folder and the network") from error
        except ValueError as error:
            raise ScanError(f"{name}: not a depth model of transformers ({str(error).splitlines()[0]}); choose another") from error
        if network is None:
            reason = f"{config.model_type} gives relative depth, so lengths have no scale"
            raise ScanError(f"{name}: {reason}; choose a metric model (Depth Anything V2 Metric)")
        backbone = getattr(config, "backbone_config", None) or config
        return cls(network, str(name), **_processing(Path(name)), multiple=int(getattr(backbone, "patch_size", 14) or 14))

    @property
    def scale(self) -> str:
        """Text for `fuse(scale=...)` that names the model as the source of the unit of length."""
        return f"estimated by {Path(self.name).name}, not measured"

    def __call__(self, colour: np.ndarray) -> np.ndarray:
        """Estimate the depth (h, w), float32 metres at the network's resolution, of a colour picture (H, W, 3) uint8."""
        import torch

        height = max(round(min(self.height, colour.shape[0]) / self.multiple), 1) * self.multiple
        width = max(round(height * colour.shape[1] / colour.shape[0] / self.multiple), 1) * self.multiple
        small = np.asarray(Image.fromarray(colour).resize((width, height), Image.Resampling.BICUBIC), dtype=np.float32) / 255
        pixels = ((small - np.array(self.mean, np.float32)) / np.array(self.std, np.float32)).transpose(2, 0, 1)
        with torch.inference_mode():
            depth = self.network(pixel_values=torch.from_numpy(np.ascontiguousarray(pixels))[None]).predicted_depth[0]
        out = depth.float().numpy()
        if not np.isfinite(out).all():
            raise ScanError(f"{self.name}: the estimated depth is not finite; copy the weights again")
        return np.squeeze(out)


def with_depth(frames: Frames, estimate: Estimator) -> Frames:
    """Return the frames that have a colour picture, with the depth that `estimate`, such as a `DepthModel`, returns for this picture."""
    coloured = [i for i, frame in enumerate(frames) if frame.colour is not None]
    if not coloured:
        raise ScanError(f"{frames.source}: no frame has colour, so depth cannot be estimated; scan again with pictures")
    cache: dict[int, np.ndarray] = {}

    def read(index: int) -> Frame:
        frame = frames[coloured[index]]
        assert frame.colour is not None
        assert frame.colour_intrinsics is not None
        if index not in cache:
            cache[index] = _sized(estimate(frame.colour))
        depth = cache[index]
        intrinsics = rescaled(frame.colour_intrinsics, frame.colour.shape[1::-1], depth.shape[::-1])
        return dataclasses.replace(frame, depth_m=depth, intrinsics=intrinsics, confidence=None)

    return Frames([frames.names[i] for i in coloured], frames.poses[coloured], read, frames.source, frames.scan_of)


def _sized(depth: np.ndarray) -> np.ndarray:
    width = min(DEPTH_WIDTH, depth.shape[1])
    height = max(round(depth.shape[0] * width / depth.shape[1]), 1)
    resized = np.asarray(Image.fromarray(depth.astype(np.float32)).resize((width, height), Image.Resampling.BILINEAR))
    return np.maximum(resized, 0).astype(np.float32)


def _processing(folder: Path) -> dict[str, Any]:
    """Read the colour normalisation and the input size from preprocessor_config.json in the folder of the weights, if this file exists."""
    file = folder / "preprocessor_config.json"
    if not file.is_file():
        return {}
    try:
        content = untrusted_json.read(file)
        size = content.get("size") or {}
        settings: dict[str, Any] = {
            "mean": tuple(content.get("image_mean", IMAGENET_MEAN)),
            "std": tuple(content.get("image_std", IMAGENET_STD)),
        }
        return settings | ({"height": int(size["height"])} if isinstance(size, dict) and "height" in size else {})
    except (ValueError, TypeError, AttributeError) as error:
        raise ScanError(f"{file}: damaged ({error}); copy the model's files again") from error
