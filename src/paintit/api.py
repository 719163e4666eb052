"""Painting from Python: ``load_mesh``, ``paint``, ``PaintResult``. No algorithm here, and nothing is printed."""

from __future__ import annotations

import dataclasses
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from paintit import config as presets
from paintit._version import __version__
from paintit.config import LimitConfig, PaintConfig
from paintit.errors import UsageError
from paintit.export.finish import finish
from paintit.export.preview import preview
from paintit.export.read_maps import unpainted_maps
from paintit.export.write import write
from paintit.guidance.prior import Prior
from paintit.mesh.choice import choose
from paintit.mesh.mesh import Mesh
from paintit.mesh.read import Unwrap, read_mesh
from paintit.paint.make import make_painter
from paintit.paint.method import Method, Step
from paintit.settings import validate
from paintit.texture.maps import TextureMaps

if TYPE_CHECKING:
    from PIL.Image import Image


@dataclass(frozen=True)
class PaintResult:
    """A painted mesh.

    Attributes:
        mesh: the mesh, unchanged but for texture coordinates where it had none to paint on.
        maps: the texture maps of every layer as trained, on the CPU; :meth:`export` fills gutters and unseen texels.
        config: every setting as used.
        prompt: the sentence.
        support: (layers, h, w) how much of the views each texel has been, see ``paint.method.Method.support``.
        history: one record per step.
        seconds: painting time.
        peak_memory: bytes, of the process, or of the GPU where one was used; None where the system does not say.
        outcome: how it ended, in words.
        metadata: what is written into the asset: prompt, prior, seed, version.
    """

    mesh: Mesh
    maps: TextureMaps
    config: PaintConfig
    prompt: str
    support: torch.Tensor
    history: tuple[Step, ...]
    seconds: float
    peak_memory: int | None
    outcome: str
    metadata: dict[str, Any] = field(default_factory=dict)

    def finished(self) -> PaintResult:
        """The same with maps ready for any viewer: gutters and texels that no camera can see are filled."""
        return dataclasses.replace(self, maps=finish(self.mesh, self.maps, self.support))

    def export(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the painted mesh; the format follows the extension: .glb, .gltf, .obj, a folder of PNG maps, or a
        picture (.png) or turntable (.webp).

        Raises:
            OutputError: it exists already, or cannot be written.
        """
        target, result = Path(path), self.finished()
        write(target, result.mesh, result.maps, result.metadata, overwrite=overwrite)
        return target

    def preview(self, size: int = 512, views: int = 4) -> Image:
        """A picture from ``views`` sides, by the same renderer under the default light."""
        return preview(self.mesh, self.finished().maps, size=size, views=views)


def load_mesh(
    path: str | Path,
    unwrap: Unwrap = "auto",
    materials: Sequence[str] = (),
    exclude: Sequence[str] = (),
    *,
    pose: str = "rest",
    limits: LimitConfig | None = None,
) -> Mesh:
    """Read OBJ, PLY, STL, OFF, GLB or glTF; ``auto`` makes texture coordinates only where there are none to paint on.

    ``materials`` and ``exclude`` name the materials to paint and those to leave as they are; ``pose`` is ``"rest"`` or
    a moment of a glTF animation (``"Walk@0.5"``); ``limits`` are what the file may ask for.

    Raises:
        MeshError: the file is missing, damaged, empty or beyond the limits; the message says which.
        UsageError: a material that is not there, or none is left to paint.
    """
    return read_mesh(Path(path), unwrap, materials, exclude, pose=pose, limits=limits)


def check_prompt(prompt: str | None) -> str:
    """``prompt`` without outer blanks.

    Raises:
        UsageError: nothing is left.
    """
    text = (prompt or "").strip()
    if not text:
        raise UsageError("prompt.empty", "the prompt is empty", 'say what the mesh should look like: "red plastic"')
    return text


def paint(
    mesh: Mesh | str | Path,
    prompt: str,
    *,
    preset: str = "pocket",
    config: PaintConfig | None = None,
    seed: int | None = None,
    prior: Prior | None = None,
    on_step: Callable[[Step], bool | None] | None = None,
) -> PaintResult:
    """Paint ``mesh`` so that it looks like ``prompt``.

    Args:
        mesh: a mesh, or the path of one.
        prompt: what it should look like.
        preset: ``"pocket"`` or ``"paper"``; ignored where ``config`` is given.
        config: every setting.
        seed: replaces the seed of the settings.
        prior: a diffusion prior; by default the one that the settings name.
        on_step: called after every step; return False to stop there.

    Raises:
        PaintitError: a child of it for every expected failure, with a code, a message and a hint.
    """
    text = check_prompt(prompt)
    settings = config or presets.preset(preset)
    if seed is not None:
        settings = dataclasses.replace(settings, seed=seed)
    validate(settings)
    if not isinstance(mesh, Mesh):
        mesh = load_mesh(
            mesh, settings.unwrap, settings.materials, settings.exclude, pose=settings.pose, limits=settings.limits
        )
    elif settings.materials or settings.exclude:
        mesh = dataclasses.replace(mesh, layers=choose(mesh.layers, settings.materials, settings.exclude))
    painter = make_painter(mesh, text, settings, prior, fixed=unpainted_maps(mesh, settings.texture.size))
    history: list[Step] = []
    start = time.perf_counter()
    stopped = False
    for step in painter:
        history.append(step)
        if on_step is not None and on_step(step) is False:
            stopped = True
            break
    return result_of(painter, text, tuple(history), time.perf_counter() - start, stopped=stopped)


def result_of(
    painter: Method, prompt: str, history: tuple[Step, ...], seconds: float, *, stopped: bool = False
) -> PaintResult:
    """What ``painter`` has made so far."""
    maps = TextureMaps.unpacked(painter.maps().packed().cpu())
    word = "stopped" if stopped and painter.step < painter.total else "finished"
    metadata = {
        "prompt": prompt,
        "prior": painter.prior.spec.id,
        "prior_revision": painter.prior.spec.revision,
        "seed": painter.config.seed,
        "steps": painter.step,
        "version": __version__,
    }
    return PaintResult(
        painter.mesh, maps, painter.config, prompt, painter.support.cpu(), history, seconds,
        peak_memory(painter.device), f"{word} after {painter.step} of {painter.total} steps", metadata,
    )  # fmt: skip


def peak_memory(device: torch.device) -> int | None:
    """Bytes: the most this process held, or the most it allocated on a CUDA device; None where the system is silent."""
    if device.type == "cuda":
        return int(torch.cuda.max_memory_allocated(device))
    if sys.platform == "win32":
        return None
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak if sys.platform == "darwin" else peak * 1024)
