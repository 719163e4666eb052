"""The same glTF file comes back: field by field, by the Khronos validator, in motion. And a checker that can fail."""

from __future__ import annotations

import dataclasses
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.export.exporting import ASSETS, TESTS, asset, known_maps
from tests.export.gltf_bytes import Gltf
from tests.export.models import MODELS, tampered
from tests.export.playing import corners_at, matrices_at, times
from tests.export.roundtrip import differences

from paintit.export.write import write
from paintit.mesh.mesh import Mesh
from paintit.mesh.read import read_mesh

ANIMATED = ["several_skins", "morph_targets"]
#: Assets, and how each is unwrapped; the two largest keep their UVs, which they have.
REAL = [(name, "auto") for name in ("fox", "rigged_figure", "flight_helmet", "avocado", "water_bottle")]
REAL += [(name, "always") for name in ("fox", "rigged_figure", "avocado")]
#: Materials that are shown; no other may change.
SHOWN = {"variants": ["shoe 0", "shoe 2"]}
MADE = [(name, unwrap) for name in MODELS for unwrap in ("auto", "always", "split")]


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Name of a model or an asset -> its file, made once."""
    made: dict[str, Path] = {}

    def of(name: str) -> Path:
        if name not in MODELS:
            return ASSETS / f"{name}.glb"
        if name not in made:
            made[name] = MODELS[name](tmp_path_factory.mktemp(name))
        return made[name]

    return of


def every_face_an_island(mesh: Mesh) -> Mesh:
    """No two triangles share a texture coordinate: each vertex is split as often as it can be."""
    side = int(np.ceil(np.sqrt(len(mesh.faces))))
    cell = np.stack([np.arange(len(mesh.faces)) % side, np.arange(len(mesh.faces)) // side], -1)
    corners = (cell[:, None] + 0.1 + 0.8 * np.array([[0, 0], [1, 0], [0, 1]])) / side
    faces = np.arange(mesh.faces.size).reshape(-1, 3)
    return dataclasses.replace(mesh, uvs=corners.reshape(-1, 2), face_uvs=faces)


@pytest.fixture(scope="module")
def painted(source: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """(name, unwrap, extension) -> the painted file, made once."""
    done: dict[tuple[str, str, str], Path] = {}

    def of(name: str, unwrap: str, extension: str = ".glb") -> Path:
        key = name, unwrap, extension
        if key not in done:
            path = source(name)
            kind = "auto" if unwrap == "split" else unwrap
            mesh = read_mesh(path, kind) if name in MODELS else asset(path.name, kind)  # pyright: ignore[reportArgumentType]
            mesh = every_face_an_island(mesh) if unwrap == "split" else mesh
            done[key] = tmp_path_factory.mktemp("out") / f"painted{extension}"
            write(done[key], mesh, known_maps(mesh, 8), {"prompt": "x"})
        return done[key]

    return of


@pytest.mark.parametrize(("name", "unwrap"), [*REAL, *MADE])
def test_nothing_but_the_painting_changes(name: str, unwrap: str, source: Any, painted: Any) -> None:
    assert differences(source(name), painted(name, unwrap), SHOWN.get(name)) == []


@pytest.mark.parametrize("name", list(MODELS))
def test_nor_does_it_in_separate_files(name: str, source: Any, painted: Any) -> None:
    assert differences(source(name), painted(name, "auto", ".gltf")) == []


@pytest.mark.judge
def test_the_validator_finds_no_new_error(source: Any, painted: Any) -> None:
    if shutil.which("node") is None or not (TESTS / "node_modules" / "gltf-validator").is_dir():
        pytest.skip("the Khronos validator is not installed: run `npm ci` in tests/")
    kinds = [(name, unwrap, ".glb") for name, unwrap in [*REAL, *MADE]] + [(name, "auto", ".gltf") for name in MODELS]
    files = [str(path) for kind in kinds for path in (source(kind[0]), painted(*kind))]
    done = subprocess.run(
        ["node", str(TESTS / "validate_gltf.mjs"), *files], capture_output=True, text=True, check=True
    )
    errors = [[m["code"] for m in r["issues"]["messages"] if m["severity"] == 0] for r in json.loads(done.stdout)]
    assert len(errors) == 2 * len(kinds)
    for kind, before, after in zip(kinds, errors[::2], errors[1::2], strict=True):
        assert set(after) <= set(before), kind
        assert len(after) <= len(before), kind
        if kind[0] in MODELS:
            assert before == [], kind


@pytest.mark.parametrize(
    ("name", "unwrap"), [(n, u) for n in [*ANIMATED, "fox", "rigged_figure"] for u in ("auto", "split")]
)
def test_animations_play_as_before(name: str, unwrap: str, source: Any, painted: Any) -> None:
    before, after = Gltf(source(name)), Gltf(painted(name, unwrap))
    moved = []
    for animation in range(len(before.json["animations"])):
        for time in times(before):
            old, new = corners_at(before, animation, time), corners_at(after, animation, time)
            assert old.keys() == new.keys()
            for key in old:
                assert np.array_equal(old[key], new[key])
            for x, y in zip(matrices_at(before, animation, time), matrices_at(after, animation, time), strict=True):
                assert np.array_equal(x, y)
            moved.append(np.concatenate([p.reshape(-1, 3) for p in old.values()]))
    assert np.abs(np.diff(moved, axis=0)).max() > 0.01  # they do move


def test_the_rest_pose_is_the_readers(source: Any) -> None:
    """The player of this test against the package's reader, where nothing moves."""
    before = Gltf(source("several_skins"))
    before.json["animations"][0]["channels"] = []
    played = corners_at(before, 0, 0.0)
    mesh = read_mesh(source("several_skins"))
    for part in mesh.parts:
        assert part.primitive is not None
        expected = mesh.vertices[mesh.faces[slice(*part.faces)]]
        np.testing.assert_allclose(played[part.node or 0, part.primitive[1]], expected, atol=1e-6)


