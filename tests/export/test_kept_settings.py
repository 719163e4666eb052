"""What a material says besides colour, roughness, metalness and relief stays, also where the mesh is unwrapped anew."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.export.exporting import known_maps
from tests.export.gltf_bytes import Gltf
from tests.export.models import MODELS

from paintit.export.write import write
from paintit.mesh.read import read_mesh


@pytest.fixture(params=["auto", "always"])
def pair(request: Any, tmp_path: Path) -> Any:
    """Name of a model -> it before and after painting, with and without an unwrap."""

    def of(name: str) -> tuple[Gltf, Gltf]:
        source = MODELS[name](tmp_path)
        mesh = read_mesh(source, request.param)
        write(tmp_path / "out" / "out.glb", mesh, known_maps(mesh, 8), {})
        return Gltf(source), Gltf(tmp_path / "out" / "out.glb")

    return of


def looked_up(gltf: Gltf, mesh: int, info: dict[str, Any]) -> tuple[np.ndarray, bytes, dict[str, Any]]:
    """Where each corner of each triangle reads a texture, the image there, and how it is sampled."""
    (primitive,) = gltf.json["meshes"][mesh]["primitives"]
    texture = gltf.json["textures"][info["index"]]
    uv = gltf.values(primitive["attributes"][f"TEXCOORD_{info.get('texCoord', 0)}"])[gltf.triangles(primitive)]
    return uv, gltf.image(gltf.json["images"][texture["source"]]), gltf.json["samplers"][texture["sampler"]]


def reads_the_same(pair: tuple[Gltf, Gltf], mesh: int, material: int, slot: str) -> None:
    (uv, image, sampler), (new_uv, new_image, new_sampler) = (
        looked_up(g, mesh, g.json["materials"][material][slot]) for g in pair
    )
    np.testing.assert_array_equal(uv, new_uv)
    assert image == new_image
    assert sampler == new_sampler


def test_occlusion(pair: Any) -> None:
    both = pair("two_uv_sets")
    reads_the_same(both, 0, 0, "occlusionTexture")
    assert [g.json["materials"][0]["occlusionTexture"]["strength"] for g in both] == [0.7, 0.7]


def test_emission(pair: Any) -> None:
    both = pair("two_uv_sets")
    reads_the_same(both, 0, 0, "emissiveTexture")
    assert [g.json["materials"][0]["emissiveFactor"] for g in both] == [[0.1, 0.2, 0.3]] * 2


def test_emission_on_the_only_uv_set_and_its_strength(pair: Any) -> None:
    both = pair("material_settings")
    reads_the_same(both, 2, 2, "emissiveTexture")
    strength = {"KHR_materials_emissive_strength": {"emissiveStrength": 4}}
    assert [g.json["materials"][2]["extensions"] for g in both] == [strength] * 2


def test_clearcoat(pair: Any) -> None:
    before, after = pair("material_settings")
    coats = [g.json["materials"][3]["extensions"]["KHR_materials_clearcoat"] for g in (before, after)]
    lookups = [looked_up(g, 3, coat["clearcoatTexture"]) for g, coat in zip((before, after), coats, strict=True)]
    np.testing.assert_array_equal(lookups[0][0], lookups[1][0])
    assert lookups[0][1:] == lookups[1][1:]
    assert coats[1]["clearcoatFactor"] == 0.5


def test_cut_outs_blends_and_sides(pair: Any) -> None:
    _, after = pair("material_settings")
    leaf, glass, lamp, *_ = after.json["materials"]
    assert (leaf["alphaMode"], leaf["alphaCutoff"], leaf["doubleSided"]) == ("MASK", 0.3, True)
    assert leaf["pbrMetallicRoughness"]["baseColorFactor"] == [1, 1, 1, 0.5]
    assert glass["alphaMode"] == "BLEND"
    assert glass["pbrMetallicRoughness"]["baseColorFactor"] == [1, 1, 1, 0.2]
    assert "doubleSided" not in glass
    assert "alphaMode" not in lamp


def test_the_looks_of_variants_read_their_old_uvs(pair: Any) -> None:
    before, after = pair("variants")
    uvs = []
    for gltf in (before, after):
        primitive = gltf.json["meshes"][0]["primitives"][0]
        other = primitive["extensions"]["KHR_materials_variants"]["mappings"][1]["material"]
        info = gltf.json["materials"][other]["pbrMetallicRoughness"]["baseColorTexture"]
        uvs.append(
            gltf.values(primitive["attributes"][f"TEXCOORD_{info.get('texCoord', 0)}"])[gltf.triangles(primitive)]
        )
        assert gltf.json["materials"][other]["name"] == "shoe 1"
    np.testing.assert_array_equal(uvs[0], uvs[1])
    # The look that was painted is the painted one as a variant too; on another primitive it stays what it was.
    first, second = after.json["meshes"][0]["primitives"]
    own, others = (p["extensions"]["KHR_materials_variants"]["mappings"][0]["material"] for p in (first, second))
    assert own == first["material"] != 0
    assert others == 0
    assert after.json["materials"][0]["pbrMetallicRoughness"].keys() == {"baseColorTexture"}
