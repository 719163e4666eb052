"""Studies from folders of pictures and of painted assets, and every way in which there is no study."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.cli.conftest import TINY, Ran
from tests.study.conftest import METHODS, PROMPTS, make_pictures

from paintit.study.questions import read_study


def test_pictures_become_a_study(study: Path) -> None:
    found = read_study(study)
    assert (found.methods, found.seed) == (METHODS, 3)
    assert {q.name: q.prompt for q in found.questions} == PROMPTS
    assert all(q.untextured and q.untextured.is_file() for q in found.questions)
    assert all(path.is_file() for q in found.questions for path in q.pictures.values())


def test_assets_are_rendered_alike(cube: Path, tmp_path: Path, paintit: Callable[..., Ran]) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    assert paintit("paint", cube, "red brick", "-o", one / "cube.glb", *TINY).code == 0
    shutil.copytree(one, two)
    (two / "cube.glb").unlink()  # its run is still there
    (one / "alone.png").write_bytes(make_png(tmp_path))
    ran = paintit("study", "create", tmp_path / "study", f"one={one}", f"two={two}", "--size", "96")
    assert (ran.code, ran.out) == (0, f"{tmp_path / 'study'}\n"), ran.err
    assert "left out, since not every method has them: alone" in ran.err
    (question,) = read_study(tmp_path / "study").questions
    assert (question.name, question.prompt) == ("cube", "red brick")
    first, second = (np.asarray(Image.open(path)) for path in question.pictures.values())
    np.testing.assert_allclose(first.astype(int), second, atol=1)  # the asset's maps have 8 bits, the run's more
    assert question.untextured
    bare = np.asarray(Image.open(question.untextured))
    assert first.shape == bare.shape == (96, 96, 3)
    inside = np.abs(bare.astype(int) - bare[0, 0]).max(-1) > 3
    rows, columns = np.nonzero(inside)
    reach = max(48 - rows.min(), rows.max() - 47, 48 - columns.min(), columns.max() - 47) / 48
    assert reach == pytest.approx(0.92, abs=0.04), "the cube nearly fills the picture"
    assert (first != bare).any()


def make_png(folder: Path) -> bytes:
    Image.new("RGB", (8, 8)).save(folder / "x.png")
    return (folder / "x.png").read_bytes()


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two methods with one mesh each in common, and folders that are wrong."""
    monkeypatch.chdir(tmp_path)
    for number, name in enumerate(("a", "b")):
        make_pictures(tmp_path / name, number, ("m1", "m2", "m10"))
    make_pictures(tmp_path / "strange", 0, ("x",))
    (tmp_path / "empty").mkdir()
    (tmp_path / "torn").mkdir()
    (tmp_path / "torn" / "m1.png").write_bytes((tmp_path / "a" / "m1.png").read_bytes()[:60])
    (tmp_path / "prompts.toml").write_text("m1 = 3\n")
    return tmp_path


CREATE = {
    "one method": (["a=a"], 1, "1 methods are given; name at least 2: METHOD=FOLDER METHOD=FOLDER"),
    "none": ([], 1, "0 methods are given; name at least 2: METHOD=FOLDER METHOD=FOLDER"),
    "no name": (["a", "b=b"], 2, "a method is 'a'; write METHOD=FOLDER"),
    "twice": (["a=a", "a=b"], 2, "the method 'a' comes twice; give each a name of its own"),
    "no folder": (["a=a", "b=none"], 1, "there is no folder none; check the path"),
    "no pictures": (
        ["a=a", "b=empty"], 1,
        "empty holds no picture, asset or run; put .png, .jpg, .jpeg, .webp, .glb, .gltf or run folders there",
    ),
    "nothing common": (
        ["a=a", "b=strange"], 1,
        "no mesh is in all 2 folders (a: m1, m2, m10; b: x); name the files alike in all folders",
    ),
    "damaged": (["a=a", "b=torn"], 1, "cannot read the picture torn/m1.png: "),
    "prompts": (["a=a", "b=b", "--prompts", "prompts.toml"], 1, "m1 in prompts.toml is 3; write lines of mesh = "),
    "items": (["a=a", "b=b", "--items", "0"], 2, "--items is 0; it must be from 1 to 1000"),
}  # fmt: skip


