"""The input document with new materials: what painting does not touch stays; what it touches is right."""

import copy
import dataclasses

import numpy as np
import pytest
from tests.export.exporting import (
    ASSETS,
    add_image,
    asset,
    errors_of,
    grid_document,
    image_of,
    known_maps,
    load,
    save,
    validator_report,
)

from paintit.export.gltf import write_gltf
from paintit.export.image import encode_maps
from paintit.mesh.gltf_document import GltfDocument
from paintit.mesh.mesh import Mesh
from paintit.mesh.read import read_mesh

FILES = ["fox.glb", "flight_helmet.glb", "rigged_figure.glb", "water_bottle.glb", "avocado.glb"]


def painted(mesh: Mesh, path, size: int = 16) -> GltfDocument:
    write_gltf(path, mesh, known_maps(mesh, size), {"prompt": "x"})
    return load(path)


def corners(document: GltfDocument, primitive: dict, name: str) -> np.ndarray:
    """(corners, k) values of an attribute in the order of the triangles."""
    values = document.accessor(primitive["attributes"][name])
    return values[document.accessor(primitive["indices"])[:, 0]] if "indices" in primitive else values


@pytest.mark.judge
@pytest.mark.parametrize("name", FILES)
def test_validator_finds_no_new_error(name: str, tmp_path) -> None:
    painted(asset(name), tmp_path / "out.glb")
    before, after = errors_of(ASSETS / name), errors_of(tmp_path / "out.glb")
    assert set(after) <= set(before)
    assert len(after) == len(before)


@pytest.mark.parametrize("name", FILES)
def test_the_rest_is_unchanged(name: str, tmp_path) -> None:
    before = load(ASSETS / name)
    after = painted(asset(name), tmp_path / "out.glb")
    for key in ("scene", "scenes", "nodes", "cameras", "extensions", "extras", "extensionsUsed", "extensionsRequired"):
        assert after.json.get(key) == before.json.get(key), key
    assert [m.get("name") for m in after.items("meshes")] == [m.get("name") for m in before.items("meshes")]
    for a, b in zip(after.items("skins"), before.items("skins"), strict=True):
        assert {**a, "inverseBindMatrices": 0} == {**b, "inverseBindMatrices": 0}
        assert np.array_equal(after.accessor(a["inverseBindMatrices"]), before.accessor(b["inverseBindMatrices"]))
    for a, b in zip(after.items("animations"), before.items("animations"), strict=True):
        assert a["channels"] == b["channels"]
        for s, t in zip(a["samplers"], b["samplers"], strict=True):
            assert s.get("interpolation") == t.get("interpolation")
            for end in ("input", "output"):
                assert np.array_equal(after.accessor(s[end]), before.accessor(t[end]))
    for a, b in zip(after.items("materials"), before.items("materials"), strict=True):
        drop = ("pbrMetallicRoughness", "normalTexture", "occlusionTexture", "emissiveTexture")
        assert {k: v for k, v in a.items() if k not in drop} == {k: v for k, v in b.items() if k not in drop}
        for slot in ("occlusionTexture", "emissiveTexture"):
            assert (slot in a) == (slot in b)
            if slot in b:
                assert np.array_equal(image_of(after, a[slot]), image_of(before, b[slot]))
    used = [p for m in after.items("meshes") for p in m["primitives"]]
    for new, old in zip(used, [p for m in before.items("meshes") for p in m["primitives"]], strict=True):
        for attribute in old["attributes"]:
            if attribute != "TANGENT":
                assert np.array_equal(corners(after, new, attribute), corners(before, old, attribute)), attribute


@pytest.mark.parametrize("name", FILES)
def test_reads_back_the_same(name: str, tmp_path) -> None:
    mesh = asset(name)
    painted(mesh, tmp_path / "out.glb")
    again = read_mesh(tmp_path / "out.glb")
    assert again.report.uv_origin == "file"
    assert [layer.name for layer in again.layers] == [layer.name for layer in mesh.layers]
    np.testing.assert_array_equal(again.vertices[again.faces], mesh.vertices[mesh.faces])
    np.testing.assert_allclose(again.corner_uvs, mesh.corner_uvs, atol=1e-7)
    np.testing.assert_allclose(again.normals, mesh.normals, atol=1e-5)


