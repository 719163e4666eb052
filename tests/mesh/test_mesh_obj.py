"""OBJ oddities, one small file each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from paintit.errors import MeshError
from paintit.mesh.mesh import Mesh
from paintit.mesh.obj import read_obj
from paintit.mesh.obj_quick import read_quickly
from paintit.mesh.obj_statements import read_statements
from paintit.mesh.read import read_mesh

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"


def mesh_of(tmp_path: Path, text: str) -> Mesh:
    path = tmp_path / "mesh.obj"
    path.write_bytes(text.encode())
    return read_mesh(path)


def area_vector(mesh: Mesh) -> np.ndarray:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a).sum(0) / 2


@pytest.mark.parametrize(
    "text",
    [
        SQUARE + "f 1/1 2/2 3/3 4/4\n",
        SQUARE + "f -4/-4 -3/-3 -2/-2 -1/-1\n",
        SQUARE.replace(" ", "\t") + "\tf\t1/1\t2/2  3/3\t4/4\n",
        "   " + SQUARE.replace("\n", "\n  ") + "f 1/1 2/2 3/3 4/4",
        SQUARE.replace("\n", "\r\n") + "f 1/1 2/2 \\\r\n 3/3 4/4\r\n",
        "# C:\\models\\\n" + SQUARE + "f 1/1 2/2 3/3 4/4\n",
        "\ufeff" + SQUARE + "f 1/1 2/2 3/3 4/4 # a face\n",
        SQUARE + "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n",
    ],
    ids=["quad", "negative", "tabs", "blanks", "continued", "comment with backslash", "byte order mark", "triangles"],
)
def test_spellings_of_one_square(tmp_path: Path, text: str) -> None:
    mesh = mesh_of(tmp_path, text)
    assert len(mesh.vertices) == 4
    np.testing.assert_allclose(area_vector(mesh), [0, 0, 1])
    # v flipped once: the corner at y = 0 is at the bottom of the image.
    np.testing.assert_allclose(mesh.corner_uvs[..., 0], mesh.vertices[mesh.faces][..., 0])
    np.testing.assert_allclose(mesh.corner_uvs[..., 1], 1 - mesh.vertices[mesh.faces][..., 1])
    np.testing.assert_allclose(mesh.normals.reshape(-1, 3), [[0, 0, 1]] * 6)
    np.testing.assert_allclose(mesh.tangents.reshape(-1, 4), [[1, 0, 0, 1]] * 6, atol=1e-6)


def test_indices_of_position_uv_and_normal_are_independent(tmp_path: Path) -> None:
    text = SQUARE + "vn 0 0 1\nvn 0 0.6 0.8\nf 1/2/2 2/3/1 3/4/1\nf 1/2/1 3/4/1 4/1/1\n"
    mesh = mesh_of(tmp_path, text)
    np.testing.assert_allclose(mesh.corner_uvs[0], [[1, 1], [1, 0], [0, 0]])
    np.testing.assert_allclose(mesh.normals[0, 0], [0, 0.6, 0.8])
    np.testing.assert_allclose(mesh.normals[1, 0], [0, 0, 1])


def test_negative_indices_count_from_where_they_stand(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf -3 -2 -1\n"
    mesh = mesh_of(tmp_path, text)
    assert mesh.faces.tolist() == [[0, 1, 2], [3, 4, 5]]


def test_materials_become_layers_and_objects_parts(tmp_path: Path) -> None:
    text = SQUARE + (
        "mtllib a b.mtl\no one\nusemtl red\nf 1/1 2/2 3/3\nusemtl blue\nf 1/1 3/3 4/4\n"
        "o two\nusemtl red\nf 1/1 2/2 4/4\ng three\nf 2/2 3/3 4/4\n"
    )
    mesh = mesh_of(tmp_path, text)
    assert [layer.name for layer in mesh.layers] == ["red", "blue"]
    assert mesh.face_layer.tolist() == [0, 1, 0, 0]
    assert [(p.name, p.faces, p.layer) for p in mesh.parts] == [
        ("one", (0, 1), 0),
        ("one", (1, 2), 1),
        ("two", (2, 3), 0),
        ("three", (3, 4), 0),
    ]
    assert mesh.source is not None
    assert mesh.source.document.material_libraries == ("a b.mtl",)


def test_the_document_leads_back_to_the_statements() -> None:
    text = SQUARE + "f 1/1 2/2 3/3 4/4\nf 1/4 2/3 3/2\n"
    parsed = read_obj(text.encode())
    document = parsed.document
    assert [document.lines[i] for i in document.polygon_line] == ["f 1/1 2/2 3/3 4/4", "f 1/4 2/3 3/2"]
    assert document.polygon_start.tolist() == [0, 4, 7]
    assert (document.corner_vertex[document.triangle_corner] == parsed.faces).all()
    assert (document.corner_uv[document.triangle_corner] == parsed.face_uvs).all()
    assert (document.corner_normal == -1).all()


def test_concave_polygon_is_cut_inside(tmp_path: Path) -> None:
    arrow = [(0, 0), (2, -1), (0, 3), (-2, -1)]
    star, saw = (
        [(np.cos(a) * r, np.sin(a) * r) for a, r in zip(np.arange(2 * n) * np.pi / n, [3, 1] * n, strict=True)]
        for n in (5, 300)
    )
    for outline in (arrow, arrow[1:] + arrow[:1], star, saw):
        text = "".join(f"v {x} {y} 2\n" for x, y in outline) + "f " + " ".join(str(i + 1) for i in range(len(outline)))
        mesh = mesh_of(tmp_path, text)
        a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
        z = np.cross(b - a, c - a)[:, 2] / 2
        x, y = np.array(outline).T
        outer = 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
        assert (z > 0).all()
        assert z.sum() == pytest.approx(outer)


def test_corners_without_end_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match="too many corners to be cut into triangles \\(the largest 30000\\)"):
        mesh_of(tmp_path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf" + " 1 2 3" * 10_000)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "index 0 of the face corner '0' is out of range (line 4)"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "a face uses v 4 of 3 (line 4)"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -4\n", "index -4 of the face corner '-4' is out of range (line 4)"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/2\n", "a face uses vt 2 of 1 (line 5)"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1//1 2//1 3//1\n", "a face uses vn 1 of 0 (line 4)"),
        ("v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", "vertex 2 is not finite: 'v nan 0 0' (line 2)"),
        ("v 0 0 0\nv 1e999 0 0\nv 0 1 0\nf 1 2 3\n", "vertex 2 is not finite: 'v 1e999 0 0' (line 2)"),
        ("v 0 0 0\nv 1 x 0\nv 0 1 0\nf 1 2 3\n", "cannot read 'v 1 x 0' (line 2)"),
        ("v 0 0 0\nv 1 0\nv 0 1 0\nf 1 2 3\n", "'v 1 0' has too few numbers (line 2)"),
        ("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", "'v 0 0' has too few numbers (line 1)"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 a\n", "cannot read the face corner 'a' (line 4)"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\n", "a face has 2 corners (line 4)"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "the mesh has no faces (3 vertices, 0 faces)"),
    ],
)
def test_bad_statements(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(MeshError) as error:
        mesh_of(tmp_path, text)
    assert error.value.message == f"cannot read {tmp_path / 'mesh.obj'}: {message}"


def test_texture_coordinates_of_one_number(tmp_path: Path) -> None:
    parsed = read_obj(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.25\nvt 0.5\nvt 0.75\nf 1/1 2/2 3/3\n")
    np.testing.assert_allclose(parsed.uvs, [[0.25, 1], [0.5, 1], [0.75, 1]])


def test_faces_of_two_corners_are_left_out(tmp_path: Path) -> None:
    mesh = mesh_of(tmp_path, SQUARE + "f 1/1 2/2\nf 1/1 2/2 3/3\nf 4/4\n")
    assert mesh.faces.tolist() == [[0, 1, 2]]
    assert "left out 2 faces with fewer than 3 corners (the first on line 9)" in mesh.report.notes


PLAIN = [
    SQUARE + "f 1/1 2/2 3/3 4/4\n",
    SQUARE + "vn 0 0 1\no a\nf 1//1 2//1 3//-1\ng b c\nf -4/-4/1 -3/2/-1 -1/4/1\nusemtl red\nf 1 2 4\nf 1/1 2/2\n",
    "v 0 0 0 1 0 0\nv 1e3 -2.5E-3 .5 1 0 0\n# note\nv 0 1 0 0 0 1\nmtllib a.mtl\nbogus\ns 1\nf 3 2 1\ng\nf 1 2 3",
    "f 1 2 3\nv 0 0 0\nv 1 0 0\n\nv\t0 1 0  \nl 1 2\nusemtl\nusemtl b\nf\t1 3 2\nusemtl a\nusemtl b\nf 1 2 3\n",
]
ODD = [
    "v 0 0\n",
    " v 0 0 0\n",
    "f 1 2 x\n",
    "f 0 1 2\n",
    "f 1 2 9\n",
    "f 1/ 2 3\n",
    "f 1/1/1/1 2 3\n",
    "vt 0.5\n",
    "v 1_0 0 0\n",
]
ODD += [
    "v nan 0 0\n",
    "f 1 2 3 # note\n",
    "f 1 2 \\\n3\n",
    "fo 1 2 3\n",
    "f 1 2 3.5\n",
    "f 1 2 99999999999999999999\n",
    "v 1 2 3x\n",
]


@pytest.mark.parametrize("text", PLAIN)
def test_the_quick_reader_agrees_with_the_careful_one(text: str) -> None:
    quick = read_quickly(text.encode(), text.split("\n"))
    careful = read_statements(text.split("\n"))
    assert quick is not None
    for name in careful.__dataclass_fields__:
        a, b = getattr(quick, name), getattr(careful, name)
        assert np.array_equal(a, b) and a.dtype == b.dtype if isinstance(b, np.ndarray) else a == b, name


@pytest.mark.parametrize("line", ODD)
def test_the_quick_reader_leaves_odd_files_to_the_careful_one(line: str) -> None:
    text = PLAIN[0] + line
    assert read_quickly(text.encode(), text.split("\n")) is None
