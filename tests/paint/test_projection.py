"""The projection baseline against a prior with one known picture, its parts worked by hand, and exact resume."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import pytest
import torch
from tests.guidance.tiny import save_tiny
from torch import Tensor

from paintit import api
from paintit.color import encode_srgb
from paintit.config import LightConfig, PaintConfig, ProjectionConfig, TextureConfig, ViewConfig, preset
from paintit.errors import PriorError
from paintit.export.finish import finish
from paintit.guidance.exact import ExactPrior, smooth_target
from paintit.guidance.prior import ReadChannel
from paintit.mesh.mesh import Mesh
from paintit.mesh.read import read_mesh
from paintit.paint import checkpoint
from paintit.paint.backproject import Pixels, Seen, Texels, look_up, quality
from paintit.paint.gutters import Gutters
from paintit.paint.projection import PLAIN, Projector
from paintit.paint.tour import ROUND, trust
from paintit.render.camera import look_at
from paintit.render.gbuffer import rasterize
from paintit.render.geometry import Geometry
from paintit.render.texels import texel_points

SIZE = 64
FOV = math.radians(45.0)
BASE = dataclasses.replace(
    preset("pocket"),
    method="projection",
    texture=TextureConfig(size=SIZE),
    views=ViewConfig(size=96, background=0.5, close_up=0.5),
    light=LightConfig(rotation=0.0),
    projection=ProjectionConfig(views=len(ROUND) + 4, steps=2, scale=1.0),
    device="cpu",
)


def with_views(count: int, **changes: object) -> PaintConfig:
    return dataclasses.replace(BASE, projection=dataclasses.replace(BASE.projection, views=count), **changes)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def spot(assets: Path) -> Mesh:
    return read_mesh(assets / "meshes/spot/spot.obj")


def material(projector: Projector) -> Tensor:
    maps = projector.maps()
    return torch.cat([encode_srgb(maps.base_color), maps.roughness, maps.metallic], -1)


def psnr(error: Tensor) -> float:
    return -10 * math.log10(float(error.square().mean()))


def test_projecting_views_of_a_known_texture_gives_it_back(spot):
    """A texel that a view has painted holds what the prior's one picture shows there; finished, every texel does."""
    projector = Projector(spot, "anything", BASE, ExactPrior())
    steps = list(projector)
    assert [step.index for step in steps] == list(range(1, 17))
    assert steps[0].painted == 1.0
    assert all(step.painted is not None and 0 < step.painted < 1 for step in steps[1:])
    covered, position, _ = texel_points(spot, projector.geometry, SIZE)
    wanted, seen = smooth_target(position), projector.support == 1
    share = float(seen[covered].float().mean())
    found = psnr((material(projector) - wanted)[seen])
    maps = finish(spot, projector.maps(), projector.support)
    finished = torch.cat([encode_srgb(maps.base_color), maps.roughness, maps.metallic], -1)
    whole = psnr((finished - wanted)[covered])
    assert share > 0.9
    assert found > 55
    assert whole > 37


class Spread(ExactPrior):
    """With a spread, views differ, so that what is held, refined and blended matters."""

    def __init__(self) -> None:
        super().__init__(deviation=0.3)


def test_one_seed_one_texture_and_a_checkpoint_continues_bit_for_bit(spot, tmp_path):
    config = with_views(len(ROUND) + 3)
    whole = Projector(spot, "red plastic", config, Spread())
    list(whole)
    first = Projector(spot, "red plastic", config, Spread())
    for step in first:
        if step.index == len(ROUND) + 1:
            break
    checkpoint.save(tmp_path / "last.safetensors", first)
    second = Projector(spot, "red plastic", config, Spread())
    checkpoint.load(tmp_path / "last.safetensors", second)
    assert [step.index for step in second] == [len(ROUND) + 2, len(ROUND) + 3]
    assert torch.equal(second.maps().packed(), whole.maps().packed())
    assert torch.equal(second.support, whole.support)
    assert not torch.equal(second.maps().packed(), first.maps().packed())
    other = Projector(spot, "red plastic", dataclasses.replace(config, seed=1), Spread())
    list(other)
    assert not torch.equal(other.maps().packed(), whole.maps().packed())


def test_what_a_view_has_painted_well_the_next_ones_keep(spot):
    """A texel that no later view saw better has hardly moved; one that a later view did has been painted anew."""
    projector = Projector(spot, "anything", with_views(6), Spread())
    steps = iter(projector)
    next(steps)
    before, best = material(projector).clone(), projector.state_dict()["field"]["best"].clone()
    list(steps)
    after, now = material(projector), projector.state_dict()["field"]["best"]
    moved = (after - before).abs().mean(-1)
    kept, anew = (best > 0) & (now == best), (best > 0) & (now > 1.5 * best)
    assert min(int(kept.sum()), int(anew.sum())) > 100
    assert float(moved[kept].mean()) < 0.2 * float(moved[anew].mean())
    assert float((moved[kept] == 0).float().mean()) > 0.5


