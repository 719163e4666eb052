"""Curves: what is fitted and how, what is painted, what is kept, and that a broken-off analysis goes on."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from tests.cli.conftest import CUBE

from paintit.analyze.frequency import (
    Curve,
    fit,
    fit_settings,
    paint,
    paint_settings,
    record_steps,
    shown_steps,
    summary,
    trace,
)
from paintit.analyze.frequency_run import Request, run
from paintit.color import encode_srgb
from paintit.config import OptimConfig, PaintConfig, TextureConfig, ViewConfig
from paintit.errors import OutputError, UsageError
from paintit.guidance.exact import ExactPrior
from paintit.mesh.mesh import Mesh
from paintit.mesh.read import read_mesh
from paintit.paint.painter import Painter

SMALL = PaintConfig(
    texture=TextureConfig(size=32, widths=(16, 16, 16), skip_widths=(4, 4, 4), input_channels=8),
    views=ViewConfig(count=2, size=24),
    optim=OptimConfig(steps=60, lr=1e-2),
)


@pytest.fixture
def cube_mesh(tmp_path: Path) -> Mesh:
    (tmp_path / "cube.obj").write_text(CUBE)
    return read_mesh(tmp_path / "cube.obj", unwrap="never")


def patches(size: int = 32) -> torch.Tensor:
    """(size, size, 3): blocks of random colours with fine noise on them, something for every ring."""
    generator = torch.Generator().manual_seed(11)
    blocks = torch.rand(8, 8, 3, generator=generator).repeat_interleave(size // 8, 0).repeat_interleave(size // 8, 1)
    return (0.2 + 0.6 * blocks + 0.1 * torch.randn(size, size, 3, generator=generator)).clamp(0.05, 0.95)


def test_the_first_steps_are_recorded_one_by_one_and_the_last_always() -> None:
    assert record_steps(25, 4) == (0, 1, 2, 3, 4, 8, 12, 16, 20, 24, 25)
    assert record_steps(2, 10) == (0, 1, 2)
    assert shown_steps(500) == (10, 50, 150, 500)
    assert shown_steps(1) == (1,)


def test_pixels_take_adams_first_step_toward_the_target() -> None:
    """Adam's first step is the learning rate times the gradient's sign, here that of coded - target, per texel."""
    config = fit_settings(SMALL, "pixels")
    target = patches()
    (_, before), (_, after) = list(fit(config, target, (0, 1)))[:2]
    logits = torch.logit(before[0].double()) + config.optim.lr * torch.sign(target - before[0])
    assert torch.allclose(after[0].double(), torch.sigmoid(logits), atol=1e-4)


def test_a_fit_ends_at_the_target_in_every_ring() -> None:
    target = patches()
    config = dataclasses.replace(fit_settings(SMALL, "pixels"), optim=OptimConfig(steps=60, lr=0.2, decay_every=10))
    curve, kept = trace("pixels", 0, fit(config, target, record_steps(60, 10)), target=target, show=(60,))
    assert curve.residual is not None
    assert curve.residual[0][4] == pytest.approx(1, abs=0.05)  # from an even start all of the target is missing
    assert max(curve.residual[-1]) < 0.01
    assert (kept[60] - target).abs().max() < 0.1
    assert curve.steps == record_steps(60, 10)
    assert all(step is not None and 0 < step < 30 for step in curve.half_fitted())


def test_a_network_fits_low_frequencies_first_and_pixels_all_at_once() -> None:
    """Figure 4's claim in small: rings 1 and 4, how much later the half-way step of the second is."""
    target = patches()

    def later(variant: str) -> float:
        states = fit(fit_settings(SMALL, variant), target, record_steps(60, 2))
        low, *_, high, _ = trace(variant, 0, states, target=target)[0].half_fitted()
        assert low is not None
        return (60.0 if high is None else high) / low

    assert later("pixels") < 1.5
    assert later("dcpbr") > 3


def test_painting_is_the_painters_own(cube_mesh: Mesh) -> None:
    config = dataclasses.replace(SMALL, optim=OptimConfig(steps=3))
    raw = dict(paint(config, cube_mesh, "red", (0, 2), outside="raw", prior=ExactPrior()))
    filled = dict(paint(config, cube_mesh, "red", (0, 2), prior=ExactPrior()))
    painter = Painter(cube_mesh, "red", config, ExactPrior())
    next(iter(painter))
    next(iter(painter))
    maps = painter.maps()
    assert list(raw) == list(filled) == [0, 2]
    assert torch.equal(raw[2], encode_srgb(maps.base_color))
    assert torch.equal(filled[2], encode_srgb(painter.fill_gutters(maps).base_color))
    assert not torch.equal(raw[2], filled[2])


