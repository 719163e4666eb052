"""The captions of the built-in prior's training: a sentence decides its material."""

import ast
import sys
from itertools import pairwise
from pathlib import Path

import captions
import classes
import numpy as np
import phrases
import pytest
import surfaces
import vocabulary
from ruler import PROMPTS

POCKET = Path(__file__).parents[2] / "training" / "pocket"


@pytest.fixture(scope="module")
def drawn() -> list[tuple[str, surfaces.Material]]:
    """8000 sentences and materials over all archetypes, a third of them with the rare kinds favoured."""
    rng = np.random.default_rng(5)
    kinds = captions.ARCHETYPES
    return [captions.random_caption(rng, kinds[i % len(kinds)], 0.5 * (i % 3 == 0)) for i in range(8000)]


def layers(material: surfaces.Material) -> list[surfaces.Layer]:
    return [material.base, *(layer for layer, _ in material.overlays)]


def wording(kind: str, words: str) -> vocabulary.Pattern:
    return next(p for p in vocabulary.PATTERNS if p.kind == kind and words in p.words)


def test_no_caption_holds_a_sentence_of_the_showcase(drawn: list[tuple[str, surfaces.Material]]) -> None:
    assert all(captions.held_out(f"a photo of {sentence}, front view") for sentence in captions.HELD_OUT)
    assert not [text for text, _ in drawn if captions.held_out(text)]


def test_a_draw_that_is_held_out_is_drawn_again(monkeypatch: pytest.MonkeyPatch) -> None:
    first = [captions.random_caption(np.random.default_rng(i), "ball")[0] for i in range(40)]
    monkeypatch.setattr(captions, "HELD_OUT", frozenset(first))
    again = [captions.random_caption(np.random.default_rng(i), "ball")[0] for i in range(40)]
    assert not set(first) & set(again)


def test_the_same_seed_gives_the_same_sentence_and_material() -> None:
    one, two = (captions.random_caption(np.random.default_rng(9), "vessel") for _ in range(2))
    assert one == two


def test_sentences_are_clean_and_layers_in_range(drawn: list[tuple[str, surfaces.Material]]) -> None:
    for text, material in drawn:
        assert text == phrases.spelt(text)
        assert not set("{}") & set(text)
        assert len(material.overlays) <= 3
        for layer in layers(material):
            assert all(0 <= v <= 1 for v in (*layer.color, *layer.second, layer.metal, layer.rough))


def test_an_stands_before_a_vowel() -> None:
    assert (
        phrases.spelt("a ebony owl  with a unicorn and a orange horn")
        == "an ebony owl with a unicorn and an orange horn"
    )


def test_shares_of_patterns_and_metals(drawn: list[tuple[str, surfaces.Material]]) -> None:
    rng = np.random.default_rng(1)
    plain = [captions.random_caption(rng, captions.ARCHETYPES[i % len(captions.ARCHETYPES)])[1] for i in range(6000)]
    # Patches and the like have places too now, but the shares below are those of regular patterns.
    regular = vocabulary.CANONICAL - {"patches", "streaks", "camouflage", "veins", "cracks", "florals"}
    patterns = np.mean([any(s.kind in regular for _, s in m.overlays) for m in plain])
    metals = np.mean([m.base.metal > 0.5 for m in plain])
    assert 0.31 < patterns < 0.4
    assert 0.175 < metals < 0.25
    used = {s.kind for _, m in drawn for _, s in m.overlays}
    assert used >= vocabulary.CANONICAL | {"edges", "crevices", "up", "camouflage", "belly", "limbs", "head"}


def test_there_are_many_families_and_each_says_its_roughness() -> None:
    families = {**vocabulary.METALS, **vocabulary.TINTED, **vocabulary.NATURAL}
    assert len(families) >= 150
    assert {name: k.rough for name, k in families.items() if not 0 < k.rough[1] - k.rough[0] <= 0.2} == {}


