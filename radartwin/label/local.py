"""InternVL on this machine through transformers, from weights the user names: a folder, or a name that transformers finds.

The model class is the one transformers registers for its configuration (AutoModelForImageTextToText). Pictures are prepared here, as its
processor would with one tile each (resized to the model's square, ImageNet mean and deviation), because that processor needs torchvision,
which has no build beside this torch. Decoding is greedy, so the same weights give the same answer.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from radartwin.errors import BackendError, ConfigError, MissingError
from radartwin.label.journal import Record
from radartwin.label.provider import Turn, ask
from radartwin.label.questions import Question

if TYPE_CHECKING:
    import torch

MEAN, DEVIATION = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])  # of ImageNet
BEGIN, TOKEN, END = "<img>", "<IMG_CONTEXT>", "</img>"
MAX_NEW_TOKENS = 256


class Local:
    """The provider.

    Args:
        model: folder or name of InternVL weights in the transformers format (published ones end in -hf).
        max_new_tokens: of an answer.
    Raises:
        MissingError: transformers is not installed, or there are no such weights.
        ConfigError: no model is named, or one of another kind.
    """

    name = "local"

    def __init__(self, model: str | None, max_new_tokens: int = MAX_NEW_TOKENS) -> None:
        if not model:
            raise ConfigError("--provider local needs --model FOLDER: InternVL weights in the transformers format")
        try:
            from transformers import AutoConfig, AutoModelForImageTextToText, AutoTokenizer  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            raise MissingError("--provider local needs transformers and torch; pip install 'radartwin[local-vlm]'") from error
        self.model = model
        self._max_new_tokens = max_new_tokens
        try:
            config: Any = AutoConfig.from_pretrained(model)
        except (OSError, ValueError) as error:
            raise _no_weights(model, error) from error
        if config.model_type != "internvl":
            raise ConfigError(
                f"{model} is a {config.model_type} model; --provider local runs InternVL, others run behind --provider server"
            )
        try:
            self._tokenizer: Any = AutoTokenizer.from_pretrained(model)
            network: Any = AutoModelForImageTextToText.from_pretrained(model, dtype="auto", use_safetensors=True)
        except (OSError, ValueError) as error:
            raise _no_weights(model, error) from error
        self._network = network.to(_device()).eval()
        self._size = tuple(int(side) for side in config.vision_config.image_size)
        patch = config.vision_config.patch_size
        patches = (self._size[0] // patch[0]) * (self._size[1] // patch[1])
        self._tokens_per_picture = round(patches * config.downsample_ratio**2)

    def answers(self, questions: Sequence[Question]) -> Iterator[tuple[Question, Record]]:
        """Records one after the other.

        Raises:
            BackendError: the device ran out of memory.
        """
        import torch

        for question in questions:
            pictures = torch.from_numpy(np.stack([_prepared(crop.jpeg, self._size) for crop in question.crops]))
            try:
                answer = ask(question, lambda turns, shown=pictures: self._complete(shown, turns))
            except torch.OutOfMemoryError as error:
                raise BackendError(f"{self.model} does not fit into the memory of this device; use --provider server") from error
            yield question, Record.of(question, answer, self.model, self.name)

    def _complete(self, pictures: torch.Tensor, turns: Sequence[Turn]) -> str:
        """The model's next words."""
        import torch

        blocks = "".join(f"{BEGIN}{TOKEN * self._tokens_per_picture}{END}\n" for _ in range(len(pictures)))
        messages = [{"role": turn.role, "content": turn.text} for turn in turns]
        messages[0]["content"] = blocks + messages[0]["content"]
        encoded = self._tokenizer.apply_chat_template(messages, add_generation_prompt=True, tokenize=False)
        inputs = self._tokenizer(encoded, return_tensors="pt", add_special_tokens=False).to(self._network.device)
        with torch.inference_mode():
            out = self._network.generate(
                input_ids=inputs["input_ids"],
                attention_mask=inputs["attention_mask"],
                pixel_values=pictures.to(self._network.device, self._network.dtype),
                max_new_tokens=self._max_new_tokens,
                do_sample=False,
            )
        return self._tokenizer.decode(out[0, inputs["input_ids"].shape[1] :], skip_special_tokens=True)


def _prepared(jpeg: bytes, size: tuple[int, ...]) -> np.ndarray:
    """A picture as the network takes it: (3, height, width) float32."""
    from PIL import Image

    with Image.open(io.BytesIO(jpeg)) as picture:
        pixels = np.asarray(picture.convert("RGB").resize((size[1], size[0]), Image.Resampling.BICUBIC), np.float64) / 255
    return ((pixels - MEAN) / DEVIATION).transpose(2, 0, 1).astype(np.float32)


def _no_weights(model: str, error: Exception) -> MissingError:
    said = " ".join(str(error).split())[:200]
    return MissingError(f"{model} holds no InternVL weights that transformers can load, whose names end in -hf ({said})")


def _device() -> str:
    import torch

    return "cuda" if torch.cuda.is_available() else "cpu"
