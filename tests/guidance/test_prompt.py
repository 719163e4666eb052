"""Words for views."""

from __future__ import annotations

import math

import pytest
import torch

from paintit.config import PromptConfig
from paintit.errors import UsageError
from paintit.guidance.prompt import Prompts, view_word


@pytest.mark.parametrize(
    ("azimuth", "elevation", "word"),
    [
        (0, 0, "front"), (44, 0, "front"), (-44, 0, "front"), (316, 0, "front"), (360, 20, "front"), (725, 0, "front"),
        (46, 0, "side"), (90, 0, "side"), (134, -60, "side"), (270, 0, "side"), (-90, 44, "side"), (226, 0, "side"),
        (136, 0, "back"), (180, 0, "back"), (-180, 0, "back"), (224, 0, "back"), (-140, -60, "back"),
        (0, 46, "overhead"), (180, 60, "overhead"), (90, 89, "overhead"),
    ],
)  # fmt: skip
def test_view_words(azimuth: float, elevation: float, word: str) -> None:
    assert view_word(math.radians(azimuth), math.radians(elevation)) == word


def radians(*degrees: float) -> torch.Tensor:
    return torch.deg2rad(torch.tensor(degrees))


def test_texts_of_the_official_template() -> None:
    prompts = Prompts("a cow", PromptConfig().template, PromptConfig().negative)
    assert prompts.for_views(radians(0, 90), radians(0, 60)) == [
        "a DSLR photo of a cow, best quality, high quality, extremely detailed, good geometry, front view",
        "a DSLR photo of a cow, best quality, high quality, extremely detailed, good geometry, overhead view",
    ]


def test_focus_views_have_their_own_words() -> None:
    prompts = Prompts("a king", "{prompt}, {view} view", focus=("face", "ear"))
    texts = prompts.for_views(radians(0, 0, 180), radians(0, 0, 0), ["", "face", "ear"])
    assert texts == ["a king, front view", "a face of a king, front view", "an ear of a king, back view"]


def test_distinct_texts_are_known_beforehand() -> None:
    prompts = Prompts("a king", "{prompt}, {view} view", "ugly", focus=("face",))
    assert len(prompts.distinct()) == 1 + 2 * 4
    assert prompts.distinct()[0] == "ugly"
    azimuth = torch.rand(200, generator=torch.Generator().manual_seed(0)) * 7
    texts = prompts.for_views(azimuth, azimuth - 3, ["", "face"] * 100)
    assert set(texts) == set(prompts.distinct()[1:])
    assert Prompts("a king", "{prompt}").distinct() == ("", "a king")


def test_sent_texts_are_noted_once_in_order() -> None:
    prompts = Prompts("p", "{prompt} {view}")
    assert prompts.sent == []
    prompts.for_views(radians(180, 0, 180), radians(0, 0, 0))
    prompts.for_views(radians(0, 90), radians(0, 0))
    assert prompts.sent == ["p back", "p front", "p side"]


def test_braces_in_the_users_words_stay() -> None:
    assert Prompts("a {view} of {x} {prompt}", "{prompt}, {view}").text("side") == "a {view} of {x} {prompt}, side"


@pytest.mark.parametrize(
    ("prompt", "template", "code"),
    [
        ("", "{prompt}", "prompt.empty"),
        (" \t\n", "{prompt}", "prompt.empty"),
        ("a cow", "a photo", "prompt.template"),
        ("a cow", "{prompt} from {angle}", "prompt.template"),
    ],
)
def test_refusals(prompt: str, template: str, code: str) -> None:
    with pytest.raises(UsageError) as caught:
        Prompts(prompt, template)
    assert caught.value.code == code
    assert caught.value.hint


def test_every_view_needs_a_focus_name_or_none_does() -> None:
    with pytest.raises(ValueError, match="zip"):
        Prompts("p", "{prompt}").for_views(radians(0, 0), radians(0, 0), ["face"])
