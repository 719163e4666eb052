"""A whole frequency analysis: every variant under every seed, kept one by one, then the numbers and the figure."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from paintit import api, variants
from paintit.analyze import frequency_figure
from paintit.analyze.bands import ring_edges
from paintit.analyze.folder import SCHEMA, CurveFolder, write_csv, write_json
from paintit.analyze.frequency import (
    Curve,
    Outside,
    fit,
    fit_settings,
    paint,
    paint_settings,
    record_steps,
    shown_steps,
    summary,
    trace,
)
from paintit.analyze.plotting import require_matplotlib
from paintit.config import PaintConfig, to_dict
from paintit.device import choose_device
from paintit.errors import MeshError
from paintit.export.gltf_source import image_pixels, resized
from paintit.export.image import quantize
from paintit.guidance.load import load_prior
from paintit.guidance.loading import Loading
from paintit.guidance.prior import Prior
from paintit.mesh.mesh import Mesh
from paintit.render.light import Light, load_environment, prefilter


@dataclass(frozen=True)
class Request:
    """What was asked for.

    Attributes:
        subject: an image to fit, or a mesh to paint where there is a ``prompt``.
        folder: where everything goes.
        config: settings; ``variants`` change what makes them different, ``seeds`` replaces the seed.
        every: steps between records.
        show: steps whose textures are kept and drawn; empty: see ``frequency.shown_steps``.
        outside: what texels between the islands hold; of no effect on a fit.
    """

    subject: Path
    prompt: str | None
    folder: Path
    config: PaintConfig
    variants: tuple[str, ...] = ("dcpbr", "pixels", "dcpbr-no-skip")
    seeds: tuple[int, ...] = (0, 1, 2)
    every: int = 10
    show: tuple[int, ...] = ()
    outside: Outside = "filled"
    overwrite: bool = False


def run(request: Request, note: Callable[[str], None], versions: Mapping[str, str]) -> dict[str, Any]:
    """Make every curve that the folder does not hold yet, then write ``frequency.json``, ``.csv`` and ``.png``.

    Args:
        note: told of each curve.
        versions: of the packages in use, for the document.

    Returns:
        the document, as in ``frequency.json``.

    Raises:
        PaintitError: whatever is wrong with the image, the mesh, a variant or the folder, before the first step.
    """
    require_matplotlib()
    of = paint_settings if request.prompt is not None else fit_settings
    settings = {name: of(request.config, name) for name in request.variants}
    steps = {name: config.optim.steps for name, config in settings.items()}
    show = {name: request.show or shown_steps(total) for name, total in steps.items()}
    at = {name: sorted({*record_steps(total, request.every), *show[name]}) for name, total in steps.items()}
    work = _Paint(request) if request.prompt is not None else _Fit(request)
    folder = CurveFolder(request.folder, {**work.about, "every": request.every, "show": list(request.show)})
    curves: dict[str, list[Curve]] = {name: [] for name in request.variants}
    for seed in request.seeds:
        for name in request.variants:
            config = dataclasses.replace(settings[name], seed=seed)
            curve = None if request.overwrite else folder.curve(name, seed, to_dict(config))
            if curve is None:
                curve, textures = work.trace(name, config, at[name], show[name])
                folder.keep(curve, to_dict(config), textures)
                note(f"{name}, seed {seed}: {curve.steps[-1]} steps in {curve.seconds:.1f} s")
            curves[name].append(curve)
    everything = [curve for row in curves.values() for curve in row]
    document = {
        "schema": SCHEMA,
        "subject": work.about,
        "device": str(choose_device(request.config.device)[0]),
        "versions": dict(versions),
        "rings": {"edges": list(ring_edges()), "unit": "cycles per texel", "mean": "left out", "norm": "orthonormal"},
        "encoding": "sRGB",
        "settings": {name: to_dict(config) for name, config in settings.items()},
        "seeds": list(request.seeds),
        "seconds": round(sum(curve.seconds for curve in everything), 3),
        "summary": {name: summary(row) for name, row in curves.items()},
        "curves": [dataclasses.asdict(curve) for curve in everything],
    }
    write_json(request.folder / "frequency.json", document)
    write_csv(request.folder / "frequency.csv", everything)
    textures = {name: folder.textures(name, request.seeds[0], show[name]) for name in request.variants}
    titles = {name: variants.VARIANTS[name].title for name in request.variants}
    if request.prompt is None:
        titles = {name: title.removesuffix(" + TV") for name, title in titles.items()}
    frequency_figure.draw(request.folder / "frequency.png", curves, titles, textures, work.picture)
    return document


class _Fit:
    """Fitting one image (4.1)."""

    def __init__(self, request: Request) -> None:
        size = request.config.texture.size
        try:
            data = request.subject.read_bytes()
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise MeshError("image.unreadable", f"cannot read {request.subject}: {reason}", "check the path") from None
        pixels = resized(image_pixels(data)[..., :3], (size, size))
        self._target = torch.from_numpy(np.ascontiguousarray(pixels))
        self.picture = quantize(self._target)
        self.about = {"kind": "fit", "image": request.subject.name, "sha256": hashlib.sha256(data).hexdigest()}

    def trace(
        self, name: str, config: PaintConfig, at: list[int], show: tuple[int, ...]
    ) -> tuple[Curve, dict[int, Tensor]]:
        return trace(name, config.seed, fit(config, self._target, at), target=self._target, show=show)


class _Paint:
    """Painting one mesh by one sentence (4.2). Prior and light are loaded once, for the first curve that needs them."""

    picture = None

    def __init__(self, request: Request) -> None:
        config = request.config
        self._prompt = api.check_prompt(request.prompt)
        self._outside: Outside = request.outside
        self._mesh: Mesh = api.load_mesh(
            request.subject, config.unwrap, config.materials, config.exclude, pose=config.pose, limits=config.limits
        )
        self._loaded: tuple[Prior, Light] | None = None
        self.about = {
            "kind": "paint",
            "mesh": request.subject.name,
            "sha256": self._mesh.source.sha256 if self._mesh.source else "",
            "prompt": self._prompt,
            "outside": self._outside,
        }

    def trace(
        self, name: str, config: PaintConfig, at: list[int], show: tuple[int, ...]
    ) -> tuple[Curve, dict[int, Tensor]]:
        if self._loaded is None:
            device, _ = choose_device(config.device)
            light = prefilter(load_environment(config.light.path, config.light.exposure), device)
            prior = load_prior(config.guidance.prior, Loading.of(config, device))
            self._loaded = prior, light
        prior, light = self._loaded
        states = paint(config, self._mesh, self._prompt, at, outside=self._outside, prior=prior, light=light)
        return trace(name, config.seed, states, show=show)
