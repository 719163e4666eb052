"""Mutations that keep a file readable enough to reach the code behind the first check."""

from __future__ import annotations

import copy
import json
import random
import re
import struct
from collections.abc import Callable
from typing import Any

Mutate = Callable[[bytes, int], bytes]
"""The fuzzer's own mutation of bytes: data and largest size in, data out."""

_VALUES: tuple[Any, ...] = (
    0, 1, 2, 3, 4, 6, -1, 255, 65535, 1 << 24, 2**31 - 1, 2**31, 2**32, 2**53, 2**63, -(2**63), 10**30,
    0.5, -0.5, 1e-300, 1e38, 1e300, "", "x", "a" * 300, "SCALAR", "VEC2", "VEC3", "VEC4", "MAT4", "data:,", "../x",
    "%00", 5120, 5121, 5122, 5123, 5125, 5126, None, True, False, [], {}, [0], [[]], {"": 0},
)  # fmt: skip
"""What a member is set to: limits of integer types, sizes, types and enumerations of glTF."""
_KEYS = (
    "sparse", "byteStride", "byteOffset", "byteLength", "normalized", "count", "matrix", "translation", "rotation",
    "scale", "skin", "weights", "targets", "children", "mode", "indices", "material", "extensions", "mesh", "joints",
    "inverseBindMatrices", "uri", "bufferView", "extensionsRequired", "scene", "name", "max", "min", "texCoord",
)  # fmt: skip
_WORDS = (
    "0", "-0", "1", "-1", "2", "3", "4", "5", "-5", "99999999", "2147483648", "-9223372036854775808",
    "18446744073709551616", "1e38", "1e300", "-1e308", "1e-300", "1e999", "nan", "inf", "0x10", "1_0", "1.", ".",
    "/", "//", "1/", "1//1", "1/1/1/1", "#", "\\", "\t", "\x00", "\u00b2", "\u0663", "v", "vt", "vn", "f", "o", "g",
    "usemtl", "mtllib", "fo", "end_header", "element vertex 4000000000", "element face 4000000000",
    "property list uchar int vertex_indices", "property double x", "property list float float x",
    "facet normal 0 0 1", "vertex", "endloop", "outer loop", "solid", "OFF", "NOFF", "",
)  # fmt: skip
"""Words of the text formats and numbers that parsers trip over."""


def mutate_document(kind: str, data: bytes, largest: int, draw: random.Random, mutate: Mutate) -> bytes:
    """A GLB or glTF with some JSON values, or some bytes of its buffer, changed; container lengths are right again."""
    try:
        text, binary = unpack_glb(data) if kind == "glb" else (data, b"")
        document = json.loads(text)
    except (ValueError, struct.error, RecursionError):
        return mutate(data, largest)
    if kind == "glb" and binary and draw.random() < 0.2:
        binary = mutate(binary, max(largest - len(text) - 28, 1))
    else:
        for _ in range(draw.choice((1, 1, 1, 2, 3, 6))):
            document = _mutate_json(document, draw)
    text = json.dumps(document).encode()
    result = pack_glb(text, binary) if kind == "glb" else text
    return result if len(result) <= largest else mutate(data, largest)


def unpack_glb(data: bytes) -> tuple[bytes, bytes]:
    """JSON and BIN chunk; raises ``struct.error`` or ``ValueError`` where there are none."""
    size, kind = struct.unpack_from("<I4s", data, 12)
    if kind != b"JSON":
        raise ValueError(kind)
    return data[20 : 20 + size], data[28 + size :]


def pack_glb(text: bytes, binary: bytes) -> bytes:
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    if binary:
        body += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def _slots(value: Any, depth: int = 0) -> list[tuple[Any, Any]]:
    """(owner, key) of every value in a JSON document."""
    if depth > 60 or not isinstance(value, dict | list):
        return []
    keys = list(value) if isinstance(value, dict) else range(len(value))
    return [slot for key in keys for slot in ((value, key), *_slots(value[key], depth + 1))]


def _mutate_json(document: Any, draw: random.Random) -> Any:
    """One change at one place."""
    slots = _slots(document)
    if not slots:
        return {"asset": {"version": "2.0"}}
    owner, key = draw.choice(slots)
    old = owner[key]
    action = draw.randrange(9)
    if action <= 2:
        owner[key] = copy.deepcopy(draw.choice(_VALUES))
    elif action == 3 and isinstance(old, int | float):
        owner[key] = old + draw.choice((-1, 1, -4, 4, 0.5)) if abs(old) < 1e300 else 0
    elif action == 4:
        del owner[key]
    elif action == 5:
        other, name = draw.choice(slots)
        if name in other if isinstance(other, dict) else name < len(other):
            owner[key] = copy.deepcopy(other[name])
    elif action == 6 and isinstance(owner, list):
        owner.extend([copy.deepcopy(old) for _ in range(draw.choice((1, 2, 50)))])
    elif action == 7 and isinstance(old, dict):
        old[draw.choice(_KEYS)] = copy.deepcopy(draw.choice(_VALUES))
    elif action == 8 and isinstance(old, dict):
        other, name = draw.choice(slots)
        if isinstance(name, str):
            old[name] = copy.deepcopy(other[name])
    else:
        owner[key] = draw.randrange(-2, 12)
    return document


def mutate_text(data: bytes, largest: int, draw: random.Random, mutate: Mutate) -> bytes:
    """A text file with some lines or words changed."""
    lines = data.split(b"\n")
    for _ in range(draw.choice((1, 1, 2, 4))):
        at, to = draw.randrange(len(lines)), draw.randrange(len(lines))
        action = draw.randrange(6)
        if action == 0:
            lines.insert(to, lines[at])
        elif action == 1 and len(lines) > 1:
            del lines[at]
        elif action == 2:
            lines[at], lines[to] = lines[to], lines[at]
        else:
            parts = re.split(rb"([ \t/]+)", lines[at])
            k = draw.randrange(len(parts))
            word = draw.choice(_WORDS).encode()
            parts[k : k + draw.randrange(2)] = [word] if action < 5 else [word, b" ", parts[k]]
            lines[at] = b"".join(parts)
    result = b"\n".join(lines)
    return result if 0 < len(result) <= largest else mutate(data, largest)
