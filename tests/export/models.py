"""glTF files made in code, one for each feature that a painted file must bring back untouched."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from PIL import Image
from tests.mesh.glb_builder import Builder

Model = Callable[[Path], Path]
#: Name -> a function that writes the file into a folder and returns its path.
MODELS: dict[str, Model] = {}


def model(make: Model) -> Model:
    MODELS[make.__name__] = make
    return make


def png(seed: int, size: int = 8, alpha: bool = False) -> bytes:
    """A small random picture."""
    pixels = np.random.default_rng(seed).integers(0, 256, (size, size, 4 if alpha else 3), np.uint8)
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, format="PNG")
    return out.getvalue()


class Model3D(Builder):
    """A builder with a scene, one wavy grid per call, and what the features need."""

    def __init__(self) -> None:
        super().__init__()
        self.json |= {"scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": []}

    def add(self, kind: str, value: dict[str, Any]) -> int:
        self.json.setdefault(kind, []).append(value)
        return len(self.json[kind]) - 1

    def node(self, shown: bool = True, **values: Any) -> int:
        index = self.add("nodes", values)
        if shown:
            self.json["scenes"][0]["nodes"].append(index)
        return index

    def position(self, values: np.ndarray, code: str = "f", **extra: Any) -> int:
        kind = np.float32 if code == "f" else code
        stored = np.asarray(values, kind)
        bounds = {"min": stored.min(0).tolist(), "max": stored.max(0).tolist()}
        return self.accessor(stored, code, **bounds, **extra)

    def padded(self, values: np.ndarray, code: str, **extra: Any) -> int:
        """Vertices whose rows are filled up to a multiple of four bytes."""
        rows = np.asarray(values).astype(np.dtype(code).newbyteorder("<"))
        width = rows.shape[1] * rows.dtype.itemsize
        stride = -(-width // 4) * 4
        table = np.zeros((len(rows), stride), np.uint8)
        table[:, :width] = rows.view(np.uint8).reshape(len(rows), width)
        index = self.accessor(rows, code, **extra)
        self.json["accessors"][index]["bufferView"] = self.view(table.tobytes(), byteStride=stride)
        return index

    def grid(self, side: int = 4, uv: bool = True, **values: Any) -> dict[str, Any]:
        """A wavy grid of ``side`` x ``side`` vertices as a primitive, with normals and texture coordinates."""
        attributes = {"POSITION": self.position(grid_points(side)), "NORMAL": self.accessor(grid_normals(side))}
        if uv:
            attributes["TEXCOORD_0"] = self.accessor(grid_uvs(side))
        return {"attributes": attributes, "indices": self.accessor(grid_faces(side).reshape(-1), "H"), **values}

    def image(self, seed: int, **values: Any) -> int:
        """An embedded picture."""
        return self.add("images", {"bufferView": self.view(png(seed, **values)), "mimeType": "image/png"})

    def texture(self, seed: int, **values: Any) -> int:
        if "samplers" not in self.json:
            self.add("samplers", {"wrapS": 33071, "name": "clamped", "extras": {"why": "edges"}})
        return self.add("textures", {"source": self.image(seed, **values), "sampler": 0, "name": f"texture {seed}"})

    def uses(self, *extensions: str) -> None:
        self.json.setdefault("extensionsUsed", []).extend(extensions)

    def sparse(self, values: np.ndarray, base: np.ndarray | None = None, **extra: Any) -> int:
        """Sparse accessor: ``values`` where they differ from ``base`` (zeros where it is None)."""
        full = np.zeros_like(values) if base is None else base
        rows = np.flatnonzero((values != full).any(1))
        index = self.accessor(full if base is not None else values, "f", **extra)
        accessor = self.json["accessors"][index]
        if base is None:
            del accessor["bufferView"]
        accessor["sparse"] = {
            "count": len(rows),
            "indices": {"bufferView": self.view(rows.astype("<u2").tobytes()), "componentType": 5123},
            "values": {"bufferView": self.view(values[rows].astype("<f4").tobytes())},
        }
        return index

    def channel(self, node: int, path: str, times: list[float], values: Any, interpolation: str = "LINEAR") -> None:
        """One more channel of the first animation."""
        if "animations" not in self.json:
            self.add("animations", {"name": "play", "samplers": [], "channels": [], "extras": {"loop": True}})
        animation = self.json["animations"][0]
        time = self.accessor(np.array(times, np.float32), "f", min=[min(times)], max=[max(times)])
        table = np.asarray(values, np.float32)
        output = self.accessor(table.reshape(-1, 1) if path == "weights" else table)
        animation["samplers"].append({"input": time, "output": output, "interpolation": interpolation})
        target = {"node": node, "path": path}
        animation["channels"].append({"sampler": len(animation["samplers"]) - 1, "target": target})


def grid_points(side: int) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side))
    return np.stack([x, y, 0.3 * np.sin(2 * x) * np.cos(y)], -1).reshape(-1, 3).astype(np.float32)


def grid_normals(side: int) -> np.ndarray:
    x, y, _ = grid_points(side).astype(np.float64).T
    normal = np.stack([-0.6 * np.cos(2 * x) * np.cos(y), 0.3 * np.sin(2 * x) * np.sin(y), np.ones_like(x)], -1)
    return (normal / np.linalg.norm(normal, axis=1, keepdims=True)).astype(np.float32)


def grid_uvs(side: int) -> np.ndarray:
    return (grid_points(side)[:, :2] * (0.45, -0.45) + 0.5).astype(np.float32)


def grid_faces(side: int) -> np.ndarray:
    i = np.arange(side * side).reshape(side, side)
    a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, 1:].ravel(), i[1:, :-1].ravel()
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def turn(axis: tuple[float, float, float], degrees: float) -> list[float]:
    half = np.radians(degrees) / 2
    return [*(np.array(axis) * np.sin(half)).tolist(), float(np.cos(half))]


@model
def several_skins(folder: Path) -> Path:
    """Two skinned meshes with two sets of joints each, one skeleton shared in part, all three interpolations."""
    m = Model3D()
    joints = [m.node(name=f"joint {i}", translation=[0, 0.4 * i, 0], shown=False) for i in range(4)]
    m.json["nodes"][joints[0]]["children"] = joints[1:3]
    m.json["nodes"][joints[2]]["children"] = [joints[3]]
    m.json["scenes"][0]["nodes"].append(joints[0])
    rng = np.random.default_rng(1)
    for skin, used in enumerate((joints, [joints[2], joints[0]])):
        grid = m.grid()
        for k in range(2):
            index = rng.integers(0, len(used), (16, 4)).astype(np.uint8)
            weight = rng.dirichlet(np.ones(4), 16) / 2
            # A joint of a vertex may be named once only.
            index[:] = [0, 1, *((2, 3) if len(used) == 4 else (0, 0))]
            weight[:, len(used) :] = 0
            weight[:, 0] = 0.5 - weight[:, 1:].sum(1)
            grid["attributes"][f"JOINTS_{k}"] = m.accessor(index if k == 0 else np.zeros_like(index), "B")
            stored = weight * 2 if k == 0 else np.zeros_like(weight)
            grid["attributes"][f"WEIGHTS_{k}"] = m.accessor(stored.astype(np.float32))
        inverse = np.tile(np.eye(4, dtype=np.float32), (len(used), 1, 1))
        inverse[:, 3, :3] = rng.normal(0, 0.2, (len(used), 3))
        matrices = m.accessor(inverse.reshape(-1, 16), name="inverse bind")
        m.add("skins", {"joints": used, "inverseBindMatrices": matrices, "skeleton": joints[0], "name": f"skin {skin}"})
        mesh = m.add("meshes", {"primitives": [grid], "name": f"body {skin}"})
        m.node(mesh=mesh, skin=skin, name=f"body {skin}")
    m.channel(joints[1], "rotation", [0, 1, 2], [turn((0, 0, 1), a) for a in (0, 50, -20)])
    m.channel(joints[2], "translation", [0.5, 1.5], [[0, 0.8, 0], [0.3, 1, 0.2]], "STEP")
    spline = rng.normal(0, 0.3, (3, 3, 3))
    m.channel(joints[3], "scale", [0, 1, 2], (spline + np.array([[0], [1], [0]])).reshape(-1, 3), "CUBICSPLINE")
    return m.glb(folder / "several_skins.glb")


@model
def morph_targets(folder: Path) -> Path:
    """Sparse deltas, names in extras, default weights, weights of the node, an animation of them."""
    m = Model3D()
    grid = m.grid()
    rng = np.random.default_rng(2)
    targets = []
    for k in range(3):
        delta = np.zeros((16, 3), np.float32)
        delta[k : k + 5] = rng.normal(0, 0.2, (5, 3))
        bounds = {"min": delta.min(0).tolist(), "max": delta.max(0).tolist()}
        targets.append({"POSITION": m.sparse(delta, **bounds), "NORMAL": m.accessor(delta * np.float32(0.1))})
    grid["targets"] = targets
    names = {"targetNames": ["smile", "frown", "blink"], "more": [1, {"a": None}]}
    mesh = m.add("meshes", {"primitives": [grid], "weights": [0.25, 0.0, 0.5], "extras": names, "name": "face"})
    node = m.node(mesh=mesh, weights=[0.1, 0.2, 0.0])
    m.node(mesh=mesh, translation=[3, 0, 0])
    m.channel(node, "weights", [0, 1, 2], rng.uniform(0, 1, (3, 3)))
    return m.glb(folder / "morph_targets.glb")


@model
def two_uv_sets(folder: Path) -> Path:
    """Occlusion and emission on set 1, colour on set 0."""
    m = Model3D()
    grid = m.grid(material=0)
    grid["attributes"]["TEXCOORD_1"] = m.accessor(np.ascontiguousarray(grid_uvs(4)[:, ::-1] * 3))
    m.add(
        "materials",
        {
            "name": "skin",
            "pbrMetallicRoughness": {"baseColorTexture": {"index": m.texture(1)}, "extras": {"kept": 1}},
            "occlusionTexture": {"index": m.texture(2), "texCoord": 1, "strength": 0.7},
            "emissiveTexture": {"index": m.texture(3), "texCoord": 1},
            "emissiveFactor": [0.1, 0.2, 0.3],
        },
    )
    m.node(mesh=m.add("meshes", {"primitives": [grid]}))
    return m.glb(folder / "two_uv_sets.glb")


@model
def sparse_accessors(folder: Path) -> Path:
    """Positions and texture coordinates that are sparse over a base, one over zeros."""
    m = Model3D()
    points, uvs = grid_points(4), grid_uvs(4)
    base, flat = points.copy(), uvs.copy()
    base[3:6], flat[:4] = 0.5, 0.25
    bounds = {"min": points.min(0).tolist(), "max": points.max(0).tolist()}
    attributes = {
        "POSITION": m.sparse(points, base, **bounds, name="points"),
        "NORMAL": m.accessor(grid_normals(4)),
        "TEXCOORD_0": m.sparse(uvs, flat),
        "_HEAT": m.sparse(np.arange(16, dtype=np.float32)[:, None]),
    }
    grid = {"attributes": attributes, "indices": m.accessor(grid_faces(4).reshape(-1), "B")}
    m.node(mesh=m.add("meshes", {"primitives": [grid]}))
    return m.glb(folder / "sparse_accessors.glb")


def _quantised(code: str, normalized: bool, folder: Path) -> Path:
    """KHR_mesh_quantization: integer positions with the node that brings them back to size."""
    m = Model3D()
    m.uses("KHR_mesh_quantization")
    m.json["extensionsRequired"] = ["KHR_mesh_quantization"]
    limit = np.iinfo(code).max
    flag = {"normalized": True} if normalized else {}
    points = np.rint(grid_points(4) * limit).astype(code)
    bounds = {"min": points.min(0).tolist(), "max": points.max(0).tolist()}
    scale = 2.5 if normalized else 2.5 / limit
    texel = np.rint(grid_uvs(4) * 65535).astype(np.uint16)
    delta = np.rint(grid_points(4)[:, ::-1] * limit / 4).astype(code)
    attributes = {
        "POSITION": m.padded(points, code, **flag, **bounds),
        "NORMAL": m.padded(np.rint(grid_normals(4) * 127).astype(np.int8), "b", normalized=True),
        "TEXCOORD_0": m.padded(texel, "H", normalized=True),
    }
    target = {"POSITION": m.padded(delta, code, **flag, min=delta.min(0).tolist(), max=delta.max(0).tolist())}
    grid = {"attributes": attributes, "indices": m.accessor(grid_faces(4).reshape(-1), "H"), "targets": [target]}
    mesh = m.add("meshes", {"primitives": [grid], "weights": [0.5]})
    m.node(mesh=mesh, scale=[scale] * 3, translation=[10, 0, 0], name="dequantised")
    return m.glb(folder / "quantised.glb")


@model
def quantised_int16(folder: Path) -> Path:
    return _quantised("h", True, folder)


@model
def quantised_int8(folder: Path) -> Path:
    return _quantised("b", True, folder)


@model
def quantised_plain(folder: Path) -> Path:
    return _quantised("h", False, folder)


@model
def separate_files(folder: Path) -> Path:
    """A .bin and images beside it, names with blanks, accents and percent signs."""
    m = Model3D()
    grid = m.grid(material=0)
    names = ["Holz dunkel.png", "écorce.png", "100% sure.png", "sub/inner.png"]
    (folder / "sub").mkdir()
    for i, name in enumerate(names):
        (folder / name).write_bytes(png(10 + i))
        m.add("images", {"uri": quote(name) if i != 1 else name, "name": f"image {i}"})
        m.add("textures", {"source": i})
    m.add(
        "materials",
        {
            "name": "bark",
            "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
            "occlusionTexture": {"index": 1},
            "emissiveTexture": {"index": 2},
            "emissiveFactor": [1, 1, 1],
        },
    )
    m.add("materials", {"name": "unused", "pbrMetallicRoughness": {"baseColorTexture": {"index": 3}}})
    m.node(mesh=m.add("meshes", {"primitives": [grid]}))
    (folder / "ge ometrie é.bin").write_bytes(m.body)
    return m.gltf(folder / "separate files.gltf", quote("ge ometrie é.bin"))


@model
def data_uris(folder: Path) -> Path:
    """Buffer and image inside the text."""
    m = Model3D()
    grid = m.grid(material=0)
    uri = "data:image/png;base64," + base64.b64encode(png(20)).decode()
    texture = m.add("textures", {"source": m.add("images", {"uri": uri})})
    m.add("materials", {"occlusionTexture": {"index": texture}})
    m.node(mesh=m.add("meshes", {"primitives": [grid]}))
    return m.gltf(folder / "data_uris.gltf")


@model
def instances(folder: Path) -> Path:
    """One mesh under turned, scaled and mirrored nodes, a child among them, matrices too."""
    m = Model3D()
    mesh = m.add("meshes", {"primitives": [m.grid(material=0)], "name": "tile"})
    m.add("materials", {"name": "tile"})
    child = m.node(mesh=mesh, scale=[1, -1, 1], shown=False)
    m.node(mesh=mesh, children=[child], rotation=turn((0, 1, 0), 40))
    m.node(mesh=mesh, scale=[-1, 2, 1], translation=[4, 0, 0])
    m.node(mesh=mesh, matrix=np.diag([-2.0, -2.0, -2.0, 1.0]).ravel().tolist())
    return m.glb(folder / "instances.glb")


@model
def shared_accessors(folder: Path) -> Path:
    """Several primitives on the same vertices, two on one material, one without."""
    m = Model3D()
    whole = m.grid(5)
    faces = grid_faces(5)
    for name in ("wood", "iron"):
        m.add("materials", {"name": name})
    primitives = []
    for k, material in enumerate((0, 1, 0, None)):
        indices = m.accessor(faces[k::4].reshape(-1), "I")
        primitive = {"attributes": dict(whole["attributes"]), "indices": indices}
        primitives.append(primitive | ({} if material is None else {"material": material}))
    primitives.append({"attributes": {"POSITION": whole["attributes"]["POSITION"]}, "mode": 0, "material": 0})
    m.node(mesh=m.add("meshes", {"primitives": primitives, "name": "patchwork"}))
    return m.glb(folder / "shared_accessors.glb")


@model
def topologies(folder: Path) -> Path:
    """Without indices, a strip with joins, a fan, and lines."""
    m = Model3D()
    order = grid_faces(3).reshape(-1)
    loose = {
        "POSITION": m.position(grid_points(3)[order]),
        "TEXCOORD_0": m.accessor(grid_uvs(3)[order]),
        "COLOR_0": m.accessor(np.random.default_rng(3).uniform(0, 1, (len(order), 3)).astype(np.float32)),
    }
    strip = m.grid(3, mode=5, extras="strip")
    strip["indices"] = m.accessor(np.array([0, 3, 1, 4, 2, 5, 5, 3, 3, 6, 4, 7, 5, 8]), "H")
    ring = np.array([[0, 0, 0.2], *[[np.cos(a), np.sin(a), 0] for a in np.linspace(0, 5, 7)]], np.float32)
    fan = {
        "attributes": {"POSITION": m.position(ring), "TEXCOORD_0": m.accessor(ring[:, :2] * np.float32(0.4) + 0.5)},
        "mode": 6,
    }
    lines = {"attributes": {"POSITION": m.position(ring)}, "mode": 3}
    for k, primitive in enumerate(({"attributes": loose}, strip, fan, lines)):
        m.node(mesh=m.add("meshes", {"primitives": [primitive]}), translation=[3 * k, 0, 0])
    return m.glb(folder / "topologies.glb")


@model
def vertex_colours(folder: Path) -> Path:
    m = Model3D()
    grid = m.grid()
    rng = np.random.default_rng(4)
    grid["attributes"]["COLOR_0"] = m.accessor(rng.integers(0, 256, (16, 4)), "B", normalized=True)
    grid["attributes"]["COLOR_1"] = m.accessor(rng.integers(0, 65536, (16, 4)), "H", normalized=True)
    grid["attributes"]["_ID"] = m.accessor(np.arange(16, dtype=np.float32))
    m.node(mesh=m.add("meshes", {"primitives": [grid]}))
    return m.glb(folder / "vertex_colours.glb")


@model
def cameras_and_lights(folder: Path) -> Path:
    """Cameras, lights, and an extension that nobody knows, which refers to things by number."""
    m = Model3D()
    m.uses("KHR_lights_punctual", "VENDOR_secret")
    m.json["extensions"] = {
        "KHR_lights_punctual": {"lights": [{"type": "spot", "intensity": 5, "spot": {"outerConeAngle": 0.5}}]},
        "VENDOR_secret": {"texture": 0, "extras": {"deep": [[1.5, "ü"]]}},
    }
    m.add("cameras", {"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}, "extras": {"lens": 35}})
    m.add("cameras", {"type": "orthographic", "orthographic": {"xmag": 2, "ymag": 2, "znear": 0.1, "zfar": 9}})
    m.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": m.texture(5)}}})
    mesh = m.add("meshes", {"primitives": [m.grid(material=0)], "extensions": {"VENDOR_secret": {"mesh": 0}}})
    m.node(mesh=mesh, extras={"tag": 3})
    m.node(camera=0, name="eye", translation=[0, 0, 5])
    m.node(camera=1, extensions={"KHR_lights_punctual": {"light": 0}})
    m.json["extras"] = ["anything", {"x": 1}]
    m.json["asset"] |= {"generator": "by hand", "copyright": "nobody", "extras": {"mine": True}}
    return m.glb(folder / "cameras_and_lights.glb")


@model
def texture_transforms(folder: Path) -> Path:
    """KHR_texture_transform on the colour that goes and on the occlusion that stays."""
    m = Model3D()
    m.uses("KHR_texture_transform")
    transform = {"KHR_texture_transform": {"offset": [0.1, 0.2], "rotation": 0.4, "scale": [2, 3], "texCoord": 0}}
    m.add(
        "materials",
        {
            "name": "cloth",
            "pbrMetallicRoughness": {"baseColorTexture": {"index": m.texture(6), "extensions": transform}},
            "occlusionTexture": {"index": m.texture(7), "extensions": transform},
        },
    )
    m.node(mesh=m.add("meshes", {"primitives": [m.grid(material=0)]}))
    return m.glb(folder / "texture_transforms.glb")


@model
def variants(folder: Path) -> Path:
    """KHR_materials_variants: the other looks keep their textures and the UVs that these read."""
    m = Model3D()
    m.uses("KHR_materials_variants")
    m.json["extensions"] = {"KHR_materials_variants": {"variants": [{"name": "beach"}, {"name": "street"}]}}
    for k in range(3):
        pbr = {"baseColorTexture": {"index": m.texture(30 + k)}}
        m.add("materials", {"name": f"shoe {k}", "pbrMetallicRoughness": pbr})
    mappings = [{"material": 0, "variants": [0]}, {"material": 1, "variants": [1], "extras": {"n": 1}}]
    first = m.grid(material=0, extensions={"KHR_materials_variants": {"mappings": mappings}})
    turned = [{"material": 0, "variants": [1]}, {"material": 2, "variants": [0]}]
    second = m.grid(material=2, extensions={"KHR_materials_variants": {"mappings": turned}})
    m.node(mesh=m.add("meshes", {"primitives": [first, second]}))
    return m.glb(folder / "variants.glb")


@model
def gpu_instancing(folder: Path) -> Path:
    m = Model3D()
    m.uses("EXT_mesh_gpu_instancing")
    mesh = m.add("meshes", {"primitives": [m.grid()]})
    places = {"TRANSLATION": m.accessor(np.random.default_rng(8).normal(0, 3, (5, 3)).astype(np.float32))}
    m.node(mesh=mesh, extensions={"EXT_mesh_gpu_instancing": {"attributes": places}})
    return m.glb(folder / "gpu_instancing.glb")


@model
def material_settings(folder: Path) -> Path:
    """Cut-outs, blends, both sides, emission, clearcoat, sheen, and an unlit one."""
    m = Model3D()
    m.uses("KHR_materials_emissive_strength", "KHR_materials_clearcoat", "KHR_materials_unlit")
    coat = {"clearcoatFactor": 0.5, "clearcoatTexture": {"index": m.texture(40)}}
    cut = {"baseColorFactor": [1, 0, 0, 0.5], "baseColorTexture": {"index": m.texture(41, alpha=True)}}
    glow = {"emissiveFactor": [1, 0.5, 0], "emissiveTexture": {"index": m.texture(42)}}
    looks = [
        {"name": "leaf", "alphaMode": "MASK", "alphaCutoff": 0.3, "doubleSided": True, "pbrMetallicRoughness": cut},
        {"name": "glass", "alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.2]}},
        {"name": "lamp", **glow, "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4}}},
        {"name": "car", "extensions": {"KHR_materials_clearcoat": coat}, "extras": {"paint": "two coats"}},
        {"name": "sign", "extensions": {"KHR_materials_unlit": {}}},
    ]
    for k, look in enumerate(looks):
        mesh = m.add("meshes", {"primitives": [m.grid(material=m.add("materials", look))]})
        m.node(mesh=mesh, translation=[3 * k, 0, 0])
    return m.glb(folder / "material_settings.glb")


@model
def names_and_scenes(folder: Path) -> Path:
    """Equal and foreign names, a mesh in another scene, one in none, what nothing refers to."""
    m = Model3D()
    shown = m.add("meshes", {"primitives": [m.grid(material=0)], "name": "вещь"})
    other = m.add("meshes", {"primitives": [m.grid(material=0)], "name": "вещь"})
    m.add("meshes", {"primitives": [m.grid(material=1)], "name": ""})
    m.add("materials", {"name": "木", "pbrMetallicRoughness": {"baseColorTexture": {"index": m.texture(50)}}})
    m.add("materials", {"name": "木", "pbrMetallicRoughness": {"baseColorTexture": {"index": m.texture(51)}}})
    m.texture(52)
    m.accessor(np.arange(6, dtype=np.float32), name="idle")
    root = m.node(name="🦊")
    m.json["nodes"][root]["children"] = [m.node(name="same", mesh=shown, shown=False), m.node(name="same", shown=False)]
    alone = m.node(name="other scene", mesh=other, shown=False)
    m.json["scenes"] += [{"nodes": [alone], "name": "second"}, {"name": "empty"}]
    m.json["scenes"][0] |= {"name": "première", "extras": {"default": True}}
    return m.glb(folder / "names_and_scenes.glb")


def tampered(path: Path, change: Callable[[dict[str, Any]], None], to: Path) -> Path:
    """A copy of a .glb whose JSON went through ``change``."""
    data = path.read_bytes()
    size = int.from_bytes(data[12:16], "little")
    document = json.loads(data[20 : 20 + size])
    change(document)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + size :]
    length = 20 + len(text) + len(rest)
    head = data[:8] + length.to_bytes(4, "little") + len(text).to_bytes(4, "little") + data[16:20]
    to.write_bytes(head + text + rest)
    return to
