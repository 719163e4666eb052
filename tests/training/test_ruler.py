"""The ruler's own checks: published colour pairs, a perfect paint, a wrong one, a pattern against its decoys."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cells
import numpy as np
import probes
import pytest
import ruler
import ruler_classifier
import ruler_pattern
import scores
import torch
from classes import material_of
from meanings import meaning
from vocabulary import COLORS

SIZE = 128
#: Sharma, Wu and Dalal 2005, table 1: L*a*b*, L*a*b*, difference.
SHARMA = """
50 2.6772 -79.7751 50 0 -82.7485 2.0425
50 3.1571 -77.2803 50 0 -82.7485 2.8615
50 2.8361 -74.0200 50 0 -82.7485 3.4412
50 -1.3802 -84.2814 50 0 -82.7485 1.0000
50 -0.9009 -85.5211 50 0 -82.7485 1.0000
50 0 0 50 -1 2 2.3669
50 2.4900 -0.0010 50 -2.4900 0.0009 7.1792
50 2.4900 -0.0010 50 -2.4900 0.0011 7.2195
50 -0.0010 2.4900 50 0.0009 -2.4900 4.8045
50 2.5 0 50 0 -2.5 4.3065
50 2.5 0 73 25 -18 27.1492
50 2.5 0 61 -5 29 22.8977
50 2.5 0 56 -27 -3 31.9030
50 2.5 0 58 24 15 19.4535
60.2574 -34.0099 36.2677 60.4626 -34.1751 39.4387 1.2644
63.0109 -31.0961 -5.8663 62.8187 -29.7946 -4.0864 1.2630
61.2901 3.7196 -5.3901 61.4292 2.2480 -4.9620 1.8731
35.0831 -44.1164 3.7933 35.0232 -40.0716 1.5901 1.8645
22.7233 20.0904 -46.6940 23.0331 14.9730 -42.5619 2.0373
36.4612 47.8580 18.3852 36.2715 50.5065 21.2231 1.4146
90.8027 -2.0831 1.4410 91.1528 -1.6435 0.0447 1.4441
6.7747 -0.2908 -2.4247 5.8714 -0.0985 -2.2286 0.6377
2.0776 0.0795 -1.1350 0.9033 -0.0636 -0.5514 0.9082
"""


def test_ciede2000_of_the_published_pairs() -> None:
    rows = torch.tensor([[float(v) for v in line.split()] for line in SHARMA.split("\n") if line], dtype=torch.float64)
    found = ruler.ciede2000(rows[:, :3], rows[:, 3:6])
    assert torch.allclose(found, rows[:, 6], atol=6e-5)
    assert torch.allclose(ruler.ciede2000(rows[:, 3:6], rows[:, :3]), rows[:, 6], atol=6e-5)


def test_lab_of_known_colours() -> None:
    linear = torch.tensor([[1.0, 1.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    expected = torch.tensor([[100.0, 0.0, 0.0], [53.24, 80.09, 67.20], [32.30, 79.19, -107.86]])
    assert torch.allclose(ruler.lab(linear), expected, atol=0.05)


@pytest.fixture(scope="module")
def spot() -> ruler.Subject:
    return ruler.subject("spot", SIZE)


def judged(on: ruler.Subject, prompt: str, value: torch.Tensor) -> dict[str, float]:
    truth = ruler.truth_of(prompt, "spot", SIZE)
    maps = ruler.constant_maps(value, on.seen)
    figures = ruler.channel_figures(on, maps, truth) | {"relighting": ruler.relighting_error(on, maps, truth)}
    return {**figures, **scores.judged(dict(figures), truth.metallic, recognised=True)}


@pytest.mark.parametrize("prompt", ["glossy red plastic", "polished gold", "black rubber"])
def test_a_perfect_paint_passes_everything(spot: ruler.Subject, prompt: str) -> None:
    found = judged(spot, prompt, ruler.truth_of(prompt, "spot", SIZE).value)
    assert found["score"] == 1
    assert found["delta_e"] < 0.1
    assert found["relighting"] < 1e-5
    assert np.isnan(found["saturation"]) or abs(found["saturation"] - 1) < 0.1


def test_each_wrong_channel_fails_its_own_test(spot: ruler.Subject) -> None:
    truth = ruler.truth_of("glossy red plastic", "spot", SIZE).value
    blue = judged(spot, "glossy red plastic", truth[[2, 1, 0, 3, 4]])
    assert (blue["colour"], blue["metal"], blue["rough"]) == (0, 1, 1)
    assert blue["relighting"] > 0.1
    metal = judged(spot, "glossy red plastic", torch.cat([truth[:4], torch.tensor([0.9])]))
    assert (metal["colour"], metal["metal"], metal["rough"]) == (1, 0, 1)
    matte = judged(spot, "glossy red plastic", torch.cat([truth[:3], truth[3:4] + 0.4, truth[4:]]))
    assert (matte["colour"], matte["metal"], matte["rough"]) == (1, 1, 0)
    grey = judged(spot, "glossy red plastic", torch.tensor([0.2, 0.2, 0.2, 0.1, 0.0]))
    assert grey["saturation"] < 0.1
    assert grey["chroma"] < -40


@pytest.mark.parametrize("prompt", ["red brick", "a zebra"])
def test_the_pattern_score_prefers_the_true_pattern(spot: ruler.Subject, prompt: str) -> None:
    rng = np.random.default_rng(3)
    own = ruler.true_maps(spot, material_of(prompt, rng), rng)
    other = ruler.true_maps(spot, material_of("black and white checkered plastic", rng), rng)
    even = ruler.constant_maps(ruler.truth_of(prompt, "spot", SIZE).value, spot.seen)
    found = ruler_pattern.pattern_figures("spot", own, prompt)
    assert found["pattern"] > 0.5
    assert found["pattern"] > found["decoy"]
    assert ruler_pattern.pattern_figures("spot", other, prompt)["pattern"] < 0.6 * found["pattern"]
    assert ruler_pattern.pattern_figures("spot", even, prompt)["pattern"] == 0


def test_similarity_tells_direction_size_and_contrast() -> None:
    y, x = torch.meshgrid(torch.arange(64.0), torch.arange(64.0), indexing="ij")
    mask = torch.ones(1, 64, 64, dtype=torch.bool)

    def stripes(along: torch.Tensor, period: float, contrast: float = 0.5, shift: float = 0.0) -> torch.Tensor:
        wave = 0.5 + contrast * (along * 2 * torch.pi / period + shift).sin()
        return ruler_pattern.band_energies(wave[None], mask)

    plain = stripes(x, 10)
    assert ruler_pattern.similarity(plain, stripes(x, 10, shift=2.0)) > 0.95
    assert ruler_pattern.similarity(plain, stripes(y, 10)) < 0.2
    assert ruler_pattern.similarity(plain, stripes(x, 3)) < 0.2
    assert ruler_pattern.similarity(plain, stripes(x, 10, contrast=0.05)) < 0.3


def test_cells_are_kept_found_and_never_mixed(tmp_path: Path, spot: ruler.Subject) -> None:
    every = cells.grid(["spot", "bob"], ruler.PROMPTS, [0, 1])
    assert len(every) == len({c.name for c in every}) == 48
    halves = [cells.grid(["spot", "bob"], ruler.PROMPTS, [0, 1], part) for part in ("1/2", "2/2")]
    assert sorted(c.name for half in halves for c in half) == sorted(c.name for c in every)
    maps = ruler.constant_maps(torch.tensor([0.25, 0.5, 0.75, 0.25, 1.0]), spot.seen)
    cells.claim(tmp_path, {"method": "truth"})
    cells.save(tmp_path, every[0], maps, 1.5, 10)
    assert cells.load(tmp_path) == [(every[0], 1.5)]
    assert torch.equal(cells.load_maps(tmp_path, every[0]).packed(), maps.packed())
    cells.claim(tmp_path, {"method": "truth"})
    with pytest.raises(ValueError, match="other settings"):
        cells.claim(tmp_path, {"method": "guided"})


def test_settings_of_the_methods() -> None:
    pixels = cells.config_of("pixels", ["optim.steps=7", "views.elevation=[-10, 10]"])
    assert (pixels.texture.kind, pixels.optim.steps, pixels.views.elevation) == ("pixels", 7, (-10, 10))
    assert pixels.texture.tv_weight > 0
    assert cells.config_of("rgb-only", []).guidance.reads == ("shaded",)


def test_the_recogniser_learns_and_is_read_back(tmp_path: Path) -> None:
    """Three plain classes as flat stacks: enough to see that it trains, averages views and survives the disk."""
    count = len(ruler_classifier.CLASSES)
    generator = torch.Generator().manual_seed(0)
    labels = torch.randint(0, 3, (128,), generator=generator)
    shades = torch.tensor([20, 120, 230])[labels][:, None, None, None]
    stacks = (shades + torch.randint(0, 20, (128, 8, 32, 32), generator=generator)).to(torch.uint8)
    net = ruler_classifier.fit(stacks, labels, 5, 0, lambda _: None, batch=16)
    trained = ruler_classifier.Recogniser(
        net, ruler_classifier.CLASSES, 1.0, torch.zeros(count, count, dtype=torch.long)
    )
    for k in range(3):
        assert trained.recognise(stacks[labels == k][:8].float() / 255) == ruler_classifier.CLASSES[k]
    ruler_classifier.save(trained, tmp_path / "ruler.pt")
    again = ruler_classifier.load(tmp_path / "ruler.pt")
    assert torch.equal(again.log_probabilities(stacks[:4] / 255), trained.log_probabilities(stacks[:4] / 255))


def test_every_prompt_has_a_class() -> None:
    assert len({ruler_classifier.class_of(prompt) for prompt in ruler.PROMPTS}) == len(ruler.PROMPTS)
    with pytest.raises(KeyError, match="no class"):
        ruler_classifier.class_of("a colour that is none")


def test_meanings_are_told_apart_by_material_too() -> None:
    gold = ruler.truth_of("polished gold", "spot", SIZE)
    same_color = dataclasses.replace(gold, metallic=0.0, roughness=0.3)
    assert probes.distance(gold.value, gold) < 1e-3
    assert probes.distance(gold.value, same_color) > 50


def test_totals_weigh_both_kinds_alike_and_spread_over_seeds() -> None:
    plain = [{"prompt": "p", "seed": s, "score": v, "seconds": 1.0} for s, v in ((0, 1.0), (0, 1.0), (1, 0.5))]
    pattern = [{"prompt": "q", "seed": s, "score": v, "pattern": v} for s, v in ((0, 0.5), (1, 0.5))]
    assert scores.total([*plain, *pattern]) == pytest.approx((2.5 / 3 + 0.5) / 2)
    assert scores.total(plain) == pytest.approx(2.5 / 3)
    assert scores.spread([0.75, float("nan"), 0.25]) == pytest.approx((0.5, 0.5 / 2**0.5))
    assert scores.summary(plain)["plain"]["score"] == pytest.approx(0.75)
    assert np.isnan(scores.summary(plain)["plain"]["saturation"])


def test_phrases_mean_what_the_generator_makes_of_them() -> None:
    rng = np.random.default_rng(0)
    assert meaning("polished copper", rng).base.metal == 1
    glossy, matte = (meaning(f"{finish} teal plastic", rng).base.rough for finish in ("glossy", "matte"))
    assert glossy < 0.3 < matte
    teal = meaning("teal", rng).base
    assert teal.metal == 0
    assert teal.color == pytest.approx(COLORS["teal"], abs=0.05)
    with pytest.raises(KeyError, match="unheard"):
        meaning("unheard plastic", rng)