@pytest.mark.parametrize("name", ["avocado.glb", "flight_helmet.glb"])
def test_tangents_are_the_painters(name: str, tmp_path) -> None:
    """Where nodes only turn and move, written tangents turned into the world are those that the painter used."""
    mesh = asset(name)
    document = painted(mesh, tmp_path / "out.glb")
    for part in mesh.parts:
        assert part.node is not None
        assert part.primitive is not None
        x, y, z, w = document.json["nodes"][part.node].get("rotation", (0, 0, 0, 1))
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        primitive = document.json["meshes"][part.primitive[0]]["primitives"][part.primitive[1]]
        written = corners(document, primitive, "TANGENT")
        used = mesh.tangents[slice(*part.faces)].reshape(-1, 4)
        close = ((written[:, :3] @ turn.T * used[:, :3]).sum(1) > 0.999) & (written[:, 3] == used[:, 3])
        assert close.mean() > 0.999


def test_materials_and_size(tmp_path) -> None:
    mesh = asset("water_bottle.glb")
    document = painted(mesh, tmp_path / "out.glb")
    (encoded,) = encode_maps(known_maps(mesh, 16))
    (material,) = document.json["materials"]
    pbr = material["pbrMetallicRoughness"]
    assert (pbr["baseColorFactor"], pbr["metallicFactor"], pbr["roughnessFactor"]) == ([1, 1, 1, 1], 1, 1)
    assert np.array_equal(image_of(document, pbr["baseColorTexture"]), encoded.base_color)
    assert np.array_equal(image_of(document, pbr["metallicRoughnessTexture"]), encoded.orm)
    assert np.array_equal(image_of(document, material["normalTexture"]), encoded.normal)
    assert len(document.json["images"]) == 5  # three new, occlusion, emissive; the old colour and normal are gone
    # Painting the result again must not make it grow.
    again = painted(read_mesh(tmp_path / "out.glb"), tmp_path / "again.glb")
    assert len(again.json["images"]) == 5
    assert (tmp_path / "again.glb").stat().st_size <= (tmp_path / "out.glb").stat().st_size + 64
    assert again.json["asset"]["extras"]["paintit"]["source_generator"].startswith("paintit")


