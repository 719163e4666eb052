"""The seam figure on maps with a known answer; the finish that closes seams: what it changes, and what it leaves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.sparse import csr_array
from scipy.sparse.linalg import spsolve
from tests.export.exporting import asset
from tests.mesh.test_seams import cylinder

from paintit.color import decode_srgb, lab
from paintit.export.gltf_source import bilinear
from paintit.export.seam_finish import BAND, REACH, close_seams, conjugate_gradients, seam_differences
from paintit.export.seams import DISTANCE, FLOOR, seam_figure
from paintit.mesh.mesh import Layer, Mesh
from paintit.mesh.seams import EdgePoints, surface_edges
from paintit.mesh.uv import fill_gutters, rasterize_uv
from paintit.render.geometry import Geometry
from paintit.render.texels import texel_points
from paintit.texture.maps import TextureMaps

SIZE = 128


def maps_of(coded: np.ndarray, other: np.ndarray | float = 0.5) -> TextureMaps:
    """From sRGB-coded colours (layers, s, s, 3); ``other`` (layers, s, s, 1) becomes roughness and metalness."""
    linear = decode_srgb(torch.from_numpy(np.ascontiguousarray(coded, np.float32)))
    one = torch.ones(*coded.shape[:3], 1)
    rest = one * torch.as_tensor(other, dtype=torch.float32)
    return TextureMaps(linear, rest, rest.clone(), one * torch.tensor([0.0, 0.0, 1.0]))


def ramp(size: int = SIZE, low: float = 0.3, high: float = 0.6) -> np.ndarray:
    """(1, size, size, 3) grey from ``low`` at u = 0.1 to ``high`` at u = 0.9, which meet at the tube's seam."""
    u = (np.arange(size) + 0.5) / size
    grey = low + (high - low) * (u - 0.1) / 0.8
    return np.broadcast_to(grey[None, None, :, None], (1, size, size, 3)).copy()


def torn(mesh: Mesh, size: int, detail: float = 0.04) -> TextureMaps:
    """Waves of position, finer ones on top, and on every other column of the texture a step that seams show."""
    _, position, _ = texel_points(mesh, Geometry.from_mesh(mesh), size)
    p = position.numpy().astype(np.float64)
    u, v = np.meshgrid((np.arange(size) + 0.5) / size, (np.arange(size) + 0.5) / size)
    smooth = 0.5 + 0.1 * np.sin(4 * p) + detail * np.sin(60 * p[..., [1, 2, 0]])
    step = 0.15 * np.stack([np.sin(9 * u + 5 * v), np.cos(7 * u), np.sin(8 * v)], -1)
    return maps_of(smooth + step, smooth[..., :1] + step[..., :1])


def test_lab_of_known_colours() -> None:
    """White, the red primary and mid grey, from the definition of sRGB and CIELAB."""
    coded = torch.tensor([[1.0, 1.0, 1.0], [1.0, 0.0, 0.0], [0.5, 0.5, 0.5], [0.0, 0.0, 0.0]])
    expected = [[100, 0, 0], [53.24, 80.09, 67.20], [53.39, 0, 0], [0, 0, 0]]
    np.testing.assert_allclose(lab(decode_srgb(coded)).numpy(), expected, atol=0.05)


def test_figure_of_a_ramp_around_a_tube() -> None:
    """Across the seam the ramp's two ends meet; across other edges it differs by its slope times the distance."""
    mesh = cylinder()
    figure = seam_figure(mesh, maps_of(ramp()))
    assert figure is not None
    ends = lab(decode_srgb(torch.tensor([[0.3] * 3, [0.6] * 3])))[:, 0]
    assert figure.edges == 1
    assert figure.seams == pytest.approx(float(ends[1] - ends[0]), rel=0.02)
    # One texel of 0.8 * SIZE around; only the upright edges differ, by no more than one texel's step.
    assert 0 < figure.interior < 1.2 * float(ends[1] - ends[0]) / (0.8 * SIZE)
    assert figure.ratio == pytest.approx(figure.seams / max(figure.interior, FLOOR))
    assert figure.worst == pytest.approx(figure.seams)
    assert figure.worst_at == pytest.approx((1.0, 0.5, 0.0))


