"""The whole loop against a prior whose optimum is known (eq. 1 to 4), exact resume, and what a step reports."""

from __future__ import annotations

import dataclasses
import math

import pytest
import torch

from paintit.color import encode_srgb
from paintit.config import LightConfig, OptimConfig, PaintConfig, TextureConfig, ViewConfig, preset
from paintit.errors import PaintitError, RunError
from paintit.guidance.exact import ExactPrior, smooth_target
from paintit.mesh.read import read_mesh
from paintit.paint import checkpoint
from paintit.paint.painter import Painter
from paintit.render.texels import seen, texel_points

SIZE = 128
BASE = dataclasses.replace(
    preset("pocket"),
    views=ViewConfig(size=SIZE, count=4, background=0.5),  # views that resolve the texels
    light=LightConfig(),
)


def config_for(kind: str, steps: int) -> PaintConfig:
    if kind == "pixels":
        texture = TextureConfig(kind="pixels", size=SIZE)
        optim = OptimConfig(steps=steps, lr=0.2, decay=0.5, decay_every=steps // 4 or 1, clip=0.0)
    else:
        widths = (16, 32, 64)
        texture = TextureConfig(size=SIZE, widths=widths, skip_widths=widths, input_channels=8)
        optim = OptimConfig(steps=steps, lr=5e-3, decay=0.5, decay_every=steps // 4 or 1, clip=10.0)
    return dataclasses.replace(BASE, texture=texture, optim=optim, device="cpu")


@pytest.fixture(scope="module")
def spot(assets):
    return read_mesh(assets / "meshes/spot/spot.obj")


@pytest.mark.parametrize("kind", ["dcpbr", "pixels"])
def test_the_loop_reaches_the_known_optimum(spot, kind):
    """PSNR over the covered texels that a camera can see: base colour (as stored), roughness and metalness together."""
    painter = Painter(spot, "anything", config_for(kind, 240), ExactPrior())
    steps = list(painter)
    assert [s.index for s in steps] == list(range(1, 241))
    maps = painter.maps()
    covered, position, _ = texel_points(spot, painter.geometry, SIZE)
    visible = seen(spot, painter.geometry, SIZE) & covered
    found = torch.cat([encode_srgb(maps.base_color), maps.roughness, maps.metallic], -1)
    error = (found - smooth_target(position))[visible]
    psnr = -10 * math.log10(float(error.square().mean()))
    print(f"{kind}: {psnr:.2f} dB over {int(visible.sum())} texels")
    assert psnr >= 30


def test_a_checkpoint_continues_bit_for_bit(spot, tmp_path):
    config = config_for("dcpbr", 6)
    whole = Painter(spot, "red plastic", config, ExactPrior())
    list(whole)
    first = Painter(spot, "red plastic", config, ExactPrior())
    for step in first:
        if step.index == 3:
            break
    checkpoint.save(tmp_path / "last.safetensors", first)
    second = Painter(spot, "red plastic", config, ExactPrior())
    checkpoint.load(tmp_path / "last.safetensors", second)
    assert [s.index for s in second] == [4, 5, 6]
    assert torch.equal(second.maps().packed(), whole.maps().packed())
    assert not torch.equal(second.maps().packed(), first.maps().packed())


def test_one_seed_one_result_and_another_seed_another(spot):
    config = config_for("dcpbr", 3)
    results = []
    for seed in (0, 0, 1):
        painter = Painter(spot, "red plastic", dataclasses.replace(config, seed=seed), ExactPrior())
        list(painter)
        results.append(painter.maps().packed())
    assert torch.equal(results[0], results[1])
    assert not torch.equal(results[0], results[2])


def test_channels_left_out_of_reads_get_no_gradient(spot):
    config = config_for("pixels", 1)
    config = dataclasses.replace(config, guidance=dataclasses.replace(config.guidance, reads=("roughness",)))
    painter = Painter(spot, "red plastic", config, ExactPrior())
    before = painter.maps()
    list(painter)
    after = painter.maps()
    assert torch.equal(before.base_color, after.base_color)
    assert not torch.equal(before.roughness, after.roughness)


def test_a_gradient_that_is_not_finite_stops_the_paint_and_spares_the_field(spot):
    class Broken(ExactPrior):
        def weight(self, t: float) -> float:
            return math.inf

    painter = Painter(spot, "red plastic", config_for("pixels", 2), Broken())
    before = painter.maps().packed()
    with pytest.raises(PaintitError, match=r"the gradient became (nan|inf) at step 1; lower --optim.lr"):
        next(iter(painter))
    assert torch.equal(before, painter.maps().packed())


def test_checkpoints_that_do_not_fit_are_refused(spot, tmp_path):
    painter = Painter(spot, "red plastic", config_for("dcpbr", 2), ExactPrior())
    path = tmp_path / "last.safetensors"
    with pytest.raises(RunError, match="there is no checkpoint"):
        checkpoint.load(path, painter)
    path.write_bytes(b"not a checkpoint")
    with pytest.raises(RunError, match="cannot be read"):
        checkpoint.load(path, painter)
    checkpoint.save(path, painter)
    with pytest.raises(RunError, match="does not fit"):
        checkpoint.load(path, Painter(spot, "red plastic", config_for("pixels", 2), ExactPrior()))


def test_the_learning_rate_decays_in_steps(spot):
    painter = Painter(spot, "red plastic", config_for("pixels", 8), ExactPrior())
    rates = [step.learning_rate for step in painter]
    assert rates == pytest.approx([0.2, 0.2, 0.1, 0.1, 0.05, 0.05, 0.025, 0.025])