# The checker can fail ------------------------------------------------------------------------------------------------

Change = Callable[[dict[str, Any]], Any]
#: Model, how its painted output with split vertices is spoilt, and a word of the report.
TAMPERINGS: list[tuple[str, Change, str]] = [
    ("names_and_scenes", lambda d: d["nodes"][0].update(name="fox"), "nodes[0].name"),
    ("names_and_scenes", lambda d: d["nodes"].append({}), "nodes: "),
    ("names_and_scenes", lambda d: d["scenes"][1].pop("name"), "scenes[1].name: lost"),
    ("names_and_scenes", lambda d: d.update(scene=1), "scene: "),
    ("names_and_scenes", lambda d: d["meshes"].pop(), "meshes: "),
    ("names_and_scenes", lambda d: d["meshes"][0].update(name="thing"), "meshes[0].name"),
    ("names_and_scenes", lambda d: _named(d["textures"], "texture 52").update(name=""), "textures[2]: lost"),
    ("names_and_scenes", lambda d: _named(d["accessors"], "idle").update(count=5), "accessors["),
    ("several_skins", lambda d: d["skins"][0]["joints"].reverse(), "skins[0].joints"),
    ("several_skins", lambda d: d["skins"][1].pop("skeleton"), "skins[1].skeleton"),
    (
        "several_skins",
        lambda d: d["skins"][0].update(inverseBindMatrices=d["skins"][1]["inverseBindMatrices"]),
        "skins",
    ),
    ("several_skins", lambda d: d["nodes"][1].update(translation=[0, 0.41, 0]), "nodes[1].translation"),
    ("several_skins", lambda d: d["animations"][0]["channels"][0]["target"].update(node=2), "channels[0].target.node"),
    ("several_skins", lambda d: d["animations"][0]["samplers"][1].update(interpolation="LINEAR"), "interpolation"),
    ("several_skins", lambda d: d["animations"][0]["samplers"][0].update(output=0), "samplers[0].output"),
    ("several_skins", lambda d: d["animations"][0].pop("extras"), "animations[0].extras"),
    ("several_skins", lambda d: _swap(d, 0, "JOINTS_0", "JOINTS_1"), "JOINTS_0: other values at some corner"),
    ("several_skins", lambda d: _attributes(d, 1).pop("WEIGHTS_1"), "WEIGHTS_1: lost"),
    ("morph_targets", lambda d: d["meshes"][0]["primitives"][0]["targets"].reverse(), "targets[0].POSITION"),
    ("morph_targets", lambda d: d["meshes"][0].update(weights=[0, 0, 0]), "meshes[0].weights"),
    ("morph_targets", lambda d: d["meshes"][0]["extras"]["targetNames"].reverse(), "targetNames"),
    ("morph_targets", lambda d: d["nodes"][0].pop("weights"), "nodes[0].weights"),
    ("two_uv_sets", lambda d: d["materials"][0]["occlusionTexture"].update(texCoord=0), "occlusionTexture.texCoord"),
    ("two_uv_sets", lambda d: d["materials"][0]["emissiveTexture"].update(index=0), "emissiveTexture"),
    ("two_uv_sets", lambda d: d["materials"][0].update(emissiveFactor=[0, 0, 0]), "emissiveFactor"),
    ("two_uv_sets", lambda d: d["materials"][0]["pbrMetallicRoughness"].pop("extras"), "pbrMetallicRoughness.extras"),
    ("two_uv_sets", lambda d: d["samplers"][0].update(wrapS=10497), "sampler.wrapS"),
    ("two_uv_sets", lambda d: _read_painted_uvs(d), "reads TEXCOORD_"),
    ("two_uv_sets", lambda d: _swap(d, 0, "TEXCOORD_1", "TEXCOORD_0"), "TEXCOORD_1: other values"),
    ("sparse_accessors", lambda d: _attributes(d, 0).pop("_HEAT"), "_HEAT: lost"),
    ("quantised_int8", lambda d: _accessor(d, "POSITION").pop("normalized"), "POSITION.normalized: lost"),
    ("quantised_int8", lambda d: d.pop("extensionsRequired"), "extensionsRequired: KHR_mesh_quantization was lost"),
    ("quantised_int8", lambda d: _accessor(d, "NORMAL").update(componentType=5121), "NORMAL.componentType"),
    ("vertex_colours", lambda d: _swap(d, 0, "COLOR_0", "_ID"), "COLOR_0"),
    ("vertex_colours", lambda d: _attributes(d, 0).update(COLOR_2=0), "COLOR_2: added"),
    ("cameras_and_lights", lambda d: d["cameras"][0]["perspective"].update(yfov=0.8), "cameras[0].perspective.yfov"),
    ("cameras_and_lights", lambda d: d["extensions"]["VENDOR_secret"]["extras"]["deep"][0].pop(), "deep[0]"),
    ("cameras_and_lights", lambda d: d["extensionsUsed"].remove("VENDOR_secret"), "VENDOR_secret was lost"),
    ("cameras_and_lights", lambda d: d["meshes"][0].pop("extensions"), "meshes[0].extensions"),
    ("cameras_and_lights", lambda d: d["nodes"][2]["extensions"]["KHR_lights_punctual"].update(light=1), "nodes[2]"),
    ("cameras_and_lights", lambda d: d["nodes"][0].update(extras={"tag": True}), "nodes[0].extras.tag"),
    ("cameras_and_lights", lambda d: d.pop("extras"), "extras"),
    ("cameras_and_lights", lambda d: d["asset"].pop("copyright"), "asset.copyright"),
    ("cameras_and_lights", lambda d: d["asset"]["extras"].pop("mine"), "asset.extras.mine"),
    ("texture_transforms", lambda d: d["materials"][0]["occlusionTexture"].pop("extensions"), "occlusionTexture"),
    ("variants", lambda d: d["extensions"]["KHR_materials_variants"]["variants"].pop(), "variants"),
    ("variants", lambda d: _mappings(d).pop(), "KHR_materials_variants: 2 items became 1"),
    ("variants", lambda d: _mappings(d)[1].update(material=2), "mappings[1].material"),
    ("variants", lambda d: d["materials"][1]["pbrMetallicRoughness"].clear(), "materials[1]"),
    ("gpu_instancing", lambda d: _places(d).update(TRANSLATION=1), "TRANSLATION"),
    ("material_settings", lambda d: d["materials"][0].update(alphaMode="BLEND"), "alphaMode"),
    ("material_settings", lambda d: d["materials"][0].update(doubleSided=False), "doubleSided"),
    ("material_settings", lambda d: d["materials"][1]["pbrMetallicRoughness"].pop("baseColorFactor"), "opacity"),
    ("material_settings", lambda d: d["materials"][2].pop("extensions"), "KHR_materials_emissive_strength: lost"),
    ("material_settings", lambda d: d["materials"][3].pop("extras"), "materials[3].extras"),
    ("shared_accessors", lambda d: d["meshes"][0]["primitives"][4].update(mode=1), "primitives[4]"),
    ("shared_accessors", lambda d: d["meshes"][0]["primitives"].pop(), "primitives: other number"),
    ("shared_accessors", lambda d: d["meshes"][0]["primitives"][1].update(material=0), "primitives[1].material.name"),
    ("topologies", lambda d: d["meshes"][1]["primitives"][0].pop("extras"), "primitives[0].extras"),
    ("topologies", lambda d: d["meshes"][3]["primitives"][0].update(mode=2), "meshes[3].primitives[0].mode"),
]


