"""What a bad file is answered with, word for word."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from tests.mesh.glb_builder import quad

from paintit.errors import MeshError, UsageError
from paintit.mesh.read import read_mesh

GARBAGE = bytes(np.random.default_rng(7).integers(0, 256, 4000, dtype=np.uint8))
TEXT = b"this is a shopping list\nmilk\nbread\n"


def refused(path: Path, **arguments: str) -> MeshError:
    with pytest.raises(MeshError) as error:
        read_mesh(path, **arguments)  # type: ignore[arg-type]
    assert "\n" not in str(error.value)
    assert error.value.hint
    return error.value


def written(path: Path, data: bytes | str) -> Path:
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return path


def test_missing(tmp_path: Path) -> None:
    error = refused(tmp_path / "gone.obj")
    assert (error.code, error.message) == ("mesh.missing", f"there is no file {tmp_path / 'gone.obj'}")


def test_folder(tmp_path: Path) -> None:
    (tmp_path / "a.obj").mkdir()
    error = refused(tmp_path / "a.obj")
    assert (error.code, error.message) == ("mesh.folder", f"{tmp_path / 'a.obj'} is a folder, not a mesh file")


@pytest.mark.parametrize("name", ["a.obj", "a.ply", "a.stl", "a.off", "a.glb", "a.gltf"])
def test_empty_file(tmp_path: Path, name: str) -> None:
    error = refused(written(tmp_path / name, b""))
    assert (error.code, error.message) == ("mesh.empty_file", f"{tmp_path / name} is empty (0 bytes)")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.obj", "the .obj file holds binary data"),
        ("a.ply", f"this is not a PLY file (it begins with {GARBAGE[:8]!r})"),
        ("a.stl", f"this is not an STL file (it begins with {GARBAGE[:8]!r})"),
        ("a.off", f"this is not an OFF file (it begins with {GARBAGE[:8]!r})"),
        ("a.glb", f"this is not a GLB file (it begins with {GARBAGE[:8]!r})"),
        ("a.gltf", f"this is not a glTF file (it begins with {GARBAGE[:8]!r})"),
    ],
)
def test_garbage_bytes(tmp_path: Path, name: str, message: str) -> None:
    error = refused(written(tmp_path / name, GARBAGE))
    assert (error.code, error.message) == ("mesh.garbage", f"cannot read {tmp_path / name}: {message}")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.obj", "the .obj file holds no OBJ statements (it begins with 'this')"),
        ("a.ply", "this is not a PLY file (it begins with b'this is ')"),
        ("a.stl", "this is not an STL file (it begins with b'this is ')"),
        ("a.off", "this is not an OFF file (it begins with b'this is ')"),
        ("a.glb", "this is not a GLB file (it begins with b'this is ')"),
        ("a.gltf", "this is not a glTF file (it begins with b'this is ')"),
    ],
)
def test_some_other_text(tmp_path: Path, name: str, message: str) -> None:
    error = refused(written(tmp_path / name, TEXT))
    assert (error.code, error.message) == ("mesh.garbage", f"cannot read {tmp_path / name}: {message}")


@pytest.mark.parametrize("name", ["mesh.fbx", "mesh"])
def test_unknown_extension(tmp_path: Path, name: str) -> None:
    path = written(tmp_path / name, TEXT)
    error = refused(path)
    expected = f"{path} is not a mesh file that can be read ('.fbx')" if "." in name else f"{path} has no extension"
    assert (error.code, error.message) == ("mesh.extension", expected)
    assert error.hint == "use one of .obj, .ply, .stl, .off, .glb, .gltf"


PLY = "ply\nformat ascii 1.0\nelement vertex {n}\nproperty float x\nproperty float y\nproperty float z\n"
PLY += "element face {f}\nproperty list uchar int vertex_indices\nend_header\n"


@pytest.mark.parametrize(
    ("name", "data", "vertices"),
    [
        ("a.obj", "v 0 0 0\nv 1 0 0\n", 2),
        ("a.ply", PLY.format(n=3, f=0) + "0 0 0\n1 0 0\n0 1 0\n", 3),
        ("a.stl", "solid nothing\nendsolid nothing\n", 0),
        ("a.stl", bytes(84), 0),
        ("a.off", "OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", 3),
    ],
)
def test_zero_faces(tmp_path: Path, name: str, data: bytes | str, vertices: int) -> None:
    error = refused(written(tmp_path / name, data))
    assert error.code == "mesh.empty"
    assert error.message == f"cannot read {tmp_path / name}: the mesh has no faces ({vertices} vertices, 0 faces)"


def stl(corners: list[list[float]], promised: int = 1) -> bytes:
    return bytes(80) + struct.pack("<I", promised) + struct.pack("<12fH", 0, 0, 0, *np.ravel(corners), 0)


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.ply", PLY.format(n=3, f=1) + "0 0 0\nnan 0 0\n0 1 0\n3 0 1 2\n", "vertex 1 is not finite: [nan, 0.0, 0.0]"),
        ("a.stl", stl([[0, 0, 0], [1, 0, 0], [0, np.inf, 0]]), "vertex 2 is not finite: [0.0, inf, 0.0]"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 nan\n0 1 0\n3 0 1 2\n", "vertex 1 is not finite: [1.0, 0.0, nan]"),
    ],
)
def test_nan(tmp_path: Path, name: str, data: bytes | str, message: str) -> None:
    error = refused(written(tmp_path / name, data))
    assert (error.code, error.message) == ("mesh.nan", f"cannot read {tmp_path / name}: {message}")


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.ply", PLY.format(n=3, f=1) + "0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n"),
    ],
)
def test_index_out_of_range(tmp_path: Path, name: str, data: str) -> None:
    error = refused(written(tmp_path / name, data))
    assert (error.code, error.message) == ("mesh.index", f"cannot read {tmp_path / name}: a face uses vertex 9 of 3")


def test_truncated_glb(tmp_path: Path, assets: Path) -> None:
    data = (assets / "meshes" / "fox.glb").read_bytes()
    error = refused(written(tmp_path / "fox.glb", data[: len(data) // 2]))
    size = f"{len(data) // 2} of {len(data)} bytes"
    assert error.code == "mesh.truncated"
    assert error.message == f"cannot read {tmp_path / 'fox.glb'}: the GLB file is cut off: {size}"
    error = refused(written(tmp_path / "fox.glb", data[:15]))
    assert error.message == f"cannot read {tmp_path / 'fox.glb'}: the GLB file is cut off after 15 bytes"


def test_truncated_stl(tmp_path: Path) -> None:
    error = refused(written(tmp_path / "a.stl", stl([[0, 0, 0], [1, 0, 0], [0, 1, 0]], promised=3)))
    assert error.code == "mesh.truncated"
    assert error.message == (
        f"cannot read {tmp_path / 'a.stl'}: the STL file promises 3 triangles in 234 bytes but holds 134 bytes"
    )


def test_truncated_ply(tmp_path: Path, assets: Path) -> None:
    data = (assets / "meshes" / "koala.ply").read_bytes()
    for share in (0.001, 0.1, 0.5, 0.9):
        error = refused(written(tmp_path / "koala.ply", data[: int(len(data) * share)]))
        assert error.code == "mesh.truncated"


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\nf 1 1 2\n"),
        ("a.stl", stl([[1, 1, 1]] * 3)),
    ],
)
def test_all_faces_degenerate(tmp_path: Path, name: str, data: bytes | str) -> None:
    error = refused(written(tmp_path / name, data))
    assert error.code == "mesh.degenerate"
    count = 2 if name == "a.obj" else 1
    assert error.message == f"cannot read {tmp_path / name}: all {count} faces are degenerate (zero area)"


def test_never_without_texture_coordinates(assets: Path) -> None:
    path = assets / "meshes" / "koala.ply"
    error = refused(path, unwrap="never")
    assert error.code == "mesh.uvs"
    assert error.message == (
        f"cannot read {path}: its texture coordinates cannot be painted on: there are no texture coordinates"
    )
    assert error.hint == "let new ones be made with --unwrap auto, or unwrap the mesh in a 3D program"


def test_unknown_unwrap_mode(assets: Path) -> None:
    with pytest.raises(UsageError, match="unwrap is 'sometimes'; choose auto, always or never"):
        read_mesh(assets / "meshes" / "koala.ply", unwrap="sometimes")  # type: ignore[arg-type]


def test_degenerate_faces_are_kept_and_reported(tmp_path: Path) -> None:
    b = quad()
    b.json["meshes"][0]["primitives"][0]["indices"] = b.accessor([0, 1, 2, 0, 2, 3, 1, 1, 2], "H")
    for unwrap in ("auto", "always"):
        mesh = read_mesh(b.glb(tmp_path / "a.glb"), unwrap=unwrap)  # type: ignore[arg-type]
        assert len(mesh.faces) == 3
        assert "1 degenerate triangles (zero area) kept; they stay invisible" in mesh.report.notes
        assert np.isfinite(mesh.tangents).all()
        assert np.isfinite(mesh.uvs).all()


def test_bad_normals_are_computed_and_reported(tmp_path: Path) -> None:
    b = quad()
    attributes = b.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["NORMAL"] = b.accessor([[0, 0, 1], [0, 0, 0], [0, 0, 1], [0, float("nan"), 1]])
    mesh = read_mesh(b.glb(tmp_path / "a.glb"))
    np.testing.assert_allclose(mesh.normals.reshape(-1, 3), [[0, 0, 1]] * 6)
    assert mesh.report.notes == (
        "computed normals at 2 corners where they were missing or bad (2 bad; flat, as glTF asks)",
    )