def test_fox_gets_flat_normals_in_bind_space(tmp_path) -> None:
    mesh = asset("fox.glb")
    document = painted(mesh, tmp_path / "out.glb")
    attributes = document.json["meshes"][0]["primitives"][0]["attributes"]
    position = document.accessor(attributes["POSITION"]).astype(np.float64).reshape(-1, 3, 3)
    flat = np.cross(position[:, 1] - position[:, 0], position[:, 2] - position[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    normal = document.accessor(attributes["NORMAL"]).reshape(-1, 3, 3)
    np.testing.assert_allclose(normal, np.repeat(flat[:, None], 3, 1), atol=1e-5)
    assert "indices" not in document.json["meshes"][0]["primitives"][0]


def test_unwrapped_vertices_carry_everything(tmp_path) -> None:
    """Every face its own island: colours, morph targets and the other UV set follow the split vertices."""
    source = save(grid_document([{"name": "m"}]), tmp_path / "in.glb")
    mesh = read_mesh(source, "never")
    islands = (mesh.corner_uvs * 0.5 + 0.06 * np.arange(len(mesh.faces))[:, None, None]).reshape(-1, 2)
    mesh = dataclasses.replace(mesh, uvs=islands, face_uvs=np.arange(mesh.faces.size).reshape(-1, 3))
    before, after = load(source), painted(mesh, tmp_path / "out.glb")
    old, new = (d.json["meshes"][0]["primitives"][0] for d in (before, after))
    assert after.json["accessors"][new["attributes"]["POSITION"]]["count"] == 24
    for name in ("POSITION", "NORMAL", "TEXCOORD_1", "COLOR_0"):
        assert np.array_equal(corners(after, new, name), corners(before, old, name))
    color = after.json["accessors"][new["attributes"]["COLOR_0"]]
    assert (color["componentType"], color["normalized"]) == (5121, True)
    pick = lambda d, p: d.accessor(p["targets"][0]["POSITION"])[d.accessor(p["indices"])[:, 0]]  # noqa: E731
    assert np.array_equal(pick(after, new), pick(before, old))
    np.testing.assert_allclose(corners(after, new, "TEXCOORD_0"), mesh.corner_uvs.reshape(-1, 2), atol=1e-6)
    assert errors_of(tmp_path / "out.glb") == []


def test_other_textures_keep_their_uv_set(tmp_path) -> None:
    """An occlusion texture that stays reads the old UVs, so the unwrapped ones become a set of their own."""
    assembly = grid_document([{"name": "m"}])
    assembly.json["materials"][0]["occlusionTexture"] = {"index": add_image(assembly, np.full((4, 4, 3), 9, np.uint8))}
    source = save(assembly, tmp_path / "in.glb")
    mesh = read_mesh(source, "always")
    before, after = load(source), painted(mesh, tmp_path / "out.glb")
    old, new = (d.json["meshes"][0]["primitives"][0] for d in (before, after))
    assert np.array_equal(corners(after, new, "TEXCOORD_0"), corners(before, old, "TEXCOORD_0"))
    np.testing.assert_allclose(corners(after, new, "TEXCOORD_2"), mesh.corner_uvs.reshape(-1, 2), atol=1e-6)
    (material,) = after.json["materials"]
    assert material["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] == 2
    assert material["normalTexture"]["texCoord"] == 2
    assert "texCoord" not in material["occlusionTexture"]
    assert errors_of(tmp_path / "out.glb") == []


def test_second_uv_set_of_the_file_is_used(tmp_path) -> None:
    assembly = grid_document([{"name": "m"}])
    info = {"index": add_image(assembly, np.full((4, 4, 3), 9, np.uint8)), "texCoord": 1}
    assembly.json["materials"][0]["pbrMetallicRoughness"] = {"baseColorTexture": info}
    source = save(assembly, tmp_path / "in.glb")
    after = painted(read_mesh(source), tmp_path / "out.glb")
    assert after.json["materials"][0]["pbrMetallicRoughness"]["metallicRoughnessTexture"]["texCoord"] == 1
    assert errors_of(tmp_path / "out.glb") == []


@pytest.mark.parametrize(("unwrap", "mode"), [("auto", "MASK"), ("always", "MASK"), ("always", "BLEND")])
def test_alpha_is_kept(unwrap: str, mode: str, tmp_path) -> None:
    """A cut-out keeps its holes: alpha varies along u only, so in any UVs each corner must show its old u."""
    alpha = np.repeat(np.linspace(0, 255, 64).round().astype(np.uint8)[None], 64, 0)
    assembly = grid_document([{"name": "m", "alphaMode": mode, "alphaCutoff": 0.3, "doubleSided": True}])
    color = np.concatenate([np.full((64, 64, 3), 77, np.uint8), alpha[..., None]], -1)
    assembly.json["materials"][0]["pbrMetallicRoughness"] = {
        "baseColorFactor": [0.5, 0.5, 0.5, 0.75],
        "baseColorTexture": {"index": add_image(assembly, color)},
    }
    source = save(assembly, tmp_path / "in.glb")
    mesh = read_mesh(source, unwrap)  # pyright: ignore[reportArgumentType]
    after = painted(mesh, tmp_path / "out.glb", 64)
    material = after.json["materials"][0]
    assert (material["alphaMode"], material["alphaCutoff"], material["doubleSided"]) == (mode, 0.3, True)
    assert material["pbrMetallicRoughness"]["baseColorFactor"] == [1, 1, 1, 0.75]
    image = image_of(after, material["pbrMetallicRoughness"]["baseColorTexture"])
    assert image.shape == (64, 64, 4)
    before = load(source)
    old_uv = corners(before, before.json["meshes"][0]["primitives"][0], "TEXCOORD_0").reshape(-1, 3, 2)
    middle_old, middle_new = old_uv.mean(1), mesh.corner_uvs.mean(1)
    got = image[(middle_new[:, 1] * 64).astype(int), (middle_new[:, 0] * 64).astype(int), 3]
    np.testing.assert_allclose(got / 255, middle_old[:, 0], atol=0.04)


def test_overriding_extensions_go(tmp_path) -> None:
    assembly = grid_document(
        [{"name": "m"}],
        extensionsUsed=[
            "KHR_materials_pbrSpecularGlossiness",
            "KHR_materials_unlit",
            "KHR_materials_ior",
            "KHR_texture_transform",
        ],
    )
    texture = add_image(assembly, np.full((4, 4, 3), 9, np.uint8))
    transform = {"KHR_texture_transform": {"scale": [2, 2]}}
    assembly.json["materials"][0] |= {
        "pbrMetallicRoughness": {"baseColorTexture": {"index": texture, "extensions": transform}},
        "extensions": {
            "KHR_materials_unlit": {},
            "KHR_materials_ior": {"ior": 1.4},
            "KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [1, 1, 1, 0.5]},
        },
    }
    after = painted(read_mesh(save(assembly, tmp_path / "in.glb")), tmp_path / "out.glb")
    (material,) = after.json["materials"]
    assert material["extensions"] == {"KHR_materials_ior": {"ior": 1.4}}
    assert material["pbrMetallicRoughness"]["baseColorFactor"][3] == 0.5
    assert "extensions" not in material["pbrMetallicRoughness"]["baseColorTexture"]
    assert after.json["extensionsUsed"] == ["KHR_materials_ior"]
    assert len(after.json["asset"]["extras"]["paintit"]["notes"]) == 2
    assert errors_of(tmp_path / "out.glb") == []


@pytest.mark.parametrize("own_uvs", [False, True])
def test_mirrored_twin(own_uvs: bool, tmp_path) -> None:
    """Two nodes show one glTF mesh, the second mirrored: winding, UVs and tangents hold for both, and where the second
    has UVs of its own it gets a copy of the glTF mesh."""
    assembly = grid_document([{"name": "m"}])
    assembly.json["nodes"].append({"mesh": 0, "scale": [-1, 1, 1], "translation": [5, 0, 0]})
    assembly.json["scenes"][0]["nodes"].append(1)
    source = save(assembly, tmp_path / "in.glb")
    mesh = read_mesh(source, "never")
    if own_uvs:
        uvs = mesh.corner_uvs * 0.5
        uvs[slice(*mesh.parts[1].faces)] += 0.5
        mesh = dataclasses.replace(mesh, uvs=uvs.reshape(-1, 2), face_uvs=np.arange(mesh.faces.size).reshape(-1, 3))
    after = painted(mesh, tmp_path / "out.glb")
    again = read_mesh(tmp_path / "out.glb", "never")
    np.testing.assert_allclose(again.vertices[again.faces], mesh.vertices[mesh.faces], atol=1e-6)
    np.testing.assert_allclose(again.corner_uvs, mesh.corner_uvs, atol=1e-6)
    assert len(after.json["meshes"]) == (2 if own_uvs else 1)
    assert after.json["meshes"][0]["primitives"][0]["material"] == 0
    # In each primitive's own space the bitangent points up the image whatever its node does.
    for gltf_mesh in after.json["meshes"]:
        primitive = gltf_mesh["primitives"][0]
        tangent, normal = corners(after, primitive, "TANGENT"), corners(after, primitive, "NORMAL")
        position = corners(after, primitive, "POSITION").reshape(-1, 3, 3)
        uv = corners(after, primitive, "TEXCOORD_0").reshape(-1, 3, 2).astype(np.float64)
        d, t = position[:, 1:] - position[:, :1], uv[:, 1:] - uv[:, :1]
        gradient = np.linalg.solve(t, d.astype(np.float64))  # rows: dP/du, dP/dv (v downward)
        bitangent = np.cross(normal, tangent[:, :3]) * tangent[:, 3:]
        assert ((bitangent.reshape(-1, 3, 3) * -gradient[:, None, 1]).sum(-1) > 0).all()
        assert ((tangent[:, :3].reshape(-1, 3, 3) * gradient[:, None, 0]).sum(-1) > 0).all()
    assert errors_of(tmp_path / "out.glb") == []


def test_default_and_shared_materials(tmp_path) -> None:
    """A primitive without a material gets one; a material that lines use too is copied, not changed."""
    assembly = grid_document([{"name": "m", "pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}}])
    (mesh,) = assembly.json["meshes"]
    del mesh["primitives"][0]["targets"]
    bare = copy.deepcopy(mesh["primitives"][0])
    del bare["material"]
    lines = {"attributes": {"POSITION": bare["attributes"]["POSITION"]}, "mode": 1, "material": 0}
    mesh["primitives"] += [bare, lines]
    source = save(assembly, tmp_path / "in.glb")
    after = painted(read_mesh(source), tmp_path / "out.glb")
    first, second, third = after.json["meshes"][0]["primitives"]
    assert third["material"] == 0
    assert after.json["materials"][0] == load(source).json["materials"][0]
    assert len({first["material"], second["material"], 0}) == 3
    assert errors_of(tmp_path / "out.glb") == []


def test_gltf_with_files_beside_it(tmp_path) -> None:
    mesh = asset("water_bottle.glb")
    paths = write_gltf(tmp_path / "my bottle.gltf", mesh, known_maps(mesh), {})
    assert len(paths) == 2 + 3
    assert validator_report(paths[-1])["issues"]["numErrors"] == 0
    moved = tmp_path / "glb" / "out.glb"
    again = read_mesh(paths[-1])
    write_gltf(moved, again, known_maps(again), {})  # images from files move into the .glb
    assert all("uri" not in image for image in load(moved).json["images"])
    assert errors_of(moved) == []