def test_figure_of_one_colour_is_one_and_without_seams_none() -> None:
    flat = maps_of(np.full((1, SIZE, SIZE, 3), 0.4))
    figure = seam_figure(cylinder(), flat)
    assert figure is not None
    assert (figure.ratio, figure.seams, figure.interior) == (1.0, 0.0, 0.0)
    assert seam_figure(cylinder(wrap=True), flat) is None


def test_figure_of_a_continuous_picture_is_about_one() -> None:
    """A picture that lives on the surface has no seam: what is measured is the picture, on both kinds of edges."""
    mesh = asset("spot/spot.obj")
    _, position, _ = texel_points(mesh, Geometry.from_mesh(mesh), 256)
    wave = maps_of(0.5 + 0.3 * np.sin(12 * position.numpy()))
    figure = seam_figure(mesh, TextureMaps.unpacked(torch.from_numpy(gutters(mesh, wave))))
    assert figure is not None
    assert 0.5 < figure.ratio < 1.4


def gutters(mesh: Mesh, maps: TextureMaps) -> np.ndarray:
    packed = maps.packed().numpy()
    return fill_gutters(packed, rasterize_uv(mesh, packed.shape[1]).covered)


def test_differences_against_plain_lookups() -> None:
    mesh = asset("spot/spot.obj")
    edges = surface_edges(mesh)
    edges = edges[edges.seam]
    texels = np.random.default_rng(0).random((1, 64, 64, 2)).astype(np.float32)
    matrix = seam_differences(edges, mesh.face_layer[edges.faces[:, 0]], 1, 64)
    span = np.linalg.norm(edges.uv[:, :, 1] - edges.uv[:, :, 0], axis=-1).max(1) * 64
    points = EdgePoints.spread(np.ceil(2 * span).astype(np.int64).clip(1))
    one, other = (bilinear(texels[0], points.along(edges.uv)[:, side]) for side in (0, 1))
    np.testing.assert_allclose(matrix @ texels.reshape(-1, 2), one - other, atol=1e-5)


def test_solver_against_a_direct_one() -> None:
    draw = np.random.default_rng(1)
    loose = csr_array(draw.random((30, 30)) * (draw.random((30, 30)) < 0.2))
    matrix = csr_array(loose.T @ loose + csr_array(np.eye(30)))
    right = draw.random((30, 3))
    solved = conjugate_gradients(matrix, right, draw.random((30, 3)))
    exact = np.stack([spsolve(matrix.tocsc(), right[:, k]) for k in range(3)], 1)
    assert np.abs(solved - exact).max() < 5e-3 * np.abs(exact).max()


def test_a_step_closes_and_fades() -> None:
    """The ends of the ramp meet halfway; the change falls to nothing within the band and keeps its side's sign."""
    mesh, size = cylinder(), 512
    before = maps_of(ramp(size), ramp(size)[..., :1])
    texels = rasterize_uv(mesh, size)
    closed, own = close_seams(mesh, gutters(mesh, before), texels)
    assert (own >= texels.covered).all()
    # What a viewer reads on the seam itself, from either side.
    v = np.linspace(0.25, 0.75, 40)
    sides = [bilinear(closed[0, ..., 3:4], np.stack([np.full_like(v, u), v], 1)) for u in (0.1, 0.9)]
    np.testing.assert_allclose(sides[0], sides[1], atol=0.004)
    np.testing.assert_allclose(sides[0], 0.45, atol=0.01)
    # Half-way up, from the texels just inside either side on.
    row, left, right = size // 2, int(np.ceil(0.1 * size)), int(0.9 * size) - 1
    roughness = closed[0, row, :, 3]
    change = roughness - before.roughness[0, row, :, 0].numpy()
    assert change[left] > 0 > change[right]
    texel = float(np.sqrt(2 * np.pi / 0.8 * 1 / 0.6)) / size  # the root of its area
    band = int(np.ceil(BAND * REACH * mesh.extent / texel)) + 2
    assert (change[left + band : right - band + 1] == 0).all()
    assert (np.diff(change[left : left + band]) < 1e-3).all()


