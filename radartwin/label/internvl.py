"""Answer material questions with the vision-language model InternVL on this machine, through the Python package transformers.

The weights of InternVL come from a local folder or from a transformers model name. The package transformers chooses the model class through
AutoModelForImageTextToText. This module prepares each picture as one tile: it resizes the picture to the square input of the model, and
normalises the picture with the mean and standard deviation of ImageNet. InternVL's own image processor prepares pictures in the same way,
but the processor needs torchvision, which has no build for the installed torch. The text decoding is greedy, so the same weights give the
same text.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from radartwin.errors import BackendError, ConfigError, MissingError
from radartwin.label.journal import Record
from radartwin.label.questions import Message, Question, ask

if TYPE_CHECKING:
    import torch

MEAN, DEVIATION = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])  # of red, green and blue in ImageNet
BEGIN, TOKEN, END = "<img>", "<IMG_CONTEXT>", "</img>"
MAX_NEW_TOKENS = 256


class InternVL:
    """A provider that answers material questions with InternVL on this machine.

    Args:
        model: folder or name of InternVL weights in the transformers format; names of weights published in this format end in -hf.
        max_new_tokens: largest length of a generated answer, in tokens.
    Raises:
        MissingError: transformers is not installed, or the model does not exist.
        ConfigError: the model is not InternVL.
    """

    name = "local"

    def __init__(self, model: str | None, max_new_tokens: int = MAX_NEW_TOKENS) -> None:
        if not model:
            raise ConfigError("--provider local needs --model FOLDER: InternVL weights in the transformers format")
        try:
            import torch
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
                f"{model} is a {config.model_type} model, but --provider local runs InternVL; use --provider server for other models"
            )
        try:
            self._tokenizer: Any = AutoTokenizer.from_pretrained(model)
            network: Any = AutoModelForImageTextToText.from_pretrained(model, dtype="auto", use_safetensors=True)
        except (OSError, ValueError) as error:
            raise _no_weights(model, error) from error
        self._network = network.to("cuda" if torch.cuda.is_available() else "cpu").eval()
        self._size = tuple(int(side) for side in config.vision_config.image_size)
        patch = config.vision_config.patch_size
        patches = (self._size[0] // patch[0]) * (self._size[1] // patch[1])
        self._tokens_per_picture = round(patches * config.downsample_ratio**2)

    def answers(self, questions: Sequence[Question]) -> Iterator[tuple[Question, Record]]:
        """Yield each material question together with the record of the model's answer."""
        import torch

        for question in questions:
            pictures = torch.from_numpy(np.stack([_prepared(crop.jpeg, self._size) for crop in question.crops]))
            try:
                answer = ask(question, lambda messages, pictures=pictures: self._complete(pictures, messages))
            except torch.OutOfMemoryError as error:
                raise BackendError(f"{self.model} does not fit into the memory of this device; use --provider server") from error
            yield question, Record.of(question, answer, self.model, self.name)

    def _complete(self, pictures: torch.Tensor, messages: Sequence[Message]) -> str:
        """Return the next message that the model generates in a conversation."""
        import torch

        blocks = "".join(f"{BEGIN}{TOKEN * self._tokens_per_picture}{END}\n" for _ in range(len(pictures)))
        first, *others = messages
        conversation = [{**first, "content": blocks + first["content"]}, *others]
        encoded = self._tokenizer.apply_chat_template(conversation, add_generation_prompt=True, tokenize=False)
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
    """Convert a JPEG picture to the network's input array, (3, height, width) float32."""
    from PIL import Image

    with Image.open(io.BytesIO(jpeg)) as picture:
        pixels = np.asarray(picture.convert("RGB").resize((size[1], size[0]), Image.Resampling.BICUBIC), np.float64) / 255
    return ((pixels - MEAN) / DEVIATION).transpose(2, 0, 1).astype(np.float32)


def _no_weights(model: str, error: Exception) -> MissingError:
    reason = " ".join(str(error).split())[:200]
    return MissingError(f"{model} has no InternVL weights that transformers can load ({reason}); give published weights that end in -hf")
