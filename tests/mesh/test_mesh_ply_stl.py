"""PLY and STL: every spelling of one mesh, and what is refused."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from paintit.errors import MeshError
from paintit.mesh.mesh import Floats
from paintit.mesh.parsed import Parsed
from paintit.mesh.ply import read_ply
from paintit.mesh.stl import read_stl

POINTS = [(0, 0, 0), (2, -1, 0), (0, 3, 0), (-2, -1, 0), (0, 5, 0)]
ARROW = (0, 1, 2, 3)
"""A concave quad: cut from its second to its fourth corner it would reach outside."""


def ply(form: str, faces: list[tuple[int, ...]], more: str = "", uvs: Floats | None = None) -> bytes:
    head = f"ply\nformat {form} 1.0\ncomment made here\nelement vertex {len(POINTS)}\nproperty float x\n"
    head += f"property float y\nproperty float z\n{more}element face {len(faces)}\n"
    head += "property uchar flags\nproperty list uchar int vertex_indices\nend_header\n"
    rows = np.array(POINTS, float) if uvs is None else np.concatenate([POINTS, uvs], 1)
    if form == "ascii":
        body = "".join(" ".join(f"{x:g}" for x in row) + "\n" for row in rows)
        body += "".join(" ".join(map(str, (7, len(face), *face))) + "\n" for face in faces)
        return head.encode() + body.encode()
    order = "<" if "little" in form else ">"
    body = rows.astype(f"{order}f4").tobytes()
    return head.encode() + body + b"".join(struct.pack(f"{order}BB{len(f)}i", 7, len(f), *f) for f in faces)


def area(parsed: Parsed) -> float:
    a, b, c = (parsed.vertices[parsed.faces[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


FORMS = ["ascii", "binary_little_endian", "binary_big_endian"]


@pytest.mark.parametrize("form", FORMS)
def test_concave_and_mixed_polygons(form: str) -> None:
    assert area(read_ply(ply(form, [ARROW]))) == pytest.approx(6.0)
    mixed = read_ply(ply(form, [(0, 1, 2), ARROW, (0, 1), (1, 4, 2)]))
    assert mixed.faces[[0, -1]].tolist() == [[0, 1, 2], [1, 4, 2]]
    assert area(mixed) == pytest.approx(3.0 + 6.0 + 2.0)
    assert mixed.notes == ("left out 1 faces with fewer than 3 corners", "triangulated 1 polygons")


@pytest.mark.parametrize("form", FORMS)
def test_texture_coordinates_count_upward(form: str) -> None:
    uvs = np.arange(10).reshape(5, 2) / 16
    parsed = read_ply(ply(form, [ARROW], "property float s\nproperty float t\n", uvs))
    np.testing.assert_array_equal(parsed.uvs, uvs * (1, -1) + (0, 1))
    np.testing.assert_array_equal(parsed.face_uvs, parsed.faces)


def test_texture_coordinates_at_corners() -> None:
    text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n"
    text += "element face 1\nproperty list uchar int vertex_index\nproperty list uchar float texcoord\nend_header\n"
    parsed = read_ply(f"{text}0 0 0\n1 0 0\n0 1 0\n3 2 0 1 6 .5 .25 0 0 1 0\n".encode())
    np.testing.assert_array_equal(parsed.uvs[parsed.face_uvs[0]], [[0.5, 0.75], [0, 1], [1, 1]])


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("element", ["vertex", "face"])
def test_a_count_that_lies_is_refused_before_memory_is_taken(form: str, element: str) -> None:
    data = ply(form, [ARROW, ARROW])
    count = len(POINTS) if element == "vertex" else 2
    lie = data.replace(f"element {element} {count}".encode(), f"element {element} 4000000000".encode())
    with pytest.raises(MeshError, match=f"does not hold the 4000000000 rows of '{element}'") as error:
        read_ply(lie)
    assert error.value.code == "mesh.truncated"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("float x", "float w", "the PLY file has no vertices with a number 'x'"),
        ("float x", "half x", "cannot read 'property half x' in the header of the PLY file"),
        ("format ascii 1.0\n", "", "the header of the PLY file does not state its format"),
        ("7 4 0 1 2 3", "7 4 0 1 2 9", "a face uses vertex 9 of 5"),
        ("7 4 0 1 2 3", "7 -4 0 1 2 3", "a list of the PLY file has the length -4.0"),
        ("7 4 0 1 2 3", "7 four 0 1 2 3", "the PLY file holds something else than numbers"),
        ("7 4 0 1 2 3", "7 4 0 1 2", "the PLY file is cut off: it does not hold the 1 rows of 'face' that it promises"),
    ],
)
def test_bad_ply(old: str, new: str, message: str) -> None:
    with pytest.raises(MeshError) as error:
        read_ply(ply("ascii", [ARROW]).replace(old.encode(), new.encode(), 1))
    assert error.value.message == message


TRIANGLES = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0.5], [0, 1, 0]]], float)


def stl_text(word: str = "vertex") -> str:
    loops = ("facet normal 0 0 1\nouter loop\n{}endloop\nendfacet\n" for _ in TRIANGLES)
    corners = ("".join(f"  {word} {x} {y} {z}\n" for x, y, z in triangle.tolist()) for triangle in TRIANGLES)
    body = "".join(loop.format(corner) for loop, corner in zip(loops, corners, strict=True))
    return f"solid vertex 1 2 3 endloop\n{body}endsolid a facet\n"


def test_stl_in_both_forms() -> None:
    binary = bytes(80) + struct.pack("<I", 2)
    binary += b"".join(struct.pack("<12fH", 0, 0, 0, *t.ravel(), 0) for t in TRIANGLES)
    for data in (binary, stl_text().encode(), stl_text().upper().encode()):
        parsed = read_stl(data)
        np.testing.assert_array_equal(parsed.vertices[parsed.faces], TRIANGLES)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("  vertex 1.0 1.0 0.5\n", "", "the STL file has 5 vertices in 2 triangles that are complete"),
        ("1.0 1.0 0.5", "1.0 1.0 high", "cannot read a vertex: could not convert string to float: b'high'"),
    ],
)
def test_bad_stl(old: str, new: str, message: str) -> None:
    with pytest.raises(MeshError) as error:
        read_stl(stl_text().replace(old, new).encode())
    assert error.value.message == message