def test_all_css_and_survey_names_are_colours() -> None:
    for table, least in (("css.txt", 148), ("xkcd.txt", 900)):
        names = [line.rpartition(" ")[0] for line in (POCKET / table).read_text().splitlines()[1:]]
        assert len(names) >= least
        assert set(names) <= set(vocabulary.COLORS)


def test_size_words_alone_decide_the_scale_of_a_canonical_pattern() -> None:
    rng = np.random.default_rng(0)
    pattern = wording("dots", "{a} {m}{n} with {s}{b} polka dots")
    scales: dict[str, set[float]] = {}
    for _ in range(300):
        text, _, material = phrases.phrase_of(pattern, pattern.words[0], rng)
        said = [w for w in vocabulary.SHAPE_SIZES if f"with {w} " in text]
        scales.setdefault(said[0] if said else "", set()).add(material.overlays[0][1].scale)
    assert scales == {"": {1.0}, "small": {1.6}, "fine": {1.6}, "large": {0.62}, "big": {0.62}}


def test_one_sentence_has_one_canonical_split(drawn: list[tuple[str, surfaces.Material]]) -> None:
    found: dict[str, set[tuple[str, float, float]]] = {}
    for text, material in drawn:
        splits = [s for _, s in material.overlays if s.kind in vocabulary.CANONICAL]
        if len(splits) == 1:
            found.setdefault(text, set()).add((splits[0].kind, splits[0].share, splits[0].scale))
    assert max(len(v) for v in found.values()) <= 2  # "zebra stripes" and the like; never a continuum
    assert len([v for v in found.values() if len(v) == 1]) > 0.98 * len(found)


