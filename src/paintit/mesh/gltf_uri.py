"""The bytes behind a glTF URI: base64 inside the document, or a file below its folder, and nothing else."""

from __future__ import annotations

import base64
import binascii
import re
import stat
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from paintit.config import LimitConfig
from paintit.mesh.gltf_schema import gltf_error, plain, short
from paintit.mesh.limits import check_limit, mib

_BESIDE = "store the file beside the .gltf"
#: A scheme (http:, file:), a drive (C:), or a root of any system.
_NOT_RELATIVE = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:|[/\\]")


def resolve(uri: Any, base: Path, owner: str, limits: LimitConfig | None = None) -> bytes:
    """The bytes behind a URI: base64 ``data:`` or a percent-decoded file at or below ``base``.

    Args:
        uri: as it stands in the document.
        base: the folder that relative URIs start from.
        owner: whose URI it is, for messages.
        limits: a file larger than ``file_mib`` is refused before it is opened.

    Raises:
        MeshError: another scheme, a path that leaves ``base``, something else than a file, or one that cannot be read.
    """
    if not isinstance(uri, str) or not uri:
        raise gltf_error("gltf_invalid", f"{owner} has no data")
    if uri[:5].lower() == "data:":
        return _inline(uri, owner)
    path = path_of(uri, base, owner)
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):  # before it is opened: a pipe would wait for ever, a device never end
            raise gltf_error("gltf_uri", f"{owner} is not a file: '{plain(unquote(uri))}'", _BESIDE)
        check_limit(limits or LimitConfig(), "file_mib", mib(found.st_size), f"MiB of {owner}")
        return path.read_bytes()
    except OSError as error:
        raise gltf_error(
            "gltf_uri",
            f"{owner} cannot be read: '{plain(unquote(uri))}' ({(error.strerror or 'error').lower()})",
            "copy the whole folder of the .gltf, not the .gltf alone",
        ) from None


def _inline(uri: str, owner: str) -> bytes:
    head, _, body = uri.partition(",")
    try:
        if head.lower().endswith(";base64"):
            return base64.b64decode(body, validate=True)
        return unquote(body, "latin-1").encode("latin-1")
    except (binascii.Error, ValueError):
        raise gltf_error("gltf_uri", f"{owner} has a broken data URI ({short(uri[:80])})") from None


def path_of(uri: str, base: Path, owner: str) -> Path:
    """The file that a relative URI names, links followed; it need not be there.

    Raises:
        MeshError: another scheme, or a path that leaves ``base``.
    """
    name = unquote(uri)
    if _NOT_RELATIVE.match(uri) or re.match(r"[A-Za-z]:|[/\\]", name) or "://" in name or "\x00" in name:
        raise gltf_error("gltf_uri", f"{owner} is not a relative file name: '{plain(name)}'", _BESIDE)
    try:
        # Some exporters on Windows write its separator; on other systems it would be part of the name.
        path = (base / name.replace("\\", "/")).resolve()
        inside = path.is_relative_to(base.resolve())
    except (OSError, ValueError, RuntimeError):  # a loop of links, or a name that the system cannot hold
        raise gltf_error("gltf_uri", f"{owner} is not a file name: '{plain(name)}'", _BESIDE) from None
    if not inside:
        raise gltf_error("gltf_uri", f"{owner} lies outside the folder of the .gltf: '{plain(name)}'", _BESIDE)
    return path
