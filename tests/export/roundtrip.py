"""Is a painted glTF file the same document as its input? Every key at every depth is compared, whatever its number.

As a script: ``python tests/export/roundtrip.py IN OUT [PAINTED MATERIAL ...]``; it prints every difference and exits
with 1 where there is one. Without material names, all materials may have been painted.

Allowed are: ``pbrMetallicRoughness`` and ``normalTexture`` of painted materials (not the opacity and extras in them)
and extensions that would hide these textures; in primitives of painted materials ``TANGENT``, a ``NORMAL`` where there
was none, the UV set that the painted textures read (unless a texture that stayed reads it too), and split vertices
whose other attributes and morph targets equal the input's at every corner of every triangle; ``asset.generator`` and
``asset.extras.paintit``. Accessors are compared by their values, images by their bytes.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

try:
    from tests.export.gltf_bytes import Gltf
except ImportError:
    from gltf_bytes import Gltf  # as a script

#: Extensions that hide metallic-roughness textures, and those that a removed texture or vertex may have been the last
#: to use.
HIDING = ("KHR_materials_pbrSpecularGlossiness", "KHR_materials_unlit")
MAY_GO = (*HIDING, "KHR_texture_transform", "KHR_draco_mesh_compression")
#: Where the bytes of an accessor lie; not what it says.
STORAGE = ("bufferView", "byteOffset", "sparse")
VARIANTS = "KHR_materials_variants"
INSTANCING = "EXT_mesh_gpu_instancing"


def differences(before: Path, after: Path, painted: Sequence[str] | None = None) -> list[str]:
    """Every difference that painting does not explain, as ``PLACE: WHAT``.

    Args:
        painted: names of the materials that may have been painted; None: all.
    """
    return _Comparison(Gltf(before), Gltf(after), painted).run()


class _Comparison:
    def __init__(self, a: Gltf, b: Gltf, painted: Sequence[str] | None) -> None:
        self.a, self.b, self.painted = a, b, painted
        self.found: list[str] = []

    def say(self, place: str, what: str) -> None:
        self.found.append(f"{place}: {what}")

    def run(self) -> list[str]:
        a, b = self.a.json, self.b.json
        special = {
            "asset": self.asset,
            "meshes": self.meshes,
            "materials": self.materials,
            "skins": self.skins,
            "animations": self.animations,
            "nodes": self.nodes,
            "extensionsUsed": self.extension_list,
            "extensionsRequired": self.extension_list,
        }
        tables = ("accessors", "bufferViews", "buffers", "images", "textures", "samplers")
        for key in sorted({*a, *b} - set(tables)):
            if key in special:
                special[key](a.get(key), b.get(key), key)
            else:
                self.same(a.get(key), b.get(key), key)
        self.unreferenced()
        return self.found

    # Plain values ------------------------------------------------------------------------------------------------

    def same(self, a: Any, b: Any, place: str, skip: Sequence[str] = ()) -> None:
        """Equal JSON values; a boolean is no number, an integer may have become the equal float."""
        if isinstance(a, dict) and isinstance(b, dict):
            for key in sorted({*a, *b} - set(skip)):
                if key not in a or key not in b:
                    self.say(f"{place}.{key}", "lost" if key in a else "added")
                else:
                    self.same(a[key], b[key], f"{place}.{key}")
        elif isinstance(a, list) and isinstance(b, list):
            if len(a) != len(b):
                self.say(place, f"{len(a)} items became {len(b)}")
            for i, (x, y) in enumerate(zip(a, b, strict=False)):
                self.same(x, y, f"{place}[{i}]")
        elif isinstance(a, bool) != isinstance(b, bool) or a != b:
            self.say(place, f"{_short(a)} became {_short(b)}")

    def asset(self, a: Any, b: Any, place: str) -> None:
        self.same(a, b, place, ("generator", "extras"))
        extras = b.get("extras", {})
        left = {k: v for k, v in extras.items() if k != "paintit"} if isinstance(extras, dict) else extras
        self.same(a.get("extras", {}), left, f"{place}.extras")

    def extension_list(self, a: Any, b: Any, place: str) -> None:
        for name in set(a or ()) ^ set(b or ()):
            if name in (a or ()) and name in MAY_GO and name not in _extensions_in(self.b.json):
                continue
            self.say(place, f"{name} was {'lost' if name in (a or ()) else 'added'}")

    # References by content ---------------------------------------------------------------------------------------

    def accessor(self, a: int | None, b: int | None, place: str) -> None:
        if (a is None) != (b is None):
            self.say(place, "lost" if b is None else "added")
        if a is None or b is None:
            return
        x, y = self.a.json["accessors"][a], self.b.json["accessors"][b]
        self.same(x, y, place, STORAGE)
        if ("sparse" in x) != ("sparse" in y):
            self.say(place, "sparse storage changed")
        if "bufferView" in x and "bufferView" in y:
            one, two = (g.json["bufferViews"][h["bufferView"]] for g, h in ((self.a, x), (self.b, y)))
            self.same(one, two, f"{place}.bufferView", ("buffer", "byteOffset", "byteLength"))
        if not _equal(self.a.stored(x), self.b.stored(y)):
            self.say(place, "other values")

    def texture(self, a: int, b: int, place: str) -> None:
        x, y = self.a.json["textures"][a], self.b.json["textures"][b]
        self.same(x, y, place, ("source", "sampler", "extensions"))
        self.sampler(x.get("sampler"), y.get("sampler"), f"{place}.sampler")
        self.image(x.get("source"), y.get("source"), f"{place}.source")
        one, two = x.get("extensions", {}), y.get("extensions", {})
        for name in sorted({*one, *two}):
            where = f"{place}.extensions.{name}"
            if name not in one or name not in two:
                self.say(where, "lost" if name in one else "added")
                continue
            self.same(one[name], two[name], where, ("source",))
            self.image(one[name].get("source"), two[name].get("source"), f"{where}.source")

    def sampler(self, a: int | None, b: int | None, place: str) -> None:
        pick = lambda g, i: None if i is None else g.json["samplers"][i]  # noqa: E731
        self.same(pick(self.a, a), pick(self.b, b), place)

    def image(self, a: int | None, b: int | None, place: str) -> None:
        if (a is None) != (b is None):
            self.say(place, "lost" if b is None else "added")
        if a is None or b is None:
            return
        x, y = self.a.json["images"][a], self.b.json["images"][b]
        # A file's kind is in its bytes; mimeType is only asked for where the image lies in a buffer.
        self.same(x, y, place, ("uri", "bufferView", "mimeType"))
        if "mimeType" in x and x["mimeType"] != y.get("mimeType"):
            self.say(f"{place}.mimeType", f"{x['mimeType']} became {y.get('mimeType')}")
        if self.a.image(x) != self.b.image(y):
            self.say(place, "other bytes")

    def with_textures(self, a: Any, b: Any, place: str, skip: Sequence[str] = ()) -> None:
        """Like ``same`` for a part of a material: texture infos are compared by the texture they name."""
        if not isinstance(a, dict) or not isinstance(b, dict):
            self.same(a, b, place)
            return
        for key in sorted({*a, *b} - set(skip)):
            where = f"{place}.{key}"
            if key not in a or key not in b:
                self.say(where, "lost" if key in a else "added")
            elif key.endswith("Texture") and "index" in a[key] and "index" in b[key]:
                self.same(a[key], b[key], where, ("index",))
                self.texture(a[key]["index"], b[key]["index"], where)
            elif key == "extras":
                self.same(a[key], b[key], where)
            else:
                self.with_textures(a[key], b[key], where)

    # Materials ---------------------------------------------------------------------------------------------------

    def may_be_painted(self, index: int | None) -> bool:
        name = "material" if index is None else self.a.json["materials"][index].get("name", "material")
        return self.painted is None or name in self.painted

    def materials(self, a: Any, b: Any, place: str) -> None:
        for i, material in enumerate(a or ()):
            if i >= len(b or ()):
                self.say(f"{place}[{i}]", "lost")
            else:
                self.material(material, b[i], f"{place}[{i}]", self.may_be_painted(i))

    def material(self, a: dict[str, Any], b: dict[str, Any], place: str, painted: bool) -> None:
        if not painted:
            self.with_textures(a, b, place)
            return
        self.with_textures(a, b, place, ("pbrMetallicRoughness", "normalTexture", "extensions"))
        one, two = a.get("extensions", {}), b.get("extensions", {})
        left = {k: v for k, v in one.items() if k not in HIDING or k in two}
        self.with_textures(left, two, f"{place}.extensions")
        old, new = a.get("pbrMetallicRoughness", {}), b.get("pbrMetallicRoughness", {})
        for key in ("extras", "extensions"):
            self.same(old.get(key), new.get(key), f"{place}.pbrMetallicRoughness.{key}")
        opacity = old.get("baseColorFactor", [1.0] * 4)[3]
        opacity = one.get(HIDING[0], {}).get("diffuseFactor", [1.0, 1.0, 1.0, opacity])[3]
        if new.get("baseColorFactor", [1.0] * 4)[3] != opacity:
            self.say(f"{place}.pbrMetallicRoughness.baseColorFactor[3]", "the opacity changed")

    # Meshes ------------------------------------------------------------------------------------------------------

    def nodes(self, a: Any, b: Any, place: str) -> None:
        for i, (x, y) in enumerate(zip(a or (), b or (), strict=False)):
            where = f"{place}[{i}]"
            self.same(x, y, where, ("mesh", "extensions"))
            if ("mesh" in x) != ("mesh" in y):
                self.say(f"{where}.mesh", "lost or added")
            elif "mesh" in x and x["mesh"] != y["mesh"]:  # a copy, where two nodes of one mesh were painted apart
                self.mesh(self.a.json["meshes"][x["mesh"]], self.b.json["meshes"][y["mesh"]], f"{where}.mesh")
            one, two = dict(x.get("extensions", {})), dict(y.get("extensions", {}))
            places, others = (e.pop(INSTANCING, {}).get("attributes", {}) for e in (one, two))
            self.same(one, two, f"{where}.extensions")
            self.attributes(places, others, f"{where}.{INSTANCING}")
        if len(a or ()) != len(b or ()):
            self.say(place, f"{len(a or ())} became {len(b or ())}")

    def attributes(self, a: dict[str, int], b: dict[str, int], place: str) -> None:
        for name in sorted({*a, *b}):
            self.accessor(a.get(name), b.get(name), f"{place}.{name}")

    def meshes(self, a: Any, b: Any, place: str) -> None:
        if len(b or ()) < len(a or ()):
            self.say(place, f"{len(a)} became {len(b or ())}")
        for i, (x, y) in enumerate(zip(a or (), b or (), strict=False)):
            self.mesh(x, y, f"{place}[{i}]")

    def mesh(self, a: dict[str, Any], b: dict[str, Any], place: str) -> None:
        self.same(a, b, place, ("primitives",))
        if len(a["primitives"]) != len(b["primitives"]):
            self.say(f"{place}.primitives", "other number")
        for k, (x, y) in enumerate(zip(a["primitives"], b["primitives"], strict=False)):
            self.primitive(x, y, f"{place}.primitives[{k}]")

    def primitive(self, a: dict[str, Any], b: dict[str, Any], place: str) -> None:
        triangles = a.get("mode", 4) >= 4 and b.get("mode", 4) >= 4
        painted = self.may_be_painted(a.get("material")) and triangles
        skip = ("attributes", "indices", "targets", "material", "extensions", *(("mode",) if painted else ()))
        self.same(a, b, place, skip)
        self.primitive_material(a, b, place, painted)
        self.variants(a, b, place)
        if painted and (a.get("material") != b.get("material") or self._new_look(a, b)):
            self.painted_vertices(a, b, place)
            return
        self.accessor(a.get("indices"), b.get("indices"), f"{place}.indices")
        if a.get("mode", 4) != b.get("mode", 4):
            self.say(f"{place}.mode", "changed")
        self.attributes(a["attributes"], b["attributes"], f"{place}.attributes")
        self.targets(a, b, place)

    def _new_look(self, a: dict[str, Any], b: dict[str, Any]) -> bool:
        return _look(self.a, a) != _look(self.b, b)

    def targets(self, a: dict[str, Any], b: dict[str, Any], place: str) -> None:
        one, two = a.get("targets", []), b.get("targets", [])
        if len(one) != len(two):
            self.say(f"{place}.targets", f"{len(one)} became {len(two)}")
        for k, (x, y) in enumerate(zip(one, two, strict=False)):
            self.attributes(x, y, f"{place}.targets[{k}]")

    def primitive_material(self, a: dict[str, Any], b: dict[str, Any], place: str, painted: bool) -> None:
        old, new = a.get("material"), b.get("material")
        if old == new:
            return
        if not painted or new is None:
            self.say(f"{place}.material", f"{old} became {new}")
            return
        source = {"name": self.b.json["materials"][new].get("name")} if old is None else self.a.json["materials"][old]
        self.material(source, self.b.json["materials"][new], f"{place}.material", True)

    def variants(self, a: dict[str, Any], b: dict[str, Any], place: str) -> None:
        where = f"{place}.extensions"
        one, two = ({k: v for k, v in p.get("extensions", {}).items() if k not in MAY_GO} for p in (a, b))
        maps, others = (e.pop(VARIANTS, {}).get("mappings", []) for e in (one, two))
        self.same(one, two, where)
        self.same([{**m, "material": 0} for m in maps], [{**m, "material": 0} for m in others], f"{where}.{VARIANTS}")
        for k, (x, y) in enumerate(zip(maps, others, strict=False)):
            own = x["material"] == a.get("material") and y["material"] == b.get("material")
            if x["material"] != y["material"] and not own:
                self.say(f"{where}.{VARIANTS}.mappings[{k}].material", f"{x['material']} became {y['material']}")

    def painted_vertices(self, a: dict[str, Any], b: dict[str, Any], place: str) -> None:
        """Corner by corner: what the painting may not touch is the same, wherever the vertices are now."""
        faces, others = self.a.triangles(a), self.b.triangles(b)
        if faces.shape != others.shape:
            self.say(place, f"{len(faces)} triangles became {len(others)}")
            return
        material = self.b.json["materials"][b["material"]] if "material" in b else {}
        mine = material.get("pbrMetallicRoughness", {}).get("baseColorTexture", {}).get("texCoord", 0)
        ours = {"TANGENT", f"TEXCOORD_{mine}", *((("NORMAL",)) if "NORMAL" not in a["attributes"] else ())}
        holders = [(a["attributes"], b["attributes"], f"{place}.attributes")]
        holders += [
            (x, y, f"{place}.targets[{k}]")
            for k, (x, y) in enumerate(zip(a.get("targets", []), b.get("targets", []), strict=False))
        ]
        if len(a.get("targets", [])) != len(b.get("targets", [])):
            self.say(f"{place}.targets", "other number")
        for x, y, where in holders:
            for name in sorted({*x, *y}):
                spare = name.startswith("TEXCOORD_") and name not in x and int(name[9:]) < mine
                if (where.endswith("attributes") and name in ours) or spare:
                    continue
                if name not in x or name not in y:
                    self.say(f"{where}.{name}", "lost" if name in x else "added")
                    continue
                self.corners(x[name], y[name], faces, others, f"{where}.{name}")
        name = f"TEXCOORD_{mine}"
        if name in a["attributes"] and name in b["attributes"]:
            moved = not self._same_corners(a["attributes"][name], b["attributes"][name], faces, others)
            for info_place, info in self._kept_infos(material, b):
                if moved and _uv_set(info) == mine:
                    self.say(info_place, f"reads {name}, whose values changed")

    def _kept_infos(self, material: dict[str, Any], b: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
        rest = {k: v for k, v in material.items() if k not in ("pbrMetallicRoughness", "normalTexture")}
        yield from _infos(rest, f"material '{material.get('name')}'")
        for mapping in b.get("extensions", {}).get(VARIANTS, {}).get("mappings", []):
            if mapping["material"] != b.get("material"):
                other = self.b.json["materials"][mapping["material"]]
                yield from _infos(other, f"variant '{other.get('name')}'")

    def corners(self, a: int, b: int, faces: np.ndarray, others: np.ndarray, place: str) -> None:
        x, y = self.a.json["accessors"][a], self.b.json["accessors"][b]
        # Bounds follow the vertices: those that no face uses may be gone.
        self.same(x, y, place, (*STORAGE, "count", "min", "max"))
        for key in ("min", "max"):
            if (key in x) != (key in y):
                self.say(f"{place}.{key}", "lost or added")
        if not self._same_corners(a, b, faces, others):
            self.say(place, "other values at some corner")

    def _same_corners(self, a: int, b: int, faces: np.ndarray, others: np.ndarray) -> bool:
        x, y = self.a.stored(self.a.json["accessors"][a]), self.b.stored(self.b.json["accessors"][b])
        return _equal(x[faces], y[others])

    # Skins, animations, and what nothing refers to ----------------------------------------------------------------

    def skins(self, a: Any, b: Any, place: str) -> None:
        key = "inverseBindMatrices"
        self.same([{**s, key: 0} for s in a or ()], [{**s, key: 0} for s in b or ()], place)
        for i, (x, y) in enumerate(zip(a or (), b or (), strict=False)):
            self.accessor(x.get(key), y.get(key), f"{place}[{i}].{key}")

    def animations(self, a: Any, b: Any, place: str) -> None:
        one, two = (
            [{**m, "samplers": [{**s, "input": 0, "output": 0} for s in m["samplers"]]} for m in animations or ()]
            for animations in (a, b)
        )
        self.same(one, two, place)
        for i, (x, y) in enumerate(zip(a or (), b or (), strict=False)):
            for k, (s, t) in enumerate(zip(x["samplers"], y["samplers"], strict=False)):
                for end in ("input", "output"):
                    self.accessor(s[end], t[end], f"{place}[{i}].samplers[{k}].{end}")

    def unreferenced(self) -> None:
        """What nothing in the input refers to must still be there: it is the user's."""
        checks = {"textures": self.texture, "images": self.image, "samplers": self.sampler, "accessors": self.accessor}
        for key, compare in checks.items():
            used = set(_references(self.a.json, key))
            for i in set(range(len(self.a.json.get(key, [])))) - used:
                if not any(self._quiet(compare, i, j) for j in range(len(self.b.json.get(key, [])))):
                    self.say(f"{key}[{i}]", "lost")

    def _quiet(self, compare: Any, i: int, j: int) -> bool:
        kept, self.found = self.found, []
        compare(i, j, "")
        same, self.found = not self.found, kept
        return same


