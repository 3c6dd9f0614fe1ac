"""Depth for frames that have none, from one picture at a time: metric depth models of the transformers library.

    frames = Frames.load(folder, colour_only=True)
    model = DepthModel.load("depth-anything/Depth-Anything-V2-Metric-Indoor-Small-hf")    # or a folder with the weights
    mesh, report = fuse(with_depth(frames, model), scale=model.scale)

The weights are the user's choice; nothing is downloaded unless a name of the hub is given. Lengths come from the model, not from a
measurement: metric models are off by several per cent, and by another factor for every camera, so the report says where the scale is
from. Only torch and transformers are needed: pictures are resized and normalised here, because the library's fast processors want
torchvision.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from radartwin.errors import BackendError, MissingError, ScanError
from radartwin.io import untrusted_json
from radartwin.reconstruct.frames.frames import Frame, Frames, rescaled

DEPTH_WIDTH = 320  # pixels of the depth that is kept: models resolve little more
METRIC_TYPES = {"zoedepth", "glpn", "depth_pro"}  # architectures whose output is metres, always
IMAGENET_MEAN, IMAGENET_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
DEFAULT_HEIGHT = 518  # Depth Anything's, 37 patches of 14

Estimator = Callable[[np.ndarray], np.ndarray]  # colour (H, W, 3) uint8 -> depth (h, w) metres of the same view


@dataclasses.dataclass(frozen=True, eq=False)
class DepthModel:
    """A metric depth model, ready to be called with a picture.

    Attributes:
        network: the transformers model. name: what the user called it.
        mean, std: of the normalisation. height: pixels the network sees. multiple: its sides are multiples of it.
    """

    network: Any
    name: str
    mean: tuple[float, ...] = IMAGENET_MEAN
    std: tuple[float, ...] = IMAGENET_STD
    height: int = DEFAULT_HEIGHT
    multiple: int = 14

    @classmethod
    def load(cls, name: str | Path) -> DepthModel:
        """From a folder with config.json and weights, or a name of the hub.

        Raises:
            BackendError: torch or transformers is not installed.
            MissingError: no such folder or model.
            ScanError: the model gives relative depth, which has no scale.
        """
        try:
            import torch  # noqa: F401 - transformers' own message without it is long
            from transformers import AutoConfig, AutoModelForDepthEstimation  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            raise BackendError(f"depth from single pictures needs {error.name}; pip install 'radartwin[mono]'") from error
        if not Path(name).is_dir() and (Path(name).is_absolute() or str(name).count("/") != 1):
            raise MissingError(f"{name}: no such folder of weights; give one with config.json, or a model's name like owner/model")
        try:
            config = AutoConfig.from_pretrained(str(name))
            _check_metric(config, str(name))
            network = AutoModelForDepthEstimation.from_pretrained(str(name), use_safetensors=True).eval()
        except OSError as error:
            raise MissingError(f"{name}: no depth model ({str(error).splitlines()[0]}); check name, folder and network") from error
        except ValueError as error:
            if isinstance(error, ScanError):
                raise
            raise ScanError(f"{name}: not a depth model of transformers ({str(error).splitlines()[0]}); choose another") from error
        backbone = getattr(config, "backbone_config", None) or config
        return cls(network, str(name), **_processing(Path(name)), multiple=int(getattr(backbone, "patch_size", 14) or 14))

    @property
    def scale(self) -> str:
        """For `fuse(scale=...)`."""
        return f"estimated by {Path(self.name).name}, not measured"

    def __call__(self, colour: np.ndarray) -> np.ndarray:
        """Depth (h, w) float32 metres, at the network's own resolution.

        Raises:
            ScanError: the network's answer is not finite.
        """
        import torch
        from PIL import Image

        height = max(round(min(self.height, colour.shape[0]) / self.multiple), 1) * self.multiple
        width = max(round(height * colour.shape[1] / colour.shape[0] / self.multiple), 1) * self.multiple
        small = np.asarray(Image.fromarray(colour).resize((width, height), Image.Resampling.BICUBIC), dtype=np.float32) / 255
        pixels = ((small - np.array(self.mean, np.float32)) / np.array(self.std, np.float32)).transpose(2, 0, 1)
        with torch.inference_mode():
            depth = self.network(pixel_values=torch.from_numpy(np.ascontiguousarray(pixels))[None]).predicted_depth[0]
        out = depth.float().numpy()
        if not np.isfinite(out).all():
            raise ScanError(f"{self.name}: the network's depth is not finite; are the weights whole?")
        return np.squeeze(out)


def with_depth(frames: Frames, estimate: Estimator) -> Frames:
    """The frames that have colour, with depth estimated from it (read, and estimated, again at every access).

    Args:
        estimate: a `DepthModel`, or anything that gives metric depth of the same view.
    Raises:
        ScanError: no frame has colour.
    """
    chosen = [i for i, frame in enumerate(frames) if frame.colour is not None]
    if not chosen:
        raise ScanError(f"{frames.source}: no frame has colour, so there is nothing to estimate depth from")
    kept: dict[int, np.ndarray] = {}

    def read(index: int) -> Frame:
        frame = frames[chosen[index]]
        assert frame.colour is not None
        assert frame.colour_intrinsics is not None
        if index not in kept:
            kept[index] = _sized(estimate(frame.colour))
        depth = kept[index]
        lens = rescaled(frame.colour_intrinsics, frame.colour.shape[1::-1], depth.shape[::-1])
        return dataclasses.replace(frame, depth_m=depth, intrinsics=lens, confidence=None)

    return Frames([frames.names[i] for i in chosen], frames.poses[chosen], read, frames.source, frames.scan_of)


def _sized(depth: np.ndarray) -> np.ndarray:
    from PIL import Image

    width = min(DEPTH_WIDTH, depth.shape[1])
    height = max(round(depth.shape[0] * width / depth.shape[1]), 1)
    resized = np.asarray(Image.fromarray(depth.astype(np.float32)).resize((width, height), Image.Resampling.BILINEAR))
    return np.maximum(resized, 0).astype(np.float32)


def _check_metric(config: Any, name: str) -> None:
    metric = config.model_type in METRIC_TYPES or getattr(config, "depth_estimation_type", None) == "metric"
    if not metric:
        raise ScanError(f"{name}: {config.model_type} of relative depth has no scale; choose a metric model (Depth Anything V2 Metric)")


def _processing(folder: Path) -> dict[str, Any]:
    """What preprocessor_config.json beside the weights says of normalisation and size, if it is there."""
    file = folder / "preprocessor_config.json"
    if not file.is_file():
        return {}
    try:
        content = untrusted_json.read(file)
        size = content.get("size") or {}
        found: dict[str, Any] = {
            "mean": tuple(content.get("image_mean", IMAGENET_MEAN)),
            "std": tuple(content.get("image_std", IMAGENET_STD)),
        }
        return found | ({"height": int(size["height"])} if isinstance(size, dict) and "height" in size else {})
    except (ValueError, TypeError, AttributeError) as error:
        raise ScanError(f"{file}: damaged ({error}); copy the model's files again") from error