def _named(items: list[dict[str, Any]], name: str) -> dict[str, Any]:
    return next(item for item in items if item.get("name") == name)


def _attributes(d: dict[str, Any], mesh: int) -> dict[str, int]:
    return d["meshes"][mesh]["primitives"][0]["attributes"]


def _accessor(d: dict[str, Any], name: str) -> dict[str, Any]:
    return d["accessors"][_attributes(d, 0)[name]]


def _swap(d: dict[str, Any], mesh: int, a: str, b: str) -> None:
    attributes = _attributes(d, mesh)
    attributes[a], attributes[b] = attributes[b], attributes[a]


def _mappings(d: dict[str, Any]) -> list[dict[str, Any]]:
    return d["meshes"][0]["primitives"][0]["extensions"]["KHR_materials_variants"]["mappings"]


def _places(d: dict[str, Any]) -> dict[str, int]:
    return d["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]


def _read_painted_uvs(d: dict[str, Any]) -> None:
    """The painted textures move onto set 1, which the kept ones read, and set 1 gets other values."""
    material = d["materials"][0]
    for info in (*material["pbrMetallicRoughness"].values(), material["normalTexture"]):
        if isinstance(info, dict) and "index" in info:
            info["texCoord"] = 1
    _attributes(d, 0)["TEXCOORD_1"] = _attributes(d, 0)["TEXCOORD_2"]


@pytest.mark.parametrize(("name", "change", "word"), TAMPERINGS, ids=[f"{t[0]}-{t[2]}" for t in TAMPERINGS])
def test_what_is_spoilt_is_seen(name: str, change: Change, word: str, source: Any, painted: Any, tmp_path) -> None:
    spoilt = tampered(painted(name, "split"), change, tmp_path / "spoilt.glb")
    found = differences(source(name), spoilt, SHOWN.get(name))
    assert any(word in line for line in found), found


@pytest.mark.parametrize("what", ["image", "vertex", "index"])
def test_spoilt_bytes_are_seen(what: str, source: Any, painted: Any, tmp_path) -> None:
    path = painted("two_uv_sets", "split")
    gltf = Gltf(path)
    (primitive,) = gltf.json["meshes"][0]["primitives"]
    if what == "image":
        kept = gltf.json["textures"][gltf.json["materials"][0]["occlusionTexture"]["index"]]["source"]
        view = gltf.json["images"][kept]["bufferView"]
    else:
        index = primitive["attributes"]["POSITION"] if what == "vertex" else primitive["indices"]
        view = gltf.json["accessors"][index]["bufferView"]
    data = bytearray(path.read_bytes())
    at = data.index(gltf.chunk) + gltf.json["bufferViews"][view]["byteOffset"]
    data[at + 2 if what != "index" else at] ^= 1
    (tmp_path / "spoilt.glb").write_bytes(data)
    assert differences(source("two_uv_sets"), tmp_path / "spoilt.glb") != []


def test_as_a_script(source: Any, painted: Any) -> None:
    script = [sys.executable, str(TESTS / "export" / "roundtrip.py")]
    good = subprocess.run([*script, source("instances"), painted("instances", "auto")], capture_output=True, text=True)
    assert (good.returncode, good.stdout) == (0, "no difference\n")
    bad = subprocess.run([*script, source("instances"), source("data_uris")], capture_output=True, text=True)
    assert bad.returncode == 1
    assert "meshes[0].name: lost" in bad.stdout