def _equal(a: np.ndarray, b: np.ndarray) -> bool:
    return a.shape == b.shape and a.dtype == b.dtype and a.tobytes() == b.tobytes()


def _look(gltf: Gltf, primitive: dict[str, Any]) -> tuple[str, list[bytes]]:
    """What the painting replaces: the metallic-roughness factors and the bytes of their images."""
    material = gltf.json["materials"][primitive["material"]] if "material" in primitive else {}
    pbr = material.get("pbrMetallicRoughness", {})
    textures = [gltf.json["textures"][info["index"]] for _, info in _infos(pbr, "")]
    images = [gltf.image(gltf.json["images"][texture["source"]]) for texture in textures if "source" in texture]
    return repr({k: v for k, v in pbr.items() if not k.endswith("Texture")}), images


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 60 else text[:57] + "..."


def _uv_set(info: dict[str, Any]) -> int:
    transform = info.get("extensions", {}).get("KHR_texture_transform", {})
    return transform.get("texCoord", info.get("texCoord", 0))


def _infos(value: Any, place: str) -> Iterator[tuple[str, dict[str, Any]]]:
    if isinstance(value, dict):
        for key, child in value.items():
            if key.endswith("Texture") and isinstance(child, dict) and "index" in child:
                yield f"{place}.{key}", child
            elif key != "extras":
                yield from _infos(child, f"{place}.{key}")


