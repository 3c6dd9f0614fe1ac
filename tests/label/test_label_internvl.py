"""The class `InternVL`, which asks a local vision-language model, with a tiny model of random weights."""

from __future__ import annotations

import dataclasses
import io
import json
from pathlib import Path

import pytest
from PIL import Image

from radartwin.errors import ConfigError, MissingError
from radartwin.label.internvl import BEGIN, END, TOKEN, InternVL
from radartwin.label.questions import Question, questions
from radartwin.scene import objects
from radartwin.scene.scene import Scene, Surface

transformers = pytest.importorskip("transformers", reason="transformers is not installed: pip install 'radartwin[local-vlm]'")
TEMPLATE = (
    "{% for message in messages %}<|im_start|>{{ message['role'] }}\n{{ message['content'] }}<|im_end|>\n{% endfor %}"
    "{% if add_generation_prompt %}<|im_start|>assistant\n{% endif %}"
)


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of an InternVL model with a few thousand weights and a byte tokenizer."""
    import torch
    from tokenizers import Tokenizer, decoders, models, pre_tokenizers  # pyright: ignore[reportMissingImports]
    from transformers import InternVLConfig, InternVLForConditionalGeneration, PreTrainedTokenizerFast  # pyright: ignore[reportMissingImports]

    alphabet = sorted(pre_tokenizers.ByteLevel.alphabet())
    tokenizer = Tokenizer(models.BPE(vocab={sign: k for k, sign in enumerate(alphabet)}, merges=[]))
    tokenizer.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=False)
    tokenizer.decoder = decoders.ByteLevel()
    alphabet_size = len(alphabet)
    special = ["<|im_start|>", "<|im_end|>", BEGIN, END, TOKEN]
    tokenizer.add_special_tokens(special)
    fast = PreTrainedTokenizerFast(tokenizer_object=tokenizer, eos_token="<|im_end|>", pad_token="<|im_end|>", chat_template=TEMPLATE)
    config = InternVLConfig(
        vision_config={
            "hidden_size": 16, "num_hidden_layers": 1, "num_attention_heads": 2, "intermediate_size": 16, "image_size": [56, 56],
            "patch_size": [14, 14],
        },
        text_config={
            "model_type": "qwen2", "hidden_size": 16, "intermediate_size": 16, "num_hidden_layers": 1, "num_attention_heads": 2,
            "num_key_value_heads": 2, "vocab_size": len(fast), "max_position_embeddings": 16384,
        },
        image_token_id=alphabet_size + 4, image_seq_length=4,
    )  # fmt: skip
    torch.manual_seed(0)
    folder = tmp_path_factory.mktemp("internvl")
    InternVLForConditionalGeneration(config).save_pretrained(folder)
    fast.save_pretrained(folder)
    return folder


@pytest.fixture(scope="module")
def question() -> Question:
    plate = Surface(objects.plate(2, 1), "concrete", "plate", role="room")
    return questions(Scene([plate]), views=2)[0]


@pytest.fixture
def inputs(weights: Path, monkeypatch: pytest.MonkeyPatch) -> dict:
    """Return the inputs that the neural network received. The network replies `inputs["reply"]`, or what its random weights say."""
    inputs: dict = {}
    network = transformers.InternVLForConditionalGeneration
    generated = network.generate

    def generate(self, **given):
        import torch

        inputs.update(given)
        if "reply" not in inputs:
            return generated(self, **given)
        reply = transformers.AutoTokenizer.from_pretrained(weights)(inputs["reply"], return_tensors="pt")["input_ids"]
        return torch.cat([given["input_ids"], reply], dim=1)

    monkeypatch.setattr(network, "generate", generate)
    return inputs


def test_reply_of_the_network_is_read_as_an_answer_and_three_invalid_replies_become_other(
    weights: Path, question: Question, inputs: dict
) -> None:
    [(asked, record)] = InternVL(str(weights), max_new_tokens=6).answers([question])
    assert asked is question
    assert (record.answer.material, record.answer.invalid, record.answer.attempts) == ("other", True, 3)
    assert (record.provider, record.model, record.images) == ("local", str(weights), question.images)
    inputs["reply"] = json.dumps({"material": "stone", "finish": "sandy", "confidence": 0.7, "reason": "grey"})
    [(_, record)] = InternVL(str(weights)).answers([question])
    assert (record.answer.material, record.answer.confidence, record.answer.attempts) == ("stone", 0.7, 1)
    tokenizer = transformers.AutoTokenizer.from_pretrained(weights)
    token = tokenizer.convert_tokens_to_ids(TOKEN)
    assert (inputs["input_ids"] == token).sum() == 2 * 4, "two pictures of (56/14)^2 patches, four patches per token"
    assert inputs["pixel_values"].shape == (2, 3, 56, 56)
    assert question.text in tokenizer.decode(inputs["input_ids"][0])
    stream = io.BytesIO()
    Image.new("RGB", (64, 48), (124, 116, 104)).save(stream, "JPEG", quality=95)  # the mean colour of ImageNet
    grey = dataclasses.replace(question.crops[0], jpeg=stream.getvalue())
    list(InternVL(str(weights)).answers([dataclasses.replace(question, crops=(grey,))]))
    assert inputs["pixel_values"].abs().max() < 0.03


def test_missing_weights_and_other_models_are_named(tmp_path: Path) -> None:
    from transformers import CLIPConfig  # pyright: ignore[reportMissingImports]

    with pytest.raises(ConfigError, match="needs --model FOLDER"):
        InternVL(None)
    (tmp_path / "none").mkdir()
    with pytest.raises(MissingError, match="none has no InternVL weights"):
        InternVL(str(tmp_path / "none"))
    CLIPConfig().save_pretrained(tmp_path / "clip")
    with pytest.raises(ConfigError, match="clip is a clip model, but --provider local runs InternVL"):
        InternVL(str(tmp_path / "clip"))