def test_finish_brings_the_figure_down_and_keeps_the_rest() -> None:
    """On a real atlas: the step is gone, texels beyond the band are as painted bit for bit, detail is still there."""
    mesh, size = asset("spot/spot.obj"), 256
    maps = torn(mesh, size)
    texels = rasterize_uv(mesh, size)
    start = gutters(mesh, maps)
    closed, own = close_seams(mesh, start, texels)
    before, after = (seam_figure(mesh, TextureMaps.unpacked(torch.from_numpy(v))) for v in (start, closed))
    assert before is not None
    assert after is not None
    assert before.ratio > 5.0
    assert after.ratio < 1.5
    assert after.interior == pytest.approx(before.interior, rel=0.05)
    same = (closed == start).all(-1) & texels.covered
    assert same.sum() > 0.3 * texels.covered.sum()
    np.testing.assert_array_equal(closed[..., 5:], start[..., 5:])
    # Detail: the painted differences of neighbouring texels are all still there; a 3 x 3 blur leaves half.
    inside = texels.covered[:, :, 1:] & texels.covered[:, :, :-1] & ~(closed == start).all(-1)[:, :, 1:]
    fine, now = (np.diff(v[..., 3], axis=2)[inside].astype(np.float64) for v in (start, closed))
    assert 0.9 < (fine * now).sum() / np.square(fine).sum() < 1.1
    for channel in range(5):
        assert closed[own][:, channel].min() >= start[own][:, channel].min() - 1e-6
        assert closed[own][:, channel].max() <= start[own][:, channel].max() + 1e-6


def test_twice_and_on_more_threads_the_same() -> None:
    mesh = asset("spot/spot.obj")
    start = gutters(mesh, torn(mesh, SIZE))
    threads = torch.get_num_threads()
    try:
        torch.set_num_threads(1)
        first = close_seams(mesh, start, rasterize_uv(mesh, SIZE))[0]
        torch.set_num_threads(2)
        second = close_seams(mesh, start, rasterize_uv(mesh, SIZE))[0]
    finally:
        torch.set_num_threads(threads)
    np.testing.assert_array_equal(first, second)


def test_layers_that_are_not_painted_stay() -> None:
    """Two copies of a tube, one kept: only the painted one changes, and the figure is the painted one's."""
    one = cylinder()
    mesh = replace(
        one,
        vertices=np.concatenate([one.vertices, one.vertices + np.array([5, 0, 0])]),
        faces=np.concatenate([one.faces, one.faces + len(one.vertices)]),
        face_uvs=np.concatenate([one.face_uvs, one.face_uvs]),
        normals=np.concatenate([one.normals] * 2),
        tangents=np.concatenate([one.tangents] * 2),
        face_layer=np.concatenate([one.face_layer, one.face_layer + 1]),
        layers=(Layer("painted"), Layer("kept", painted=False)),
    )
    maps = maps_of(np.concatenate([ramp(), ramp()]))
    closed, _ = close_seams(mesh, maps.packed().numpy(), rasterize_uv(mesh, SIZE))
    assert not np.array_equal(closed[0], maps.packed().numpy()[0])
    np.testing.assert_array_equal(closed[1], maps.packed().numpy()[1])
    figure = seam_figure(mesh, maps)
    assert figure is not None
    assert figure.edges == 1


def test_the_two_points_of_an_edge_are_one_texel_apart() -> None:
    """On a tube whose map has one dark column beside the seam, reading farther than half a texel would miss it."""
    assert DISTANCE == 0.5
    coded = np.full((1, SIZE, SIZE, 3), 0.5)
    coded[:, :, : int(np.ceil(0.1 * SIZE)) + 1] = 0.2
    figure = seam_figure(cylinder(), maps_of(coded))
    assert figure is not None
    step = lab(decode_srgb(torch.tensor([[0.2] * 3, [0.5] * 3])))[:, 0]
    assert figure.seams > 0.6 * float(step[1] - step[0])
