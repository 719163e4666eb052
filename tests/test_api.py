"""The Python API: the README's five lines, and silence."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import pytest

import paintit
from paintit.guidance.exact import ExactPrior
from paintit.paint.painter import Step
from paintit.settings import merge
from tests.cli.conftest import CUBE

CONFIG = merge(
    paintit.preset("pocket"),
    {
        "texture.size": 32, "texture.widths": [4, 4], "texture.skip_widths": [2, 2], "texture.input_channels": 2,
        "views.count": 2, "views.size": 24, "optim.steps": 3,
    },
)  # fmt: skip


@pytest.fixture
def cube(tmp_path: Path) -> Path:
    path = tmp_path / "cube.obj"
    path.write_text(CUBE)
    return path


def test_mesh_and_sentence_in_asset_out(cube: Path, capfd: pytest.CaptureFixture[str]) -> None:
    mesh = paintit.load_mesh(cube)
    result = paintit.paint(mesh, " red plastic ", config=CONFIG, seed=5)
    asset = result.export(cube.parent / "cube.glb")
    picture = result.preview(size=32, views=1)
    assert capfd.readouterr() == ("", "")
    assert asset.read_bytes()[:4] == b"glTF"
    assert picture.size == (32, 32)
    assert [step.index for step in result.history] == [1, 2, 3]
    assert (result.outcome, result.prompt, result.config.seed) == ("finished after 3 of 3 steps", "red plastic", 5)
    assert result.metadata["prompt"] == "red plastic"
    assert result.metadata["seed"] == 5
    assert result.seconds > 0
    with pytest.raises(paintit.PaintitError, match="already exists"):
        result.export(asset)
    result.export(asset, overwrite=True)


def test_a_path_will_do_and_a_callback_may_stop(cube: Path) -> None:
    def stop_after_two(step: Step) -> bool:
        return step.index < 2

    result = paintit.paint(str(cube), "red", config=CONFIG, prior=ExactPrior(), on_step=stop_after_two)
    assert result.outcome == "stopped after 2 of 3 steps"
    assert len(result.history) == 2


def test_a_callback_without_an_answer_does_not_stop(cube: Path) -> None:
    seen: list[int] = []
    result = paintit.paint(cube, "red", config=CONFIG, prior=ExactPrior(), on_step=lambda step: seen.append(step.index))
    assert seen == [1, 2, 3]
    assert result.outcome == "finished after 3 of 3 steps"


@pytest.mark.parametrize(
    ("prompt", "config", "code"),
    [
        ("  ", CONFIG, "prompt.empty"),
        ("red", dataclasses.replace(CONFIG, device="tpu"), "config.value"),
        ("red", dataclasses.replace(CONFIG, texture=dataclasses.replace(CONFIG.texture, size=-1)), "config.value"),
    ],
)
def test_mistakes_are_found_before_the_mesh_is_read(prompt: str, config: paintit.PaintConfig, code: str) -> None:
    with pytest.raises(paintit.PaintitError) as caught:
        paintit.paint("missing.obj", prompt, config=config)
    assert caught.value.code == code


def test_an_unknown_preset(cube: Path) -> None:
    with pytest.raises(paintit.PaintitError, match="there is no preset 'draft'"):
        paintit.paint(cube, "red", preset="draft")


def test_paint_is_the_function_even_where_the_folder_of_that_name_was_imported_first() -> None:
    script = "import paintit.paint.checkpoint, paintit; print(callable(paintit.paint), paintit.paint.__module__)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "True paintit.api\n"


def test_every_public_name_resolves() -> None:
    for name in paintit.__all__:
        assert getattr(paintit, name) is not None
    assert set(paintit.__all__) <= set(dir(paintit))
    with pytest.raises(AttributeError, match="module 'paintit' has no attribute 'nothing'"):
        paintit.nothing  # noqa: B018
