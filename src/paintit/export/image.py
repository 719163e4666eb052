"""Texture maps as 8-bit images: the colour door of the base colour file, the ORM packing, PNG folders."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from paintit.color import encode_srgb
from paintit.errors import OutputError
from paintit.files import make_folder, output_error, write_files
from paintit.mesh.mesh import Mesh
from paintit.texture.maps import TextureMaps

Bytes8 = NDArray[np.uint8]


@dataclass(frozen=True)
class EncodedMaps:
    """The maps of one layer as glTF stores them, each (h, w, 3) uint8.

    Attributes:
        base_color: sRGB-coded.
        orm: R occlusion (always 255), G roughness, B metallic; linear.
        normal: tangent space, +Y up, (n + 1) / 2; linear.
    """

    base_color: Bytes8
    orm: Bytes8
    normal: Bytes8

    @property
    def roughness(self) -> Bytes8:
        """(h, w)."""
        return self.orm[..., 1]

    @property
    def metallic(self) -> Bytes8:
        """(h, w)."""
        return self.orm[..., 2]


def quantize(values: Tensor) -> Bytes8:
    """[0, 1] -> 0..255, rounding half up; values outside are clamped."""
    scaled = (values.detach().to("cpu", torch.float32).clamp(0.0, 1.0) * 255.0 + 0.5).floor()
    return scaled.to(torch.uint8).numpy()


def encode_maps(maps: TextureMaps) -> list[EncodedMaps]:
    """Every layer as 8-bit images.

    Raises:
        OutputError: ``"output.not_finite"``, a map holds a NaN or an infinity.
    """
    if not bool(torch.isfinite(maps.packed()).all()):
        raise OutputError(
            "output.not_finite",
            "the texture maps hold values that are not finite",
            "the optimisation diverged: lower --optim.lr or export an earlier checkpoint",
        )
    base_color = quantize(encode_srgb(maps.base_color.detach().float()))
    occlusion = torch.ones_like(maps.roughness)
    orm = quantize(torch.cat([occlusion, maps.roughness, maps.metallic], -1))
    unit = torch.nn.functional.normalize(maps.normal.detach().float(), dim=-1)
    normal = quantize(unit * 0.5 + 0.5)
    return [EncodedMaps(base_color[i], orm[i], normal[i]) for i in range(maps.layers)]


def png_bytes(pixels: Bytes8) -> bytes:
    """PNG of (h, w), (h, w, 3) or (h, w, 4) uint8 with fixed settings and no metadata: equal pixels, equal bytes."""
    out = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(out, format="PNG", optimize=False, compress_level=6)
    return out.getvalue()


def safe_name(name: str, fallback: str = "material") -> str:
    """``name`` as a file name on every system: letters, digits, ``._-``; at most 64; never empty or hidden."""
    cleaned = re.sub(r"[^\w.\-]+", "_", name, flags=re.ASCII).strip("._")[:64].rstrip("._")
    if re.fullmatch(r"(?i)con|prn|aux|nul|com\d|lpt\d", cleaned.split(".")[0]):
        cleaned = f"{cleaned}_"
    return cleaned or fallback


def unique_names(names: Iterable[str]) -> list[str]:
    """Safe file names, distinct even where case is ignored: the second ``wood`` becomes ``wood_2``."""
    taken: set[str] = set()
    out = []
    for name in names:
        base = safe_name(name)
        candidate, count = base, 1
        while candidate.lower() in taken:
            count += 1
            candidate = f"{base}_{count}"
        taken.add(candidate.lower())
        out.append(candidate)
    return out


def layer_suffixes(mesh: Mesh) -> list[str]:
    """What tells the map files of each layer apart: ``""`` for one layer, else ``"_" + material name``."""
    if len(mesh.layers) == 1:
        return [""]
    return [f"_{name}" for name in unique_names(layer.name for layer in mesh.layers)]


def check_layers(mesh: Mesh, maps: TextureMaps) -> None:
    """Raise ``OutputError("output.layers")`` unless there is one set of maps for every layer of the mesh."""
    if maps.layers != len(mesh.layers):
        raise OutputError(
            "output.layers",
            f"the maps have {maps.layers} layers, the mesh has {len(mesh.layers)}",
            "use maps that were painted on this mesh",
        )


def map_files(folder: Path, mesh: Mesh, maps: TextureMaps) -> dict[Path, bytes]:
    """The PNG files of :func:`write_maps` and their contents."""
    check_layers(mesh, maps)
    files: dict[Path, bytes] = {}
    for layer, suffix, images in zip(mesh.layers, layer_suffixes(mesh), encode_maps(maps), strict=True):
        for name in ("base_color", "orm", "normal") if layer.painted else ():
            files[folder / f"{name}{suffix}.png"] = png_bytes(getattr(images, name))
    return files


def write_maps(folder: Path, mesh: Mesh, maps: TextureMaps) -> list[Path]:
    """Write ``base_color.png``, ``orm.png``, ``normal.png``; with several layers ``base_color_MATERIAL.png`` etc.

    Layers that are not painted are left out.

    Returns:
        The paths written.

    Raises:
        OutputError: the folder cannot be made or a file cannot be written; no file of this call is left then.
    """
    folder = Path(folder)
    files = map_files(folder, mesh, maps)
    try:
        fresh = not folder.exists()
    except OSError as error:
        raise output_error(folder, error) from error
    make_folder(folder)
    try:
        write_files(files)
    except BaseException:
        if fresh:
            folder.rmdir()
        raise
    return list(files)