def _dicts(value: Any) -> Iterator[dict[str, Any]]:
    if isinstance(value, dict):
        yield value
        for key, child in value.items():
            if key != "extras":
                yield from _dicts(child)
    elif isinstance(value, list):
        for child in value:
            yield from _dicts(child)


def _extensions_in(json: dict[str, Any]) -> set[str]:
    return {name for d in _dicts(json) for name in d.get("extensions", {})}


def _references(json: dict[str, Any], key: str) -> Iterator[int]:
    """Indices into ``json[key]`` that the document holds."""
    if key == "textures":
        yield from (info["index"] for m in json.get("materials", []) for _, info in _infos(m, ""))
    elif key in ("images", "samplers"):
        name = "source" if key == "images" else "sampler"
        yield from (d[name] for d in _dicts(json.get("textures", [])) if name in d)
    else:
        for mesh in json.get("meshes", []):
            for primitive in mesh["primitives"]:
                for holder in [primitive["attributes"], *primitive.get("targets", [])]:
                    yield from holder.values()
                yield from [primitive["indices"]] if "indices" in primitive else []
        yield from (s["inverseBindMatrices"] for s in json.get("skins", []) if "inverseBindMatrices" in s)
        for animation in json.get("animations", []):
            yield from (s[end] for s in animation["samplers"] for end in ("input", "output"))
        for node in json.get("nodes", []):
            yield from node.get("extensions", {}).get(INSTANCING, {}).get("attributes", {}).values()


def main(arguments: Sequence[str]) -> int:
    before, after, *painted = arguments
    found = differences(Path(before), Path(after), painted or None)
    sys.stdout.write("".join(f"{line}\n" for line in found) or "no difference\n")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