@pytest.mark.parametrize("case", CREATE)
def test_no_study_is_one_line_and_leaves_nothing(case: str, made: Path, paintit: Callable[..., Ran]) -> None:
    arguments, code, line = CREATE[case]
    before = sorted(made.rglob("*"))
    ran = paintit("-q", "study", "create", "s", *arguments)
    assert (ran.code, ran.out, len(ran.errors)) == (code, "", 1), ran.err
    assert ran.errors[0].startswith(f"error: {line}")
    assert sorted(made.rglob("*")) == before


def test_a_study_is_never_written_over(made: Path, paintit: Callable[..., Ran]) -> None:
    assert paintit("study", "create", "s", "a=a", "b=b", "--items", "2").code == 0
    assert [question.name for question in read_study(made / "s").questions] == ["m1", "m2"]
    again = paintit("-q", "study", "create", "s", "a=a", "b=b")
    assert again.errors == ["error: s exists already; choose another name, or remove it"]


TABLE = """methods = ["a", "b"]
[[question]]
name = "m1"
pictures = { a = "a/m1.png", b = "b/m1.png" }
"""
TABLES = {
    "not toml": ("methods = ", "cannot read t.toml: "),
    "key": (TABLE.replace("name", "nmae"), "cannot use t.toml: unknown question.nmae; did you mean 'name'?"),
    "one method": ('methods = ["a"]', "cannot use t.toml: 1 methods are named; a study compares at least 2"),
    "no question": ('methods = ["a", "b"]', "cannot use t.toml: it asks no question; add [[question]] tables"),
    "no picture": (
        TABLE.replace(', b = "b/m1.png"', ""),
        "cannot use t.toml: question 'm1' has no picture of 'b'; add it under [question.pictures]",
    ),
    "missing": (TABLE.replace("b/m1", "b/m7"), "there is no picture b/m7.png; check the path in t.toml"),
    "damaged": (TABLE.replace("b/m1", "prompts").replace("prompts.png", "prompts.toml"), "cannot read the picture"),
    "twice": (TABLE + TABLE.partition("\n")[2], "cannot use t.toml: two questions are named 'm1'; give each a name"),
    "seed": (f"seed = -1\n{TABLE}", "cannot use t.toml: seed is -1; it must be 0 or more"),
    "type": (f"title = 3\n{TABLE}", "cannot use t.toml: title is 3; docs/study.md shows its form"),
}  # fmt: skip


@pytest.mark.parametrize("case", TABLES)
def test_a_table_that_is_wrong_is_one_line(case: str, made: Path, paintit: Callable[..., Ran]) -> None:
    text, line = TABLES[case]
    (made / "t.toml").write_text(text)
    ran = paintit("study", "serve", "t.toml")
    assert (ran.code, ran.out, len(ran.errors)) == (1, "", 1), ran.err
    assert ran.errors[0].startswith(f"error: {line}")
    assert not (made / "answers.sqlite").exists()


def test_what_is_no_study_or_no_file_of_answers_is_one_line(made: Path, paintit: Callable[..., Ran]) -> None:
    (made / "t.toml").write_text(TABLE)
    make = "make one: paintit study create STUDY METHOD=FOLDER METHOD=FOLDER"
    cases = [
        (["serve", "a"], 1, f"a is not a study: there is no study.toml; {make}"),
        (["serve", "none"], 1, f"none is not a study: there is no such file; {make}"),
        (["serve", "t.toml", "-o", "prompts.toml"], 1, "cannot open prompts.toml: file is not a database; "),
        (["serve", "t.toml", "--port", "70000"], 2, "--port is 70000; it must be from 0 to 65535"),
        (["report", "none.sqlite"], 1, "there is no file none.sqlite; make one: paintit study serve STUDY -o FILE"),
        (["report", "prompts.toml"], 1, "cannot open prompts.toml: file is not a database; "),
        (["repotr"], 2, "action is 'repotr'"),
        ([], 2, "nothing is asked of the study; write one of create, serve, report"),
    ]
    for arguments, code, line in cases:
        ran = paintit("study", *arguments)
        assert (ran.code, ran.out, len(ran.errors)) == (code, "", 1), (arguments, ran)
        assert ran.errors[0].startswith(f"error: {line}"), arguments
    assert (made / "prompts.toml").read_text() == "m1 = 3\n"
