"""Gradients of near views: identical views, a prior whose gradient is known, and the controls."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import pytest
import torch
from tests.cli.conftest import CUBE

from paintit.analyze.coherence import CONTROLS, NearViews, near_views, rows
from paintit.analyze.coherence_run import summary
from paintit.config import LightConfig, OptimConfig, PaintConfig, TextureConfig, ViewConfig
from paintit.errors import UsageError
from paintit.guidance.exact import ExactPrior
from paintit.mesh.read import read_mesh
from paintit.paint.painter import Painter
from paintit.paint.views import Views
from paintit.rng import Streams

SETTINGS = PaintConfig(
    texture=TextureConfig(kind="pixels", size=128),
    views=ViewConfig(size=32),
    light=LightConfig(rotation=0.0),
    optim=OptimConfig(steps=4, lr=0.2),
)


@pytest.fixture
def painter(tmp_path: Path) -> Painter:
    (tmp_path / "cube.obj").write_text(CUBE)
    return Painter(read_mesh(tmp_path / "cube.obj", unwrap="never"), "red", SETTINGS, ExactPrior())


def test_views_are_near_the_front(painter: Painter) -> None:
    turned = dataclasses.replace(SETTINGS.views, front=90.0)
    painter.config = dataclasses.replace(SETTINGS, views=turned)
    cameras = near_views(200, 2.0, painter, torch.Generator().manual_seed(0))
    azimuth, elevation = cameras.azimuth.rad2deg() - 90, cameras.elevation.rad2deg()
    for angle in (azimuth, elevation):
        assert 1.8 < angle.abs().max() < 2.0001
        assert abs(angle.mean()) < 0.3
    assert abs(torch.corrcoef(torch.stack([azimuth, elevation]))[0, 1]) < 0.2


def test_one_view_several_times_has_rank_one(painter: Painter) -> None:
    found = {row.kind: row.agreement for row in rows(painter, count=4, within=0.0, reads="stack", t=[0.5], scale=[7.5])}
    assert [found[kind].rank for kind in ("guidance", "noise", "even", "repeated", "random")] == [1, 1, 1, 1, 4]


def test_the_gradient_is_that_of_the_map(painter: Painter) -> None:
    """The exact prior without spread gives m(t) alpha / sigma (x - mu), free of noise: the gradient of half its square
    on the map, so a finite difference along any direction must agree."""
    views = NearViews(painter, 3, 2.0, "stack")
    prior, t = painter.prior, 0.6
    assert isinstance(prior, ExactPrior)
    alpha, sigma = prior.alpha_sigma(t)
    found = views.gradients(t, 1.0)
    assert torch.allclose(found, views.gradients(t, 101.0), rtol=1e-3, atol=1e-6)
    mu = views._geometry
    assert mu is not None
    direction = torch.randn(views._coded.shape, generator=torch.Generator().manual_seed(2))
    original = views._coded.detach().clone()

    cameras = near_views(3, 2.0, painter, Streams(painter.config.seed)["coherence views"])
    logits = painter.field.logits  # type: ignore[attr-defined]

    @torch.no_grad()
    def energy(step: float) -> torch.Tensor:
        """(views,) half the squared distance to mu, by the painter's own way to the prior, of a map moved so far."""
        logits[:, :3] = torch.logit(original + step * direction).permute(0, 3, 1, 2)
        image = painter._render(painter.fill_gutters(painter.maps()), Views(cameras, ("",) * 3))
        return (prior.encode_image(painter._read(image)) - mu).double().square().sum((1, 2, 3)) / 2

    h = 1e-3
    numeric = (energy(h) - energy(-h)) / (2 * h) * prior.weight(t) * alpha / sigma
    assert (found @ direction.flatten()).double() == pytest.approx(numeric, rel=2e-3)


def test_controls_stand_where_they_should(painter: Painter) -> None:
    """Views that differ by a pixel or more: the same everywhere agrees best, noise on the screen far less, numbers on
    the texels not at all; a prior that leaves no noise in the gradient lies above the noise."""
    found = {row.kind: row.agreement for row in rows(painter, count=5, within=8.0, reads="stack", t=[0.5], scale=[1])}
    cosine = {kind: one.cosine for kind, one in found.items()}
    assert cosine["repeated"] == pytest.approx(1)
    assert cosine["even"] > cosine["noise"] + 0.2
    assert cosine["guidance"] > cosine["noise"] + 0.2
    assert abs(cosine["random"]) < 0.05
    assert max(found["random"].ratios) < 1.15


def test_seeds_and_states_have_rows_of_their_own(painter: Painter) -> None:
    found = list(rows(painter, count=3, within=2.0, reads="stack", t=[0.2, 0.8], scale=[1, 7.5]))
    next(iter(painter))
    found += rows(painter, count=3, within=2.0, reads="stack", t=[0.2, 0.8], scale=[1, 7.5])
    again = list(rows(painter, count=3, within=2.0, reads="stack", t=[0.2, 0.8], scale=[1, 7.5]))
    assert again == found[len(again) :]
    assert [(row.t, row.scale) for row in found[:4]] == [(0.2, 1), (0.2, 7.5), (0.8, 1), (0.8, 7.5)]
    assert tuple(row.kind for row in found[4:8]) == CONTROLS
    assert {row.after for row in found} == {0, 1}
    assert found[0].agreement != found[8].agreement


def test_summary_keeps_the_lowest_rank_and_no_ratio_of_rounding(painter: Painter) -> None:
    near = list(rows(painter, count=3, within=2.0, reads="stack", t=[0.5], scale=[1]))
    same = list(rows(painter, count=3, within=0.0, reads="stack", t=[0.5], scale=[1]))
    alone, mixed = summary(near)[0], summary([*near, *same])[0]
    assert alone["ratios"][-1] == 1
    assert alone["low"] == alone["ratios"] == alone["high"]
    assert (mixed["ratios"], mixed["rank"]) == ([], 1)
    assert math.isclose(mixed["cosine_high"], 1)


def test_rgb_alone_needs_a_prior_that_reads_it(painter: Painter) -> None:
    with pytest.raises(UsageError, match="use --reads stack"):
        NearViews(painter, 3, 2.0, "rgb")
