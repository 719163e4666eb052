"""The frame in which a seed tells the prior of the object."""

from __future__ import annotations

import dataclasses

import pytest
import torch

from paintit.config import preset
from paintit.guidance.exact import ExactPrior
from paintit.guidance.pocket import PocketPrior
from paintit.mesh.read import read_mesh
from paintit.paint.painter import Painter
from paintit.paint.placement import REACH, Placement


def channels() -> dict[str, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    mask = (torch.rand(2, 8, 8, 1, generator=generator) < 0.7).float()
    position = (torch.rand(2, 8, 8, 3, generator=generator) * 2 - 1) * mask
    normal = torch.nn.functional.normalize(torch.randn(2, 8, 8, 3, generator=generator), dim=-1) * mask
    return {"normal": normal.flip(-1), "mask": mask, "position": position, "normal_object": normal}


def test_without_a_generator_nothing_moves() -> None:
    given = channels()
    for name, value in Placement(None)(given).items():
        torch.testing.assert_close(value, given[name])


def test_it_mirrors_and_moves_what_is_seen_and_nothing_else() -> None:
    given, flips = channels(), set()
    for seed in range(12):
        place = Placement(torch.Generator().manual_seed(seed))
        got, inside = place(given), given["mask"][..., 0] > 0
        x = place.flip[0]
        flips.add(float(x))
        shift = (got["position"] - given["position"] * torch.tensor([x, 1, 1]))[inside]
        torch.testing.assert_close(shift, place.shift.expand_as(shift), atol=1e-6, rtol=0)
        assert place.shift.abs().max() <= REACH
        assert place.shift[1] == 0
        assert (got["position"][~inside] == 0).all()
        torch.testing.assert_close(got["normal_object"], given["normal_object"] * torch.tensor([x, 1, 1]))
        assert got["normal"] is given["normal"]
    assert flips == {-1.0, 1.0}


def test_a_seed_has_one_place() -> None:
    one, two, other = (Placement(torch.Generator().manual_seed(s)) for s in (3, 3, 4))
    assert torch.equal(one.shift, two.shift)
    assert not torch.equal(one.shift, other.shift)


def test_priors_that_see_no_place_are_left_alone() -> None:
    given = {name: value for name, value in channels().items() if name in ("normal", "mask")}
    assert Placement(torch.Generator().manual_seed(1))(given).keys() == given.keys()


@pytest.mark.parametrize(
    ("prior", "placement", "moves"), [("pocket", "seed", True), ("pocket", "fixed", False), ("exact", "seed", False)]
)
def test_only_a_movable_prior_is_told_another_place(assets, prior, placement, moves) -> None:
    config = preset("pocket")
    config = dataclasses.replace(config, guidance=dataclasses.replace(config.guidance, placement=placement))
    mesh = read_mesh(assets / "meshes/spot/spot.obj")
    painters = [
        Painter(
            mesh,
            "a zebra",
            dataclasses.replace(config, seed=seed),
            PocketPrior() if prior == "pocket" else ExactPrior(),
        )
        for seed in (0, 1)
    ]
    given = channels()
    one, two = (painter.place(given)["position"] for painter in painters)
    assert torch.equal(one, given["position"]) != moves
    assert torch.equal(one, two) != moves
