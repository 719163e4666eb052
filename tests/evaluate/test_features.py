"""Feature networks by name: the one that ships, and the real classes of the others with small random weights."""

from __future__ import annotations

import json
import string
import warnings
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn

from paintit.errors import PaintitError, UsageError
from paintit.evaluate.classifier import load_classifier
from paintit.evaluate.features import load_network

IMAGES = (torch.rand(5, 3, 40, 40, generator=torch.Generator().manual_seed(0)) * 255).to(torch.uint8)


class Scripted(nn.Module):
    """Answers as the published TorchScript does: pictures of 0 to 255, features where they are asked for."""

    def __init__(self) -> None:
        super().__init__()
        self.layer = nn.Linear(3, 7)

    def forward(self, images: Tensor, return_features: bool = False) -> Tensor:
        features = self.layer(images.mean((2, 3)) / 255)
        return features if return_features else features.softmax(1)


def save_scripted(path: Path) -> Scripted:
    with torch.random.fork_rng(), warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of torch.jit, which the published file is made with
        torch.manual_seed(0)
        net = Scripted()
        torch.jit.script(net).save(str(path))  # type: ignore[attr-defined]
    return net


def save_clip(folder: Path) -> None:
    from transformers import CLIPConfig, CLIPModel, CLIPTokenizer

    words = [*string.ascii_lowercase, *(letter + "</w>" for letter in string.ascii_lowercase)]
    vocabulary = {word: i for i, word in enumerate([*words, "<|startoftext|>", "<|endoftext|>"])}
    size = {"hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 2, "num_attention_heads": 2}
    last = len(vocabulary) - 1
    text = {"vocab_size": last + 1, "max_position_embeddings": 24, "eos_token_id": last, "bos_token_id": last - 1}
    with torch.random.fork_rng():
        torch.manual_seed(0)
        net = CLIPModel(
            CLIPConfig(
                text_config=size | text, vision_config=size | {"image_size": 32, "patch_size": 8}, projection_dim=12
            )
        )
    net.save_pretrained(folder)
    (folder / "vocab.json").write_text(json.dumps(vocabulary))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    CLIPTokenizer(str(folder / "vocab.json"), str(folder / "merges.txt"), model_max_length=24).save_pretrained(folder)


def test_the_classifier_ships_and_says_how_good_it_is() -> None:
    classifier = load_classifier()
    assert len(classifier.classes) == 34
    assert {"red brick", "zebra", "polished gold"} <= {*classifier.classes}
    assert 0.75 < classifier.accuracy < 1
    assert classifier.net.head.out_features == 34


def test_pocket_features_have_the_network_s_name_and_are_the_same_every_time() -> None:
    network = load_network("pocket")
    features = network.features(IMAGES)
    assert (network.name, features.shape, features.dtype) == ("pocket", (5, 128), torch.float32)
    assert torch.equal(features, network.features(IMAGES))
    assert torch.allclose(network.features(IMAGES[3:]), features[3:], atol=1e-5)


def test_resizing_smooths() -> None:
    network = load_network("pocket")
    checks = (torch.arange(250)[:, None] + torch.arange(250)) % 2 * 255
    small = network._resized(checks.to(torch.uint8).expand(1, 3, 250, 250))
    assert small.shape == (1, 3, 64, 64)
    assert float((small - 0.5).abs().max()) < 0.05


def test_inception_is_read_from_its_published_form(tmp_path: Path) -> None:
    net = save_scripted(tmp_path / "inception.pt")
    network = load_network("inception", str(tmp_path / "inception.pt"))
    assert (network.name, network.dimensions, network.side) == ("inception", 7, 299)
    flat = torch.full((1, 3, 299, 299), 51, dtype=torch.uint8)
    assert torch.allclose(network.features(flat), net.layer(torch.full((1, 3), 0.2)), atol=1e-5)
    assert network.features(IMAGES).shape == (5, 7)


def test_clip_reads_pictures_and_words(tmp_path: Path) -> None:
    save_clip(tmp_path)
    network = load_network("clip", str(tmp_path))
    assert (network.name, network.dimensions, network.side) == ("clip", 12, 32)
    assert network.features(IMAGES).shape == (5, 12)
    assert network.words is not None
    texts = network.words(["red brick", "a zebra", "red brick"])
    assert torch.allclose(texts[0], texts[2], atol=1e-6)
    assert not torch.allclose(texts[0], texts[1], atol=1e-3)


def test_absent_weights_are_one_line_with_a_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TORCH_HOME", str(tmp_path))
    monkeypatch.setenv("HF_HUB_CACHE", str(tmp_path))
    for name in ("inception", "clip", "clip-large"):
        start = f"^the weights of '{name}' are missing: .*; give --weights PATH"
        with pytest.raises(PaintitError, match=start) as caught:
            load_network(name)
        assert caught.value.code == "evaluate.weights"
        assert "\n" not in str(caught.value)


def test_another_file_is_no_inception(tmp_path: Path) -> None:
    (tmp_path / "x.pt").write_bytes(b"nothing")
    with pytest.raises(PaintitError, match="is not that network"):
        load_network("inception", str(tmp_path / "x.pt"))


def test_unknown_networks_name_the_nearest() -> None:
    with pytest.raises(UsageError, match="there is no feature network 'incepton'; did you mean 'inception'"):
        load_network("incepton")