@pytest.mark.parametrize("kind", ["checks", "dots"])
def test_the_first_colour_is_the_base_unless_on_turns_them(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    red, white = (("red", vocabulary.COLORS["red"]), ("white", vocabulary.COLORS["white"]))
    monkeypatch.setattr(phrases, "two_colors", lambda rng: (red, white))
    pattern = next(p for p in vocabulary.PATTERNS if p.kind == kind)
    rng = np.random.default_rng(2)
    for words in pattern.words:
        text, _, material = phrases.phrase_of(pattern, words, rng)
        assert ("on red" in text or "dotted red" in text) == (text.index("white") < text.index("red")), text
        assert material.base.color[1] < 0.15, text
        assert material.overlays[0][0].color[1] > 0.7, text


def test_finish_words_decide_roughness() -> None:
    rng = np.random.default_rng(3)
    bounds = {
        "glossy": (0.06, 0.16),
        "shiny": (0.06, 0.16),
        "polished": (0.06, 0.14),
        "matte": (0.7, 0.9),
        "brushed": (0.3, 0.42),
    }
    for word, (low, high) in bounds.items():
        for name in ("plastic", "gold", "steel", "rubber", "porcelain"):
            rough = [surfaces.finished(surfaces.family(name, rng), word, rng).base.rough for _ in range(20)]
            assert low <= min(rough) <= max(rough) <= high, (word, name)


def test_a_colour_word_means_one_colour() -> None:
    rng = np.random.default_rng(4)
    reds = np.array([surfaces.family("plastic", rng, "red").base.color for _ in range(200)])
    assert np.abs(reds.mean(0) - vocabulary.COLORS["red"]).max() < 0.006
    assert reds.std(0).max() < 0.012
    brick = surfaces.family("brick", rng, "red").base.color
    assert min(brick[0] - 0.5, brick[1] - 0.2) > 0, "brick red, not signal red"


def test_wood_keeps_its_mean_colour_under_visible_grain() -> None:
    rng = np.random.default_rng(6)
    for name in ("oak wood", "walnut wood", "pine wood"):
        means = []
        for _ in range(60):
            material = surfaces.family(name, rng)
            (dark, where), light = material.overlays[0], material.base
            assert where.kind == "grain"
            assert sum(dark.color) < 0.7 * sum(light.color)
            dark_and_light = [surfaces.decoded(dark.color), surfaces.decoded(light.color)]
            means.append(np.average(dark_and_light, axis=0, weights=[where.share, 1 - where.share]))
        true = surfaces.decoded(vocabulary.hex_color(vocabulary.NATURAL[name].colors[0]))
        assert np.allclose(np.mean(means, 0), true, atol=0.01)


def test_greys_of_animals_are_never_bluish() -> None:
    rng = np.random.default_rng(7)
    for name in ("koala", "elephant", "wolf", "mouse"):
        red, _, blue = surfaces.decoded(vocabulary.hex_color(vocabulary.ANIMALS[name].colors[0]))
        assert red >= blue, name
        assert surfaces.hide(name, rng).base.metal == 0


def test_animals_wear_their_patterns() -> None:
    rng = np.random.default_rng(8)
    kinds = {n: surfaces.hide(n, rng).overlays[0][1].kind for n in ("zebra", "tiger", "leopard", "cheetah", "giraffe")}
    assert kinds == {
        "zebra": "stripes",
        "tiger": "tiger",
        "leopard": "rosettes",
        "cheetah": "spots",
        "giraffe": "cells",
    }


@pytest.mark.parametrize("prompt", PROMPTS)
def test_every_evaluation_prompt_has_a_material_and_known_words(prompt: str, words: frozenset[str]) -> None:
    assert any(prompt in wordings for wordings in classes.RETRIEVAL.values())
    material = classes.material_of(prompt, np.random.default_rng(0))
    assert material.base.metal == (1.0 if "gold" in prompt or "steel" in prompt else 0.0)
    assert set(prompt.split()) <= words


@pytest.fixture(scope="module")
def words() -> frozenset[str]:
    return frozenset(captions.all_words(4000))


def test_all_words_holds_every_word_of_a_caption(drawn: list[tuple[str, surfaces.Material]]) -> None:
    known = captions.all_words(25_000)
    assert all(a < b for a, b in pairwise(known))
    said = {w for text, _ in drawn for w in text.replace(",", " ").replace("/", " ").lower().split()}
    assert said <= set(known)


def test_wordings_belong_to_one_class_and_are_no_showcase_sentence() -> None:
    said = [w for wordings in classes.RETRIEVAL.values() for w in wordings]
    assert len(said) == len(set(said))
    assert not any(captions.held_out(w) for w in said)
    assert len(classes.RETRIEVAL) - len(classes.DECOYS) >= 24
    with pytest.raises(KeyError):
        classes.material_of("chalk and cheese", np.random.default_rng(0))


def test_a_decoy_differs_from_its_pattern_in_structure_only() -> None:
    for decoy, pattern in classes.DECOYS.items():
        fake, real = (classes.material_of(name, np.random.default_rng(1)) for name in (decoy, pattern))
        for one, two in zip(layers(fake), layers(real), strict=True):
            assert np.allclose(one.color, two.color, atol=0.05), decoy
            assert one.metal == two.metal
            assert abs(one.rough - two.rough) < 0.15
        assert real.overlays[0][1].kind in vocabulary.CANONICAL
        assert fake.overlays[0][1].kind not in vocabulary.CANONICAL


def test_the_generator_needs_numpy_and_the_standard_library_only() -> None:
    own = {p.stem for p in POCKET.glob("*.py")}
    for name in ("vocabulary", "phrases", "subjects", "captions", "classes"):
        for node in ast.walk(ast.parse((POCKET / f"{name}.py").read_text())):
            modules = (
                [a.name for a in node.names]
                if isinstance(node, ast.Import)
                else [node.module or ""]
                if isinstance(node, ast.ImportFrom)
                else []
            )
            for module in modules:
                top = module.split(".")[0]
                assert top in sys.stdlib_module_names or top in own or top == "numpy", (name, module)
