"""The lexicon: unknown words are read as known ones, known ones never change, and the table says only known words."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

from paintit.guidance import lexicon
from paintit.guidance.lexicon import Lexicon, distance, table

KNOWN = frozenset({
    "red", "blue", "green", "lime", "brown", "gold", "golden", "silver", "copper", "steel", "rusted", "wood", "oak",
    "brick", "leather", "velvet", "plastic", "glass", "stone", "fabric", "fur", "feathers", "leaves", "shiny",
    "polished", "dirty", "dark", "rough", "dairy", "cow", "cat", "leopard", "zebra", "vase", "bowl", "book",
    "coloured", "grey", "white", "goblet", "pearl", "spots", "spotted", "rose",
})  # fmt: skip
TRAINING = Path(__file__).parents[2] / "training" / "pocket"


@pytest.fixture(scope="module")
def reader() -> Lexicon:
    return Lexicon(KNOWN)


@pytest.fixture(scope="module")
def vocabulary() -> frozenset[str]:
    """What the captions of the prior that ships can say."""
    sys.path.insert(0, str(TRAINING))
    try:
        from captions import all_words  # pyright: ignore[reportMissingImports]
    finally:
        sys.path.remove(str(TRAINING))
    return frozenset(all_words())


@pytest.mark.parametrize(
    ("word", "meaning"),
    [
        ("zebras", "zebra"),
        ("feather", "feathers"),
        ("leaf", "leaves"),
        ("silvery", "silver"),
        ("reddish", "red"),
        ("steelen", "steel"),
        ("rusting", "rusted"),
        ("cherrylike", None),
        ("rosecoloured", "rose"),
        ("colored", "coloured"),
        ("gray", "grey"),
        ("redder", "red"),
        ("polish", "polished"),
        ("rosé", "rose"),
    ],
)
def test_derivations(word, meaning):
    assert Lexicon(KNOWN - {"reddish"}).known_form(word) == meaning


@pytest.mark.parametrize(
    ("word", "meaning"), [("redbrick", "red brick"), ("limegreen", "lime green"), ("goldplated", "gold polished")]
)
def test_closed_compounds_are_taken_apart(reader, word, meaning):
    assert reader.known_form(word) == meaning


@pytest.mark.parametrize(
    ("word", "meaning"),
    [
        ("silvr", "silver"),
        ("purpel", None),
        ("glod", "gold"),
        ("leapord", "leopard"),
        ("lether", "leather"),
        ("bleather", None),
        ("bine", None),
        ("qwertyuiop", None),
    ],
)
def test_misspellings_keep_their_first_letter(reader, word, meaning):
    assert reader.known_form(word) == meaning


def test_two_equally_near_words_are_no_reading():
    assert Lexicon(frozenset({"planks"})).known_form("plinks") == "planks"
    assert Lexicon(frozenset({"planks", "plonks"})).known_form("plinks") is None


def test_distance_counts_a_swap_once_and_stops_at_the_limit():
    pairs = [("gold", "glod"), ("gold", "gold"), ("zebra", "zeebras"), ("steel", "stele"), ("velvet", "plastic")]
    assert [distance(a, b, 2) for a, b in pairs] == [1, 0, 2, 1, 3]


@pytest.mark.parametrize(
    ("prompt", "said"),
    [
        ("a Corduroy sofa", "a velvet sofa"),
        ("a Holstein cow, side view", "a dairy cow, side view"),
        ("a moggy", "a cat"),
        ("two British shorthairs", "two cat"),
        ("mother-of-pearl bowl", "pearl bowl"),
        ("gold plated steel", "polished gold steel"),
        ("a  gleaming, grimy   amphora!", "a  shiny, dirty   vase!"),
        ("a cat sitting on the corner of a stone", "a cat sitting on the corner of a stone"),
    ],
)
def test_rewrite(reader, prompt, said):
    assert reader.rewrite(prompt) == said


def test_readings_tell_what_was_read_as_what(reader):
    assert reader.readings("a gleaming Holstein cow with red fur") == {"gleaming": "shiny", "Holstein cow": "dairy cow"}


def test_known_words_come_back_byte_for_byte(vocabulary):
    lexicon_ = Lexicon(vocabulary)
    for prompt in (" ".join(sorted(vocabulary)), "A Polished  GOLD\tteapot,\n red-brick!", "black and white zebra"):
        assert lexicon_.rewrite(prompt) == prompt
        assert lexicon_.readings(prompt) == {}


def test_a_known_word_beats_the_table():
    assert Lexicon(KNOWN | {"corduroy"}).rewrite("corduroy") == "corduroy"


def test_meanings_are_read_on_to_a_depth_of_three_and_cycles_end(monkeypatch):
    chain = {
        "aaaa": "bbbb",
        "bbbb": "cccc",
        "cccc": "red",
        "zzzz": "aaaa",
        "loop": "pool",
        "pool": "loop",
        "gone": "xyxy",
    }
    monkeypatch.setattr(lexicon, "table", lambda: chain)
    reader = Lexicon(frozenset({"red"}))
    assert reader._exact("aaaa", lexicon.DEPTH) == "red"
    assert [reader._exact(word, lexicon.DEPTH) for word in ("zzzz", "loop", "gone")] == [None, None, None]


def test_every_meaning_is_made_of_known_words(vocabulary):
    lost = {k: m for k, m in table().items() if m and not set(m.split()) <= vocabulary | lexicon.STOP}
    assert not lost


def test_the_table_is_sorted_unique_and_plain():
    text = Path(lexicon.__file__).with_name("lexicon.txt").read_text(encoding="utf-8")
    lines = text.splitlines()
    keys = [line.partition("\t")[0] for line in lines]
    assert lines == sorted(lines)
    assert len(set(keys)) == len(keys) > 2500
    assert all(key == " ".join(lexicon._WORD.findall(key.lower())) for key in keys)
    assert all(len(m.split()) <= 6 for m in table().values())


def test_few_lines_repeat_the_vocabulary(vocabulary):
    meant = [key for key, meaning in table().items() if meaning]
    assert sum(key in vocabulary for key in meant) < 0.1 * len(meant)


def test_loads_quickly_and_without_torch():
    code = "import sys, paintit.guidance.lexicon; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    times = []
    for _ in range(5):
        table.cache_clear()
        start = time.process_time()
        table()
        times.append(time.process_time() - start)
    assert min(times) < 0.03