def test_trust_sorts_pixels_into_new_worse_and_kept(spot):
    size, geometry = 256, Geometry.from_mesh(spot)
    front = look_at(torch.zeros(1), torch.zeros(1), 3.25, FOV)
    near = look_at(torch.zeros(1), torch.zeros(1), 1.3, FOV)
    texels = Texels(spot, geometry, size)
    seen = texels.seen_by(front)
    best = torch.zeros(1, size, size)
    empty = trust(rasterize(geometry, front, 128), best, 3.25, 1.5)
    assert torch.equal(empty.unseen, rasterize(geometry, front, 128).mask)
    best.view(-1)[texels.covered.flatten()] = 1e-9
    best.view(-1)[seen.index] = quality(seen.cosine, seen.depth, 3.25)
    best = Gutters(spot, size, torch.device("cpu")).filled(best[..., None])[..., 0]
    again = trust(rasterize(geometry, front, 128), best, 3.25, 1.5)
    assert not bool(again.unseen.any())
    facing = again.now > 0.5
    assert float(again.badly[facing].float().mean()) < 0.02, "the same view is no better than itself"
    closer = trust(rasterize(geometry, near, 128), best, 3.25, 1.5)
    assert float(closer.badly[closer.now > 1].float().mean()) > 0.98, "one from nearer is"


def test_quality_is_the_squared_cosine_over_the_width_of_a_pixel():
    cosine, depth = torch.tensor([1.0, 0.5, 1.0, 0.0]), torch.tensor([2.0, 2.0, 1.0, 1.0])
    torch.testing.assert_close(quality(cosine, depth, 2.0), torch.tensor([1.0, 0.25, 2.0, 0.0]))


WALL = """
v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1
v -1 -1 1\nv 0 -1 1\nv 0 1 1\nv -1 1 1
vt 0 0\nvt 0.5 0\nvt 0.5 1\nvt 0 1\nvt 1 0\nvt 1 1
f 1/1 2/2 3/3 4/4
f 5/2 6/5 7/6 8/3
"""


@pytest.fixture(scope="module")
def wall(tmp_path_factory: pytest.TempPathFactory) -> Mesh:
    """A wall that faces +Z, the left half of the map, and before its left half a board, the right half of the map."""
    path = tmp_path_factory.mktemp("wall") / "wall.obj"
    path.write_text(WALL)
    return read_mesh(path, "never")


@pytest.mark.parametrize("turn", [0.0, 180.0])
def test_texels_know_whether_and_where_a_camera_sees_them(wall, turn):
    """From the front the board hides what is behind it; from the back the wall hides the board, and is seen itself."""
    geometry = Geometry.from_mesh(wall)
    texels = Texels(wall, geometry, 16)
    camera = look_at(torch.tensor([math.radians(turn)]), torch.zeros(1), 4.0, FOV)
    seen = texels.seen_by(camera)
    sign = 1.0 if turn == 0 else -1.0
    shown = torch.zeros(16, 16, dtype=torch.bool)
    shown.view(-1)[seen.index] = True
    if turn:
        assert bool(shown[:, :8].all())
        assert not bool(shown[:, 8:].any())
    else:
        assert bool(shown[:, 8:].all())
        # The board ends at x = 0, and so does what it hides, seen from straight before it: texel 4 is the first beyond.
        assert not bool(shown[:, :4].any())
        assert bool(shown[:, 4:8].all())
    x, y, z = seen.position.unbind(-1)
    depth = 4.0 - sign * z
    torch.testing.assert_close(seen.depth, depth, atol=1e-5, rtol=0)
    half = math.tan(FOV / 2)
    torch.testing.assert_close(seen.place, torch.stack([sign * x, -y], -1) / (depth * half)[:, None], atol=1e-5, rtol=0)
    eye = torch.tensor([0.0, 0.0, sign * 4.0])
    cosine = (depth / (eye - seen.position).norm(dim=-1)).abs()
    torch.testing.assert_close(seen.cosine, cosine, atol=1e-5, rtol=0)


def at(*places: tuple[float, float], depth: float = 1.0) -> Seen:
    """Texels that face a camera at ``depth``, at these places of its picture."""
    place = torch.tensor(places)
    ones = torch.ones(len(places))
    position = torch.cat([place * math.tan(FOV / 2) * depth, torch.zeros(len(places), 1)], -1)
    return Seen(torch.arange(len(places)), place, position, depth * ones, ones)


def flat(size: int) -> Pixels:
    """All pixels of a picture of the plane that :func:`at` lies in, from distance 1."""
    line = (2 * (torch.arange(size) + 0.5) / size - 1) * math.tan(FOV / 2)
    y, x = torch.meshgrid(line, line, indexing="ij")
    return Pixels(torch.ones(size, size), torch.stack([x, y, torch.zeros_like(x)], -1))


