"""InternVL through transformers: a tiny model with random weights is saved, loaded and asked; only its answers are noise."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest

from radartwin.errors import ConfigError, MissingError
from radartwin.label.local import BEGIN, END, TOKEN, Local, _prepared
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
    """InternVL of some thousand weights with a byte tokenizer."""
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


def test_noise_is_asked_three_times_and_becomes_other(weights: Path, question: Question) -> None:
    provider = Local(str(weights), max_new_tokens=6)
    [(asked, record)] = provider.answers([question])
    assert asked is question
    assert record.answer.material == "other"
    assert record.answer.invalid
    assert record.answer.attempts == 3
    assert (record.provider, record.model, record.images) == ("local", str(weights), question.images)


def test_words_of_the_network_are_read_as_an_answer(weights: Path, question: Question, monkeypatch: pytest.MonkeyPatch) -> None:
    provider = Local(str(weights))
    said = json.dumps({"material": "stone", "confidence": 0.7, "reason": "grey"})
    seen = {}

    def generate(**inputs):
        import torch

        seen.update(inputs)
        words = provider._tokenizer(said, return_tensors="pt")["input_ids"]
        return torch.cat([inputs["input_ids"], words], dim=1)

    monkeypatch.setattr(provider._network, "generate", generate)
    [(_, record)] = provider.answers([question])
    assert (record.answer.material, record.answer.confidence, record.answer.attempts) == ("stone", 0.7, 1)
    token = provider._tokenizer.convert_tokens_to_ids(TOKEN)
    assert (seen["input_ids"] == token).sum() == 2 * 4, "two pictures of (56/14)^2 patches, four to a token"
    assert seen["pixel_values"].shape == (2, 3, 56, 56)
    assert question.text in provider._tokenizer.decode(seen["input_ids"][0])


def test_the_pictures_reach_the_network(weights: Path, question: Question) -> None:
    import torch

    provider = Local(str(weights))
    features = provider._network.get_image_features(torch.zeros(2, 3, 56, 56)).pooler_output
    assert features.shape[:2] == (2, 4)
    shown = torch.from_numpy(np.stack([_prepared(crop.jpeg, (56, 56)) for crop in question.crops]))
    assert not torch.allclose(provider._network.get_image_features(shown).pooler_output, features)


def test_a_picture_is_normalised_as_imagenet() -> None:
    from PIL import Image

    stream = io.BytesIO()
    Image.new("RGB", (64, 48), (124, 116, 104)).save(stream, "JPEG", quality=95)  # ImageNet's mean colour
    prepared = _prepared(stream.getvalue(), (28, 28))
    assert prepared.shape == (3, 28, 28)
    assert np.abs(prepared).max() < 0.03


def test_missing_weights_and_other_models_are_named(tmp_path: Path) -> None:
    from transformers import CLIPConfig  # pyright: ignore[reportMissingImports]

    with pytest.raises(ConfigError, match="needs --model FOLDER"):
        Local(None)
    (tmp_path / "none").mkdir()
    with pytest.raises(MissingError, match="none holds no InternVL weights"):
        Local(str(tmp_path / "none"))
    CLIPConfig().save_pretrained(tmp_path / "clip")
    with pytest.raises(ConfigError, match="clip is a clip model; --provider local runs InternVL"):
        Local(str(tmp_path / "clip"))
