"""A whole coherence analysis: states, channels, t, scale and seeds; then the numbers and the figure."""

from __future__ import annotations

import dataclasses
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from paintit import api
from paintit.analyze import coherence_figure
from paintit.analyze.coherence import PAPER_RATIOS, Reads, Row, rows
from paintit.analyze.folder import write_json
from paintit.analyze.plotting import require_matplotlib
from paintit.config import PaintConfig, to_dict
from paintit.device import choose_device
from paintit.export.read_maps import unpainted_maps
from paintit.guidance.load import load_prior
from paintit.guidance.loading import Loading
from paintit.guidance.prior import Prior
from paintit.paint.painter import Painter
from paintit.render.light import load_environment, prefilter

#: Raised when a field of ``coherence.json`` is renamed or removed; adding one is free.
SCHEMA = "paintit.coherence/1"


@dataclass(frozen=True)
class Request:
    """What was asked for.

    Attributes:
        within: degrees of elevation and azimuth around the front.
        after: steps painted before the gradients are taken; 0 is the random start.
        seeds: each has its own start, views and epsilon.
    """

    mesh: Path
    prompt: str
    folder: Path
    config: PaintConfig
    views: int = 5
    within: float = 2.0
    t: tuple[float, ...] = (0.2, 0.5, 0.8)
    scale: tuple[float, ...] = (1.0, 7.5, 101.0)
    reads: tuple[Reads, ...] = ("stack", "rgb")
    after: tuple[int, ...] = (0,)
    seeds: tuple[int, ...] = (0, 1, 2)


def run(
    request: Request, note: Callable[[str], None], versions: Mapping[str, str], prior: Prior | None = None
) -> dict[str, Any]:
    """Every matrix of gradients, then ``coherence.json`` and ``coherence.png``; the document is returned.

    Args:
        note: told of each state.
        versions: of the packages in use, for the document.
        prior: by default the one that the settings name.

    Raises:
        PaintitError: whatever is wrong with the mesh, the prompt, the prior or the folder.
    """
    require_matplotlib()
    config = request.config
    prompt = api.check_prompt(request.prompt)
    mesh = api.load_mesh(
        request.mesh, config.unwrap, config.materials, config.exclude, pose=config.pose, limits=config.limits
    )
    device, _ = choose_device(config.device)
    light = prefilter(load_environment(config.light.path, config.light.exposure), device)
    guidance = config.guidance
    prior = prior or load_prior(guidance.prior, Loading.of(config, device))
    fixed = unpainted_maps(mesh, config.texture.size)
    found: list[Row] = []
    for seed in request.seeds:
        painter = Painter(mesh, prompt, dataclasses.replace(config, seed=seed), prior, light, fixed)
        for after in request.after:
            while painter.step < after:
                next(iter(painter))
            for reads in request.reads:
                found += rows(painter, count=request.views, within=request.within, reads=reads,
                              t=request.t, scale=request.scale)  # fmt: skip
            note(f"seed {seed}, after {after} steps: done")
    table = summary(found)
    document = {
        "schema": SCHEMA,
        "mesh": request.mesh.name,
        "sha256": mesh.source.sha256 if mesh.source else "",
        "prompt": prompt,
        "prior": dataclasses.asdict(prior.spec),
        "views": request.views,
        "within_degrees": request.within,
        "device": str(device),
        "versions": dict(versions),
        "settings": to_dict(config),
        "seeds": list(request.seeds),
        "paper_ratios": list(PAPER_RATIOS),
        "summary": table,
        "rows": [dataclasses.asdict(row) for row in found],
    }
    write_json(request.folder / "coherence.json", document)
    coherence_figure.draw(request.folder / "coherence.png", table, request.views, len(request.seeds))
    return document


def summary(found: Sequence[Row]) -> list[dict[str, Any]]:
    """One entry per kind, state, channels, t and scale, in that order; each figure over the seeds.

    ``ratios`` and ``low``, ``high``: mean, lowest and highest of each singular value over the smallest, empty where one
    of the matrices is of lower rank; ``rank``: the lowest; ``effective_rank``, ``cosine``: means; ``cosine_low``,
    ``cosine_high``.
    """
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in found:
        groups.setdefault((row.kind, row.after, row.reads, row.t, row.scale), []).append(row)
    return [_over_seeds(group) for group in groups.values()]


def _over_seeds(group: Sequence[Row]) -> dict[str, Any]:
    first, measured = group[0], [row.agreement for row in group]
    full = all(one.ratios for one in measured)
    places = list(zip(*(one.ratios for one in measured), strict=True)) if full else []
    cosines = [one.cosine for one in measured]
    return {
        "kind": first.kind,
        "after": first.after,
        "reads": first.reads,
        "t": first.t,
        "scale": first.scale,
        "ratios": [statistics.fmean(place) for place in places],
        "low": [min(place) for place in places],
        "high": [max(place) for place in places],
        "rank": min(one.rank for one in measured),
        "effective_rank": statistics.fmean(one.effective_rank for one in measured),
        "cosine": statistics.fmean(cosines),
        "cosine_low": min(cosines),
        "cosine_high": max(cosines),
    }
