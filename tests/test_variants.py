"""The methods that are compared: each one's settings, each one valid and painting, and one line for an unknown name."""

from __future__ import annotations

import dataclasses
import sys
from subprocess import run

import pytest
import torch

from paintit.config import PAPER, POCKET, PRESETS, PaintConfig
from paintit.errors import UsageError
from paintit.guidance.exact import ExactPrior
from paintit.mesh.read import read_mesh
from paintit.paint import checkpoint
from paintit.paint.painter import Painter
from paintit.settings import merge, validate
from paintit.variants import VARIANTS, apply


def test_the_names() -> None:
    assert list(VARIANTS) == ["dcpbr", "dcpbr-no-skip", "pixels", "base-color", "hash-grid", "points", "projection"]


@pytest.mark.parametrize("config", PRESETS.values(), ids=PRESETS)
@pytest.mark.parametrize("name", VARIANTS)
def test_every_method_is_valid_under_every_preset(name: str, config: PaintConfig) -> None:
    validate(apply(config, name))


def test_what_a_method_changes() -> None:
    assert apply(POCKET, "dcpbr") == POCKET
    assert apply(PAPER, "dcpbr-no-skip").texture.skip_widths == (0, 0, 0, 0, 0)
    pixels = apply(dataclasses.replace(POCKET, seed=7), "pixels")
    assert (pixels.texture.kind, pixels.texture.tv_weight, pixels.optim.lr, pixels.seed) == ("pixels", 1.0, 0.2, 7)
    assert apply(POCKET, "base-color").texture.maps == "base_color"
    assert apply(POCKET, "projection").method == "projection"
    assert POCKET.texture.kind == "dcpbr"


def test_an_unknown_method_is_one_line_with_the_names() -> None:
    with pytest.raises(UsageError, match=r"^there is no method 'voxels'; choose one of dcpbr, dcpbr-no-skip, pixels, "):
        apply(POCKET, "voxels")


def test_the_module_is_free_of_torch() -> None:
    code = "import sys, paintit.variants; sys.exit('torch' in sys.modules)"
    assert run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.fixture(scope="module")
def mesh(assets):
    return read_mesh(assets / "meshes/spot/spot.obj")


@pytest.mark.parametrize("name", [name for name in VARIANTS if name != "projection"])
def test_every_texture_paints_and_continues_from_a_checkpoint(name, mesh, tmp_path) -> None:
    config = merge(apply(POCKET, name), {"texture.size": 128, "views.size": 32, "views.count": 2, "optim.steps": 2})
    whole, first, second = (Painter(mesh, "red plastic", config, ExactPrior()) for _ in range(3))
    start = whole.maps()
    list(whole)
    end = whole.maps()
    assert not torch.equal(start.base_color, end.base_color)
    assert torch.equal(start.roughness, end.roughness) == (name == "base-color")
    next(iter(first))
    checkpoint.save(tmp_path / "last.safetensors", first)
    checkpoint.load(tmp_path / "last.safetensors", second)
    list(second)
    assert torch.equal(second.maps().packed(), end.packed())
