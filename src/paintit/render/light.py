"""The light: an environment prefiltered once, looked up by direction, differentiable in direction and roughness.

Environments are read in :mod:`paintit.render.environment` and convolved in :mod:`paintit.render.prefilter`; here are
the lookups and the cache on disk.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

from paintit.errors import OutputError
from paintit.files import atomic
from paintit.render import prefilter as convolution
from paintit.render.environment import (
    DEFAULT,
    Environment,
    direction_to_uv,
    from_radiance,
    load_environment,
)

__all__ = [
    "DEFAULT",
    "Environment",
    "Light",
    "cache_folder",
    "direction_to_uv",
    "from_radiance",
    "load_environment",
    "prefilter",
    "rotate_about_y",
]

#: Raised whenever the prefiltered values change, so that old cache files are left alone.
CACHE_VERSION = 2


@dataclass(frozen=True)
class Light:
    """A prefiltered environment. All radiance is linear and includes the exposure factor.

    Attributes:
        diffuse_map: (1, 3, s, s) irradiance / pi on a corner-sampled octahedral map.
        specular_maps: (1, 3, levels, s, s) GGX-prefiltered radiance, perceptual roughness 0 to 1 evenly over levels.
        radiance: (1, 3, h, w + 2) the environment itself, one wrapped column on either side.
        name, sha256, exposure_factor: of the environment, for the record.
    """

    diffuse_map: Tensor
    specular_maps: Tensor
    radiance: Tensor
    name: str
    sha256: str
    exposure_factor: float

    def diffuse(self, normal: Tensor, rotation: float | Tensor = 0.0) -> Tensor:
        """Irradiance / pi (..., 3) of unit normals (..., 3): the radiance of a white diffuse surface.

        ``rotation``: radians the environment is turned about +Y; see :func:`rotate_about_y` for shapes.
        """
        uv = convolution.octahedral_uv(rotate_about_y(normal, rotation, -1))
        table = self.diffuse_map.to(uv.dtype)
        values = F.grid_sample(table, uv.reshape(1, 1, -1, 2), padding_mode="border", align_corners=True)
        return values.reshape(3, -1).T.reshape(normal.shape)

    def specular(self, direction: Tensor, roughness: Tensor, rotation: float | Tensor = 0.0) -> Tensor:
        """Radiance (..., 3) arriving about unit ``direction`` (..., 3) under the GGX lobe of ``roughness`` (..., 1)."""
        uv = convolution.octahedral_uv(rotate_about_y(direction, rotation, -1))
        grid = torch.cat([uv, 2 * roughness - 1], -1)
        table = self.specular_maps.to(grid.dtype)
        values = F.grid_sample(table, grid.reshape(1, 1, 1, -1, 3), padding_mode="border", align_corners=True)
        return values.reshape(3, -1).T.reshape(direction.shape)

    def background(self, direction: Tensor, rotation: float | Tensor = 0.0) -> Tensor:
        """The environment's own radiance (..., 3) seen along unit ``direction`` (..., 3)."""
        return convolution.lookup(self.radiance, rotate_about_y(direction, rotation, -1))

    def to(self, device: str | torch.device) -> Light:
        """The same light on another device."""
        return replace(
            self,
            diffuse_map=self.diffuse_map.to(device),
            specular_maps=self.specular_maps.to(device),
            radiance=self.radiance.to(device),
        )


def rotate_about_y(vector: Tensor, rotation: float | Tensor, sense: int = 1) -> Tensor:
    """``vector`` (..., 3) turned by ``sense * rotation`` radians about +Y, right-handed (+Z goes to +X).

    A tensor ``rotation`` lines up with the *leading* dimensions of ``vector``: (n,) turns each view of (n, h, w, 3).
    An environment turned by +a is read at directions turned by -a.
    """
    if not isinstance(rotation, Tensor):
        if rotation == 0.0:
            return vector
        rotation = vector.new_tensor(rotation)
    angle = rotation.to(vector)
    angle = sense * angle.reshape(angle.shape + (1,) * (vector.ndim - 1 - angle.ndim))
    x, y, z = vector.unbind(-1)
    cosine, sine = angle.cos(), angle.sin()
    return torch.stack([cosine * x + sine * z, y.expand_as(x), cosine * z - sine * x], -1)


def prefilter(environment: Environment, device: str | torch.device = "cpu") -> Light:
    """The light of an environment: computed on the CPU in seconds, deterministic, and kept in the cache folder.

    The cache is keyed by the environment's content, not its exposure. An unusable cache file is computed afresh; a
    cache folder that cannot be written is done without.
    """
    path = cache_folder() / "lights" / f"{environment.sha256[:32]}-v{CACHE_VERSION}.safetensors"
    maps = _read_cache(path, environment.sha256)
    if maps is None:
        with torch.no_grad(), _one_thread():
            radiance = convolution.shrink(environment.radiance, 1024)
            maps = convolution.diffuse_map(radiance), convolution.specular_maps(radiance)
        _write_cache(path, environment.sha256, *maps)
    factor = environment.exposure_factor
    diffuse, specular = maps
    light = Light(
        diffuse_map=(diffuse * factor)[None],
        specular_maps=(specular * factor)[None],
        radiance=convolution.pad_columns(convolution.shrink(environment.radiance, 1024) * factor),
        name=environment.name,
        sha256=environment.sha256,
        exposure_factor=factor,
    )
    return light.to(device)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Many small steps: threads would wait for one another, badly so on a busy machine, and could round differently."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def cache_folder() -> Path:
    """Where derived files are kept: ``PAINTIT_CACHE``, else the user's cache folder."""
    import platformdirs

    return Path(os.environ.get("PAINTIT_CACHE") or platformdirs.user_cache_dir("paintit"))


def _read_cache(path: Path, sha256: str) -> tuple[Tensor, Tensor] | None:
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(str(path), "pt") as file:
            if (file.metadata() or {}).get("sha256") != sha256:
                return None
            diffuse, specular = file.get_tensor("diffuse"), file.get_tensor("specular")
    except (OSError, SafetensorError, ValueError):
        return None
    usable = diffuse.ndim == 3 and specular.ndim == 4 and specular.shape[1] == convolution.LEVELS
    finite = usable and math.isfinite(float(diffuse.sum()) + float(specular.sum()))
    return (diffuse, specular) if finite else None


def _write_cache(path: Path, sha256: str, diffuse: Tensor, specular: Tensor) -> None:
    from safetensors.torch import save_file

    try:
        with atomic(path) as temporary:
            tensors = {"diffuse": diffuse.contiguous(), "specular": specular.contiguous()}
            save_file(tensors, str(temporary), {"sha256": sha256})
    except OutputError:
        return
