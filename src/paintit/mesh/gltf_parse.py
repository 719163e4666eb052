"""The bytes of a .glb or .gltf file to a ``GltfDocument``: chunks, JSON, extensions and buffers, each checked."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

from paintit.config import LimitConfig
from paintit.mesh.gltf_compression import DRACO, decoded, refuse_unreadable
from paintit.mesh.gltf_document import GltfDocument, whole
from paintit.mesh.gltf_schema import check_references, check_types, check_values, gltf_error, plain
from paintit.mesh.gltf_uri import path_of, resolve
from paintit.mesh.limits import check_limit, mib

_KNOWN_REQUIRED = (
    DRACO,
    "KHR_mesh_quantization",
    "KHR_materials_",
    "KHR_texture_",
    "KHR_lights_",
    "KHR_node_visibility",
    "KHR_animation_pointer",
    "KHR_xmp",
    "EXT_texture_",
    "EXT_lights_",
    "MSFT_lod",
    "MSFT_texture_dds",
)
"""Required extensions, or their beginnings, that do not change how geometry is stored, or that are decoded here."""
_VALUES_PER_NODE = 100
"""JSON values that a document may have for each node it may have: Python makes about 100 bytes of one."""


def read_document(path: Path, data: bytes, limits: LimitConfig | None = None) -> GltfDocument:
    """Parse the bytes of a .glb or .gltf file (told apart by its first four bytes).

    Args:
        path: where it lies; its folder is where relative URIs start.
        data: its content.
        limits: what it may ask for.

    Raises:
        MeshError: damage of any kind, a version other than 2, a required extension that stores geometry in another way,
            more than the limits allow.
    """
    limits = limits or LimitConfig()
    binary = data[:4] == b"glTF"
    if path.suffix.lower() == ".glb" and not binary:
        raise gltf_error(
            "garbage",
            f"this is not a GLB file (it begins with {data[:8]!r})",
            "check that it is a GLB file, or export it again",
        )
    text, chunk = _chunks(data) if binary else (data, None)
    document = _json(text, data, binary, limits)
    version = str(document["asset"].get("version", ""))
    if version.split(".")[0] != "2":
        raise gltf_error("gltf_version", f"glTF version {plain(version)!r} is not supported", "export it as glTF 2.0")
    check_types(document, "")
    check_values(document)
    for name in document.get("extensionsRequired", []):
        if not name.startswith(_KNOWN_REQUIRED):
            raise gltf_error(
                "gltf_extension",
                f"the file requires the extension {plain(name)}",
                "export the mesh without it (for compressed geometry: without compression)",
            )
    check_limit(limits, "nodes", len(document.get("nodes", [])), "nodes in the file")
    check_references(document)
    for i, image in enumerate(document.get("images", [])):
        # The pictures themselves are read when they are wanted; where they may lie is settled before anything is done.
        if isinstance(uri := image.get("uri"), str) and uri[:5].lower() != "data:":
            path_of(uri, path.parent, f"image {i}")
    buffers = _buffers(document, path.parent, chunk, limits, len(data))
    return decoded(GltfDocument(document, buffers, path.parent, binary, limits))


def _json(text: bytes, data: bytes, binary: bool, limits: LimitConfig) -> dict[str, Any]:
    found = sum(text.count(mark) for mark in (b"{", b"[", b","))
    check_limit(limits, "nodes", found // _VALUES_PER_NODE, f"nodes' worth of JSON ({found} values)")
    try:
        document = json.loads(text.decode("utf-8-sig"), parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        if not binary and not text.lstrip()[:1] == b"{":
            raise gltf_error(
                "garbage",
                f"this is not a glTF file (it begins with {data[:8]!r})",
                "check that it is a glTF file, or export it again",
            ) from None
        raise gltf_error("gltf_invalid", f"the JSON of the file is broken ({str(error)[:60].lower()})") from None
    if not isinstance(document, dict) or not isinstance(document.get("asset"), dict):
        raise gltf_error("gltf_invalid", "the JSON of the file has no 'asset'")
    return document


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is not JSON")


def _chunks(data: bytes) -> tuple[bytes, bytes | None]:
    """JSON and BIN chunk of a GLB."""
    if len(data) < 20:
        raise gltf_error("truncated", f"the GLB file is cut off after {len(data)} bytes", "copy or download it again")
    _, version, length = struct.unpack_from("<4sII", data)
    if version != 2:
        raise gltf_error("gltf_version", f"GLB version {version} is not supported", "export the mesh as glTF 2.0")
    if length > len(data):
        raise gltf_error(
            "truncated", f"the GLB file is cut off: {len(data)} of {length} bytes", "copy or download it again"
        )
    chunks: list[tuple[bytes, int, int]] = []
    at = 12
    while at + 8 <= length and len(chunks) < 2:  # a third chunk and what follows it mean nothing in glTF 2.0
        size, kind = struct.unpack_from("<I4s", data, at)
        if at + 8 + size > length:
            raise gltf_error("gltf_bounds", f"a chunk of the GLB file reaches byte {at + 8 + size} of {length}")
        chunks.append((kind, at + 8, at + 8 + size))
        at += 8 + size
    if not chunks or chunks[0][0] != b"JSON":
        raise gltf_error("gltf_invalid", "the GLB file does not begin with a JSON chunk")
    text = data[chunks[0][1] : chunks[0][2]]
    return text, next((data[start:end] for kind, start, end in chunks[1:] if kind == b"BIN\x00"), None)


def _buffers(
    document: dict[str, Any], base: Path, chunk: bytes | None, limits: LimitConfig, already: int
) -> tuple[bytes, ...]:
    """The bytes of every buffer; ``already`` bytes of the file itself count toward the limit."""
    found: list[bytes] = []
    total = already
    for i, buffer in enumerate(document.get("buffers", [])):
        length = whole(buffer, "byteLength", None)
        refuse_unreadable(buffer, i, "uri" in buffer or (i == 0 and chunk is not None))
        if "uri" in buffer:
            data = resolve(buffer["uri"], base, f"buffer {i}", limits)
            total += len(data)
            check_limit(limits, "file_mib", mib(total), "MiB of the file and its buffers")
        elif i == 0 and chunk is not None:
            data = chunk
        else:
            raise gltf_error("gltf_invalid", f"buffer {i} has no data")
        if len(data) < length:
            raise gltf_error("gltf_bounds", f"buffer {i} holds {len(data)} of its {length} bytes")
        found.append(data[:length])
    return tuple(found)
