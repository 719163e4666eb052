"""Reading environment maps: latitude-longitude .hdr (Radiance RGBE, read by us) and .exr files, strictly.

Orientation, the one place that states it: row 0 is straight up (+Y), the last row straight down. The middle column
looks along +Z (the front of the mesh faces it), u grows toward -X: seen from inside, the picture is not mirrored. This
is Mitsuba's ``envmap`` without a transform. Blender's world texture (after the usual glTF axes, +Y up to +Z up) shows
the same file turned: its middle column looks along our +X, a quarter turn about the vertical axis.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from paintit.color import luminance
from paintit.errors import LightError

#: Name that stands for the map inside the package.
DEFAULT = "default"
MAX_SIDE = 1 << 15
_HINT = "give a latitude-longitude .hdr or .exr file, or 'default'"


@dataclass(frozen=True)
class Environment:
    """A latitude-longitude environment as its file has it.

    Attributes:
        radiance: (h, w, 3) float32 linear radiance, file values: *not* multiplied by ``exposure_factor``.
        name: file name without suffix, or ``"default"``.
        sha256: of the file's bytes (of the values, for an environment made from an array).
        exposure_factor: what the radiance is multiplied by wherever it lights something.
    """

    radiance: Tensor
    name: str
    sha256: str
    exposure_factor: float


def direction_to_uv(direction: Tensor) -> Tensor:
    """Unit directions (..., 3) -> latitude-longitude (..., 2), u and v in [0, 1], as the module docstring states.

    The gradient is finite everywhere, the poles included (there it is damped, not exact).
    """
    x, y, z = direction.unbind(-1)
    u = 0.5 + torch.atan2(-x, z) / (2 * math.pi)
    horizontal = (x * x + z * z + 1e-12).sqrt()
    v = torch.atan2(horizontal, y) / math.pi
    return torch.stack([u, v], -1)


def texel_directions(height: int, width: int, dtype: torch.dtype = torch.float32) -> tuple[Tensor, Tensor]:
    """Unit directions through texel centres (h, w, 3) and the exact solid angle of each texel (h, w) in steradians."""
    phi = 2 * math.pi * ((torch.arange(width, dtype=dtype) + 0.5) / width - 0.5)
    edges = torch.cos(math.pi * torch.arange(height + 1, dtype=dtype) / height)
    theta = math.pi * (torch.arange(height, dtype=dtype) + 0.5) / height
    theta, phi = torch.meshgrid(theta, phi, indexing="ij")
    direction = torch.stack([-theta.sin() * phi.sin(), theta.cos(), theta.sin() * phi.cos()], -1)
    solid_angle = (edges[:-1] - edges[1:])[:, None].expand(height, width) * (2 * math.pi / width)
    return direction, solid_angle


def mean_radiance(radiance: Tensor) -> Tensor:
    """(3,) mean over the sphere of directions of a latitude-longitude map (h, w, 3).

    It is also the mean radiance that a white diffuse sphere shows: averaging irradiance / pi over all normals gives
    every direction the same weight.
    """
    height, width, _ = radiance.shape
    _, solid_angle = texel_directions(height, width, torch.float64)
    return (radiance.double() * solid_angle[..., None]).sum((0, 1)) / (4 * math.pi)


def exposure_factor(radiance: Tensor, exposure: float) -> float:
    """The factor that makes a white diffuse sphere average ``exposure`` (in luminance); 1 where ``exposure`` is 0."""
    return float(exposure / luminance(mean_radiance(radiance))) if exposure > 0 else 1.0


def from_radiance(radiance: Tensor, name: str = "array", exposure: float = 0.0) -> Environment:
    """An environment of values (h, w, 3) instead of a file; ``exposure`` as in :func:`load_environment`."""
    values = radiance.detach().to("cpu", torch.float32).contiguous()
    _check(values.numpy(), name)
    digest = hashlib.sha256(f"{tuple(values.shape)}".encode() + values.numpy().tobytes()).hexdigest()
    return Environment(values, name, digest, exposure_factor(values, exposure))


def load_environment(path: str | Path = DEFAULT, exposure: float = 0.0) -> Environment:
    """Read an environment map.

    Args:
        path: an .hdr or .exr file, latitude-longitude, or ``"default"`` for the map in the package.
        exposure: mean radiance that a white diffuse sphere shall show; 0 keeps the file's own values.

    Raises:
        LightError: the file is missing, of another kind, damaged, without light, or not latitude-longitude.
    """
    if not math.isfinite(exposure) or exposure < 0:
        hint = "0.7 is usual, 0 keeps the file's own values"
        raise LightError("light.exposure", f"exposure {exposure} is not a number >= 0", hint)
    if str(path) == DEFAULT:
        name = DEFAULT
        data = resources.files("paintit.render").joinpath("data", "default_light.hdr").read_bytes()
        values = decode_rgbe(data, name)
    else:
        file = Path(path)
        name, suffix = file.stem, file.suffix.lower()
        if suffix not in (".hdr", ".exr", ".pic", ".rgbe"):
            raise LightError("light.format", f"'{path}' is not an environment map", _HINT)
        try:
            data = file.read_bytes()
        except FileNotFoundError:
            raise LightError("light.missing", f"there is no environment map '{path}'", _HINT) from None
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise LightError("light.unreadable", f"cannot read the environment map '{path}': {reason}", _HINT) from None
        values = _read_exr(file) if suffix == ".exr" else decode_rgbe(data, str(path))
    _check(values, str(path))
    radiance = torch.from_numpy(np.ascontiguousarray(np.maximum(values, 0), np.float32))
    return Environment(radiance, name, hashlib.sha256(data).hexdigest(), exposure_factor(radiance, exposure))


def _check(values: NDArray[np.float32], name: str) -> None:
    height, width = values.shape[:2]
    if height < 2 or not 1.9 <= width / height <= 2.1:
        raise LightError("light.shape", f"'{name}' is {width} x {height} pixels, not twice as wide as high", _HINT)
    if not np.isfinite(values).all():
        raise LightError("light.not_finite", f"'{name}' holds values that are not finite", _HINT)
    low, high = float(values.min()), float(values.max())
    if high <= 0:
        raise LightError("light.black", f"'{name}' holds no light: every value is zero", _HINT)
    # Resampling and compression leave small negative values in real .exr files; more than that is not radiance.
    if low < -0.01 * high:
        raise LightError("light.negative", f"'{name}' holds negative radiance ({low:g})", _HINT)


def _read_exr(path: Path) -> NDArray[np.float32]:
    import OpenEXR

    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: np.asarray(channel.pixels, np.float32) for name, channel in file.channels().items()}
    except Exception as error:
        reason = str(error).strip().splitlines()[-1] if str(error).strip() else type(error).__name__
        raise LightError("light.damaged", f"'{path}' is not a readable .exr file: {reason.lower()}", _HINT) from None
    names = ("R", "G", "B") if {"R", "G", "B"} <= channels.keys() else ("Y", "Y", "Y")
    if names[0] not in channels:
        raise LightError("light.channels", f"'{path}' has no R, G, B channels but {', '.join(channels)}", _HINT)
    return np.stack([channels[name] for name in names], -1)


def decode_rgbe(data: bytes, name: str) -> NDArray[np.float32]:
    """Radiance RGBE bytes -> (h, w, 3) float32, flat or run-length coded scanlines.

    Raises:
        LightError: no Radiance header, another pixel format or orientation, an absurd size, or too few bytes.
    """

    def fail(code: str, reason: str) -> LightError:
        return LightError(f"light.{code}", f"'{name}' is not a readable .hdr file: {reason}", _HINT)

    if not data.startswith((b"#?RADIANCE", b"#?RGBE")):
        raise fail("damaged", "it does not begin with '#?RADIANCE'")
    end = data.find(b"\n\n")
    line_end = data.find(b"\n", end + 2)
    if end < 0 or line_end < 0:
        raise fail("damaged", "its header has no end")
    exposure = 1.0
    for line in data[:end].split(b"\n")[1:]:
        key, _, value = line.partition(b"=")
        if key.strip() == b"FORMAT" and value.strip() != b"32-bit_rle_rgbe":
            raise fail("format", f"its pixels are '{value.strip().decode('latin-1')[:40]}'")
        if key.strip() == b"EXPOSURE":
            try:
                exposure *= float(value)
            except ValueError:
                raise fail("damaged", "its EXPOSURE is not a number") from None
    if not (math.isfinite(exposure) and exposure > 0):
        raise fail("damaged", f"its EXPOSURE is {exposure}")
    size = data[end + 2 : line_end].split()
    if len(size) != 4 or size[0] != b"-Y" or size[2] != b"+X" or not (size[1].isdigit() and size[3].isdigit()):
        raise fail("damaged", f"its size line is '{data[end + 2 : line_end].decode('latin-1')[:40]}'")
    height, width = int(size[1]), int(size[3])
    if not (1 <= height <= MAX_SIDE and 1 <= width <= MAX_SIDE):
        raise fail("size", f"it claims {width} x {height} pixels")
    pixels = _scanlines(memoryview(data)[line_end + 1 :], height, width)
    if pixels is None:
        raise fail("truncated", f"it ends before its {width} x {height} pixels do")
    mantissa, exponent = pixels[..., :3].astype(np.float32), pixels[..., 3:].astype(np.int32)
    scale = np.where(exponent > 0, np.ldexp(np.float32(1 / exposure), exponent - 136), 0)
    return (mantissa * scale).astype(np.float32)


def _scanlines(data: memoryview, height: int, width: int) -> NDArray[np.uint8] | None:
    """(h, w, 4) RGBE bytes, or None where the data end early or a run overflows its scanline."""
    marker = bytes((2, 2, width >> 8, width & 255))
    if not 8 <= width < MAX_SIDE or bytes(data[:4]) != marker:
        if len(data) < height * width * 4:
            return None
        return np.frombuffer(data, np.uint8, height * width * 4).reshape(height, width, 4)
    # A pixel costs at least 1/32 byte when run-length coded: refuse before allocating for a size that cannot be there.
    if len(data) < height * (4 + 8 * math.ceil(width / 127)):
        return None
    out = np.empty((height, 4, width), np.uint8)
    at = 0
    for row in range(height):
        if bytes(data[at : at + 4]) != marker:
            return None
        at += 4
        line = bytearray()
        for channel in range(1, 5):
            while len(line) < channel * width:
                if at + 1 >= len(data):
                    return None
                count = data[at]
                if count > 128:
                    line += bytes(data[at + 1 : at + 2]) * (count - 128)
                    at += 2
                else:
                    if count == 0 or at + 1 + count > len(data):
                        return None
                    line += data[at + 1 : at + 1 + count]
                    at += 1 + count
            if len(line) != channel * width:
                return None
        out[row] = np.frombuffer(line, np.uint8).reshape(4, width)
    return out.transpose(0, 2, 1)