def test_looking_up_is_bilinear_and_worked_by_hand():
    image = torch.tensor([[0.0, 1.0], [2.0, 4.0]])[..., None]
    values, weight = look_up(image, flat(2), at((-0.5, -0.5), (0.5, -0.5), (0.0, 0.0), (0.0, 0.25), (0.75, 0.5)), FOV)
    torch.testing.assert_close(values[:, 0], torch.tensor([0.0, 1.0, 1.75, 0.25 * 0.5 + 0.75 * 3.0, 4.0]))
    torch.testing.assert_close(weight, torch.tensor([1.0, 1.0, 1.0, 1.0, 0.75]), msg="beyond the rim is nothing")


def test_pixels_that_are_held_or_show_another_surface_do_not_speak():
    image = torch.tensor([[0.0, 1.0], [2.0, 4.0]])[..., None]
    held = dataclasses.replace(flat(2), valid=torch.tensor([[1.0, 0.0], [1.0, 1.0]]))
    values, weight = look_up(image, held, at((0.0, 0.0)), FOV)
    torch.testing.assert_close((float(values), float(weight)), (2.0, 0.75))
    far = flat(2)
    far.position[0, 1, 2] -= 10.0
    values, weight = look_up(image, far, at((0.0, 0.0)), FOV)
    torch.testing.assert_close((float(values), float(weight)), (2.0, 0.75))
    silent = dataclasses.replace(flat(2), valid=torch.zeros(2, 2))
    values, weight = look_up(image, silent, at((0.0, 0.0)), FOV)
    assert (float(values), float(weight)) == (0.0, 0.0)


def test_layers_that_are_not_painted_keep_their_look_and_stay_known(assets):
    mesh = api.load_mesh(assets / "meshes/flight_helmet.glb", materials=["LensesMat"])
    projector = Projector(mesh, "red plastic", with_views(2), ExactPrior())
    start = projector.maps().packed()
    list(projector)
    painted = [layer.painted for layer in mesh.layers]
    assert sum(painted) == 1
    assert painted != [True]
    changed = (projector.maps().packed() != start).flatten(1).any(1)
    assert changed.tolist() == painted


class Picture(ExactPrior):
    """Reads pictures alone, as Stable Diffusion does: each is the target's base colour."""

    reads: tuple[ReadChannel, ...] = ("shaded",)

    def encode_image(self, channels):
        return 2 * channels["shaded"].movedim(-1, 1) - 1

    def encode_geometry(self, channels):
        return super().encode_geometry(channels)[:, :3]

    def decode_image(self, x):
        return {"shaded": ((x.movedim(1, -1) + 1) / 2).clamp(0, 1)}


def test_of_a_prior_that_reads_pictures_alone_the_picture_is_the_base_colour(spot):
    projector = Projector(spot, "anything", with_views(3), Picture())
    list(projector)
    seen = projector.support == 1
    _, position, _ = texel_points(spot, projector.geometry, SIZE)
    found = material(projector)[seen]
    assert psnr(found[:, :3] - smooth_target(position)[seen][:, :3]) > 35
    torch.testing.assert_close(found[:, 3:], torch.tensor(PLAIN).expand(len(found), 2))
    shown = projector._read(projector._render(look_at(torch.zeros(1), torch.zeros(1), 3.25, FOV)))
    image = projector._render(look_at(torch.zeros(1), torch.zeros(1), 3.25, FOV))
    on = image.mask[..., 0] > 0
    torch.testing.assert_close(shown["shaded"][on], encode_srgb(image.base_color)[on], msg="no light is added")


def test_depth_conditioned_stable_diffusion_paints_a_mesh_whole(assets, tmp_path):
    """The real classes with small random weights: what they paint is noise, but all of it, and the same twice."""
    pytest.importorskip("diffusers")
    folder = save_tiny(tmp_path / "depth", depth=True)
    config = with_views(2, guidance=dataclasses.replace(BASE.guidance, prior=str(folder)))
    results = [api.paint(assets / "meshes/spot/spot.obj", "a red cow", config=config) for _ in range(2)]
    assert results[0].outcome == "finished after 2 of 2 steps"
    assert torch.equal(results[0].maps.packed(), results[1].maps.packed())
    seen = results[0].support == 1
    color = results[0].maps.base_color[seen]
    assert float(color.std()) > 0.01
    assert results[0].metadata["prior"] == str(folder)
    torch.testing.assert_close(results[0].maps.roughness[seen], torch.full_like(color[:, :1], PLAIN[0]))


def test_a_prior_without_geometry_is_refused_before_anything_is_painted(spot, tmp_path):
    pytest.importorskip("diffusers")
    folder = save_tiny(tmp_path / "plain")
    config = with_views(2, guidance=dataclasses.replace(BASE.guidance, prior=str(folder)))
    with pytest.raises(PriorError, match="sees no geometry") as caught:
        api.paint(spot, "a red cow", config=config)
    assert caught.value.code == "prior.no_geometry"
    assert "sd2-depth" in caught.value.hint
