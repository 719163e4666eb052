"""A new GLB from OBJ, PLY and STL: valid, faithful, reproducible."""

import dataclasses

import numpy as np
import pytest
from tests.export.exporting import asset, errors_of, image_of, known_maps, load, validator_report

from paintit.export.gltf import write_gltf
from paintit.export.image import encode_maps
from paintit.export.vertices import agree, group_rows, split_corners
from paintit.mesh.read import read_mesh

METADATA = {"prompt": "a spotted cow", "seed": 3, "prior": "pocket"}


@pytest.mark.judge
@pytest.mark.parametrize(
    ("name", "suffix"),
    [
        ("spot/spot.obj", ".glb"),
        ("koala.ply", ".glb"),
        ("teapot/teapot.obj", ".glb"),
        ("wingnut.stl", ".glb"),
        ("teapot/teapot.obj", ".gltf"),
    ],
)
def test_validator_finds_nothing(name: str, suffix: str, tmp_path) -> None:
    mesh = asset(name)
    path = tmp_path / f"out{suffix}"
    write_gltf(path, mesh, known_maps(mesh), METADATA)
    report = validator_report(path)
    assert report["issues"]["messages"] == []
    assert report["info"]["totalTriangleCount"] == len(mesh.faces)
    assert report["info"]["materialCount"] == len(mesh.layers)


@pytest.mark.parametrize("name", ["spot/spot.obj", "koala.ply", "teapot/teapot.obj"])
def test_reads_back_the_same(name: str, tmp_path) -> None:
    """Positions to float32, UVs, normals, tangents and layers of every face corner come back."""
    mesh = asset(name)
    path = tmp_path / "out.glb"
    write_gltf(path, mesh, known_maps(mesh), METADATA)
    again = read_mesh(path)
    order, other = (
        np.lexsort(m.vertices[m.faces].astype(np.float32).reshape(len(m.faces), 9).T) for m in (mesh, again)
    )
    for pick in (lambda m: m.vertices[m.faces], lambda m: m.corner_uvs, lambda m: m.normals):
        np.testing.assert_allclose(pick(mesh)[order], pick(again)[other], atol=2e-6)
    names = lambda m, faces: [m.layers[i].name for i in m.face_layer[faces]]  # noqa: E731
    assert names(mesh, order) == names(again, other)
    document = load(path)
    primitive = document.json["meshes"][0]["primitives"][0]
    tangent = document.accessor(primitive["attributes"]["TANGENT"])[document.accessor(primitive["indices"])[:, 0]]
    first = mesh.face_layer == mesh.face_layer[0]
    if mesh.parts:
        first &= np.isin(
            np.arange(len(mesh.faces)),
            np.concatenate([np.arange(*p.faces) for p in mesh.parts if p.name == mesh.parts[0].name]),
        )
    np.testing.assert_allclose(tangent, mesh.tangents[first].reshape(-1, 4), atol=1e-6)


def test_document(tmp_path) -> None:
    mesh = asset("teapot/teapot.obj")
    maps = known_maps(mesh)
    path = tmp_path / "out.glb"
    write_gltf(path, mesh, maps, METADATA)
    document = load(path)
    assert document.json["asset"]["generator"].startswith("paintit ")
    assert document.json["asset"]["extras"] == {"paintit": METADATA}
    assert [m["name"] for m in document.json["meshes"]] == ["top_teapot_Plane.011", "teapot_Plane.012"]
    for material, encoded, layer in zip(document.json["materials"], encode_maps(maps), mesh.layers, strict=True):
        pbr = material["pbrMetallicRoughness"]
        assert material["name"] == layer.name
        assert (pbr["baseColorFactor"], pbr["metallicFactor"], pbr["roughnessFactor"]) == ([1, 1, 1, 1], 1, 1)
        assert np.array_equal(image_of(document, pbr["baseColorTexture"]), encoded.base_color)
        assert np.array_equal(image_of(document, pbr["metallicRoughnessTexture"]), encoded.orm)
        assert np.array_equal(image_of(document, material["normalTexture"]), encoded.normal)
        assert (encoded.orm[..., 0] == 255).all()


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_bytes_are_reproducible(suffix: str, tmp_path) -> None:
    mesh = asset("teapot/teapot.obj")
    written = []
    for folder in ("a", "b"):
        paths = write_gltf(tmp_path / folder / f"out{suffix}", mesh, known_maps(mesh), METADATA)
        written.append({p.name: p.read_bytes() for p in paths})
    assert written[0] == written[1]
    assert len(written[0]) == (1 if suffix == ".glb" else 8)


def test_far_origin_keeps_its_detail(tmp_path) -> None:
    """A mesh of size 1 at 1e7: float32 there steps by 1, so only a node translation can hold its shape."""
    mesh = asset("spot/spot.obj")
    far = dataclasses.replace(mesh, vertices=mesh.vertices + 1e7)
    path = tmp_path / "far.glb"
    write_gltf(path, far, known_maps(far), {})
    again = read_mesh(path)
    np.testing.assert_allclose(np.sort(again.bounds - far.bounds, axis=None), 0, atol=1e-5)
    assert errors_of(path) == []


def test_group_rows() -> None:
    rows = np.array([[0.0, 1.0], [2.0, 3.0], [-0.0, 1.0], [2.0, 3.5]], np.float32)
    first, group = group_rows([rows])
    assert first.tolist() == [0, 1, 3]
    assert group.tolist() == [0, 1, 0, 2]
    wide = np.random.default_rng(0).integers(0, 3, (500, 3)).astype(np.float64)
    first, group = group_rows([wide, wide[:, :1]])
    assert len(first) == len(np.unique(wide, axis=0))
    assert np.array_equal(wide[first][group], wide)


def test_split_and_agree() -> None:
    corner = np.array([[0, 1, 2], [2, 1, 3]])
    values = np.array([[[0.0], [1], [2]], [[2], [1], [3]]])
    whole = agree(corner, values, 5)
    assert whole is not None
    assert whole[:, 0].tolist() == [0, 1, 2, 3, 0]
    values[1, 0] = 9
    assert agree(corner, values, 5) is None
    split = split_corners([corner, values])
    assert len(split.corner) == 5
    assert np.array_equal(values.reshape(-1, 1)[split.corner][split.indices], values)