def test_what_cannot_be_analyzed_is_refused() -> None:
    assert fit_settings(SMALL, "pixels").texture.tv_weight == 0 < paint_settings(SMALL, "pixels").texture.tv_weight
    for settings, variant in ((fit_settings, "points"), (fit_settings, "projection"), (paint_settings, "projection")):
        with pytest.raises(UsageError) as caught:
            settings(SMALL, variant)
        assert caught.value.code == "analyze.variant"
    with pytest.raises(UsageError, match="splines"):
        paint_settings(SMALL, "splines")


def test_summary_by_hand() -> None:
    def curve(seed: int, last: float) -> Curve:
        rows = tuple((value,) * 5 for value in (0.0, last, last))
        return Curve("pixels", seed, (0, 4, 8), rows, rows, tuple((v,) * 5 for v in (1.0, last, 0.2)), 1.0)

    found = summary([curve(0, 0.4), curve(1, 0.6)])
    assert found["half_power_step"][3] == {"mean": 2.0, "low": 2.0, "high": 2.0, "missing": 0}
    assert found["final_power"][0] == pytest.approx({"mean": 0.5, "low": 0.4, "high": 0.6, "missing": 0})
    # 1 to 0.4 in 4 steps is half after 3 1/3; 0.6 to 0.2 after 4 + 1.
    fitted = {"mean": (10 / 3 + 5) / 2, "low": 10 / 3, "high": 5.0, "missing": 0}
    assert found["half_fitted_step"][0] == pytest.approx(fitted)
    worst = dataclasses.replace(curve(1, 0.6), residual=((1.0,) * 5,) * 3)
    once, never = summary([curve(0, 0.4), worst])["half_fitted_step"][0], summary([worst])["half_fitted_step"][0]
    assert once == pytest.approx({"mean": 10 / 3, "low": 10 / 3, "high": 10 / 3, "missing": 1})
    assert never == {"mean": None, "low": None, "high": None, "missing": 1}


@pytest.fixture
def request_(tmp_path: Path) -> Request:
    """Pixels fit a small picture under two seeds."""
    picture = tmp_path / "patches.png"
    Image.fromarray((patches().numpy() * 255).astype(np.uint8)).save(picture)
    config = dataclasses.replace(SMALL, optim=OptimConfig(steps=6))
    return Request(picture, None, tmp_path / "out", config, ("pixels",), (0, 1), every=2, show=(2, 6))


def test_a_broken_off_analysis_goes_on(request_: Request, tmp_path: Path) -> None:
    notes: list[str] = []

    def stop(text: str) -> None:
        notes.append(text)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(request_, stop, {})
    assert not (request_.folder / "frequency.json").exists()
    run(request_, notes.append, {})
    assert [text.partition(":")[0] for text in notes] == ["pixels, seed 0", "pixels, seed 1"]
    whole = dataclasses.replace(request_, folder=tmp_path / "whole")
    run(whole, notes.append, {})
    for name in ("frequency.csv", "textures/pixels-seed0-step00002.png"):
        assert (request_.folder / name).read_bytes() == (whole.folder / name).read_bytes()


def test_a_folder_of_other_settings_is_not_mixed_up(request_: Request) -> None:
    run(request_, lambda _: None, {})
    other = dataclasses.replace(request_, config=dataclasses.replace(request_.config, optim=OptimConfig(steps=7)))
    with pytest.raises(UsageError, match="other settings"):
        run(other, lambda _: None, {})
    document = run(dataclasses.replace(other, overwrite=True), lambda _: None, {})
    stored = json.loads((request_.folder / "frequency.json").read_text())
    assert stored == json.loads(json.dumps(document))
    assert Curve.from_dict(stored["curves"][0]) == Curve.from_dict(document["curves"][0])
    assert stored["curves"][0]["steps"][-1] == 7
    (request_.folder / "curves" / "pixels-seed1.json").write_text("{")
    with pytest.raises(OutputError, match=r"pixels-seed1\.json.*delete that file"):
        run(other, lambda _: None, {})
