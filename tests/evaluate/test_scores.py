"""Each score moves the right way on a case made for it."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from tests.evaluate.conftest import SIDE, SMALL, around, faces

from paintit.color import luminance
from paintit.errors import PaintitError
from paintit.evaluate.color_difference import ciede2000
from paintit.evaluate.features import load_network
from paintit.evaluate.protocol import Protocol, light_of, sunset, surface
from paintit.evaluate.scores import asset_scores, flatness, janus, saturation, text_score
from paintit.evaluate.truth import truth_scores
from paintit.mesh.mesh import Mesh
from paintit.texture.maps import TextureMaps

Make = Callable[..., TextureMaps]
RED, GREY = torch.tensor([0.6, 0.05, 0.05]), torch.tensor([0.4, 0.4, 0.4])


def baked(share: float) -> torch.Tensor:
    """(side, side, 3) grey with ``share`` of the light that falls on the sphere painted into it."""
    azimuth, polar = around()
    normal = torch.stack([polar.sin() * azimuth.sin(), polar.cos(), polar.sin() * azimuth.cos()], -1)
    light = luminance(light_of(SMALL.light, SMALL.exposure).diffuse(normal))
    return (0.4 * (1 + share * (light / light.mean() - 1))).clamp(0, 1)[..., None].expand(SIDE, SIDE, 3)


def flatness_of(mesh: Mesh, maps: TextureMaps) -> float:
    return flatness(surface(mesh, maps, SMALL), light_of(SMALL.light, SMALL.exposure))


def test_flatness_finds_light_in_the_base_colour(sphere: Mesh, painted: Make) -> None:
    azimuth, _ = around()
    stripes = (0.4 + 0.3 * (12 * azimuth).sin())[..., None].expand(SIDE, SIDE, 3)
    assert flatness_of(sphere, painted(GREY)) == 0
    assert flatness_of(sphere, painted(baked(0.5))) > 0.98
    assert flatness_of(sphere, painted(baked(-0.5))) < -0.98
    assert abs(flatness_of(sphere, painted(stripes))) < 0.1
    assert 0.1 < flatness_of(sphere, painted(0.5 * stripes + 0.5 * baked(0.3))) < 0.9


def test_janus_counts_faces_that_recur(sphere: Mesh, painted: Make) -> None:
    network = load_network("pocket")
    scores = [
        janus(sphere, painted(faces(*azimuths)), SMALL, network) for azimuths in ([0], [0, 180], [0, 90, 180, 270])
    ]
    one, two, four = (score for score in scores if score is not None)
    assert one < 0.2
    assert one + 0.1 < two < four - 0.1
    assert four > 0.8


def test_janus_does_not_care_where_the_face_is(sphere: Mesh, painted: Make) -> None:
    network = load_network("pocket")
    front, back = (janus(sphere, painted(faces(azimuth)), SMALL, network) for azimuth in (0, 180))
    assert back == pytest.approx(front, abs=0.1)


def test_nothing_recurs_where_nothing_is_shown(sphere: Mesh, painted: Make) -> None:
    assert janus(sphere, painted(GREY), SMALL, load_network("pocket")) is None


def test_the_seam_figure_is_among_the_scores(sphere: Mesh, painted: Make) -> None:
    azimuth, polar = around()
    # Once around, and half around, which jumps at azimuth 0; both fade toward the poles, where all meridians meet.
    smooth, torn = (
        painted((0.4 + 0.3 * wave * polar.sin() ** 4)[..., None].expand(SIDE, SIDE, 3))
        for wave in (azimuth.cos(), (azimuth / 2).cos())
    )
    even, jump = (asset_scores(sphere, maps, SMALL)["seam"] or 0 for maps in (smooth, torn))
    assert 0.3 < even < 1.2
    assert jump > 5 * even


def test_saturation_is_mean_chroma(sphere: Mesh, painted: Make) -> None:
    # The primary has a* = 80.09 and b* = 67.20 under D65.
    assert saturation(surface(sphere, painted(torch.tensor([1.0, 0, 0])), SMALL)) == pytest.approx(104.55, abs=0.1)
    assert saturation(surface(sphere, painted(GREY), SMALL)) == pytest.approx(0, abs=0.05)


def test_a_copy_of_the_truth_has_no_error(sphere: Mesh, painted: Make) -> None:
    found = truth_scores(sphere, painted(faces(0)), painted(faces(0)), SMALL)
    assert found.pop("saturation_ratio") == 1
    assert set(found.values()) == {0.0}


def test_errors_are_those_that_were_made(sphere: Mesh, painted: Make) -> None:
    found = truth_scores(sphere, painted(GREY, 0.9, 0.25), painted(RED, 0.4, 1.0), SMALL)
    assert found["roughness_error"] == pytest.approx(0.5, abs=1e-5)
    assert found["metallic_error"] == pytest.approx(0.75, abs=1e-5)
    assert found["saturation_ratio"] == pytest.approx(0, abs=0.01)
    assert found["delta_e"] == pytest.approx(found["delta_e_pixels"], rel=1e-4)
    assert (found["relighting"] or 0) > 0.05
    assert truth_scores(sphere, painted(RED), painted(GREY), SMALL)["saturation_ratio"] is None


def test_a_pattern_elsewhere_costs_pixels_and_no_mean(sphere: Mesh, painted: Make) -> None:
    found = truth_scores(sphere, painted(faces(0)), painted(faces(180)), SMALL)
    assert (found["delta_e"] or 0) < 0.3
    assert (found["delta_e_pixels"] or 0) > 2


def test_the_truth_may_have_other_texture_coordinates_but_no_other_shape(sphere: Mesh, painted: Make) -> None:
    from dataclasses import replace

    turned = replace(sphere, uvs=sphere.uvs * [1, -1] + [0, 1])
    found = truth_scores(sphere, painted(faces(0)), painted(faces(0).flip(0)), SMALL, turned)
    assert (found["delta_e_pixels"] or 0) < 0.1
    flat = replace(sphere, vertices=sphere.vertices * [1, 0.5, 1])
    with pytest.raises(PaintitError, match=r"the truth is another shape: \d+% of the pixels agree"):
        truth_scores(sphere, painted(RED), painted(RED), SMALL, flat)


@pytest.mark.parametrize(
    ("one", "two", "expected"),
    [
        # Rows of the test data of Sharma, Wu and Dalal (2005).
        ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
        ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
        ((50.0, 2.49, -0.001), (50.0, -2.49, 0.0011), 7.2195),
        ((2.0776, 0.0795, -1.135), (0.9033, -0.0636, -0.5514), 0.9082),
    ],
)
def test_ciede2000_is_the_published_one(one: tuple, two: tuple, expected: float) -> None:
    assert float(ciede2000(torch.tensor(one), torch.tensor(two))) == pytest.approx(expected, abs=1e-4)


def test_the_text_score_is_a_cosine_in_hundreds() -> None:
    views = torch.tensor([[1.0, 0.0], [3.0, 4.0], [-1.0, 0.0]])
    assert text_score(views, torch.tensor([[2.0, 0.0]])) == pytest.approx(100 * (1 + 0.6 + 0) / 3)


def test_the_protocol_sees_every_side_alike() -> None:
    cameras = Protocol().cameras()
    assert len(cameras) == Protocol().views == 20
    assert float(cameras.azimuth[0]) == 0
    turns = (cameras.azimuth.rad2deg() % 360).round().sort().values
    assert torch.equal(turns, torch.arange(20.0) * 18)


def test_the_held_out_light_is_as_bright_as_the_first() -> None:
    from paintit.render.environment import mean_radiance

    light = sunset(0.8)
    assert float(luminance(mean_radiance(light.radiance) * light.exposure_factor)) == pytest.approx(0.8)
