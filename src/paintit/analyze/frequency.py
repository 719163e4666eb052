"""How fast a parameterisation learns each frequency, fitting a texture (paper 4.1) or painting by guidance (4.2).

A curve is what one parameterisation did under one seed: the energy of five rings of the base colour's spectrum, every
few steps. The colour that is transformed is the sRGB-coded one: it is what the network's sigmoid gives (3.3), what the
file holds, and nearer to what an eye sees than radiance.
"""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import torch
from torch import Tensor

from paintit import variants
from paintit.analyze.bands import Bands, band_energy, half_rise, settles
from paintit.color import encode_srgb
from paintit.config import PaintConfig
from paintit.device import choose_device
from paintit.errors import UsageError
from paintit.export.read_maps import unpainted_maps
from paintit.guidance.prior import Prior
from paintit.mesh.mesh import Mesh
from paintit.paint.painter import Painter
from paintit.render.light import Light
from paintit.rng import Streams
from paintit.texture.field import make_field

#: What the texels between the islands of the layout hold when the spectrum is taken: the colour of the nearest texel
#: inside, as in every render and in the exported file, or what the parameterisation left there.
Outside = Literal["filled", "raw"]
#: Base colour after a number of steps: (layers, h, w, 3) sRGB-coded.
State = tuple[int, Tensor]


@dataclass(frozen=True)
class Curve:
    """One parameterisation under one seed. All lists run over the recorded steps.

    Attributes:
        variant: its name in ``paintit.variants``.
        steps: steps done when the record was taken; 0 is the start.
        magnitude, power: one figure per ring, see :class:`paintit.analyze.bands.Bands`.
        residual: fitting only: power of what is still wrong in the ring, over the target's. 1 at an even start.
        seconds: time of the whole curve, records included.
    """

    variant: str
    seed: int
    steps: tuple[int, ...]
    magnitude: tuple[tuple[float, ...], ...]
    power: tuple[tuple[float, ...], ...]
    residual: tuple[tuple[float, ...], ...] | None
    seconds: float

    def half_power(self) -> tuple[float | None, ...]:
        """Per ring, the step from which on its power is at least half of its last value."""
        return tuple(half_rise(self.steps, ring) for ring in zip(*self.power, strict=True))

    def half_fitted(self) -> tuple[float | None, ...]:
        """Per ring, the step from which on at most half of the target's power is still wrong; None where it is."""
        rings = zip(*self.residual, strict=True) if self.residual is not None else ()
        return tuple(settles(self.steps, [-wrong for wrong in ring], -0.5) for ring in rings)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Curve:
        """Inverse of ``dataclasses.asdict`` after a way through JSON."""
        rows = {name: data[name] and tuple(map(tuple, data[name])) for name in ("magnitude", "power", "residual")}
        return cls(data["variant"], data["seed"], tuple(data["steps"]), **rows, seconds=data["seconds"])


def record_steps(total: int, every: int) -> tuple[int, ...]:
    """Every step of the first ``every``, then each ``every``-th, and the last: fast starts are resolved too."""
    return tuple(sorted({*range(min(every, total) + 1), *range(0, total + 1, every), total}))


def shown_steps(total: int) -> tuple[int, ...]:
    """Steps whose textures stand beside the curves, where none are chosen: 2 %, 10 %, 30 % and all of ``total``."""
    return tuple(sorted({max(1, round(share * total)) for share in (0.02, 0.1, 0.3, 1.0)}))


def fit_settings(config: PaintConfig, variant: str) -> PaintConfig:
    """``config`` as ``variant`` fits an image: L1 alone (4.1), so without total variation.

    Raises:
        UsageError: an unknown variant, or one that is not a map of its own.
    """
    fitted = variants.apply(config, variant)
    if fitted.method != "distillation" or fitted.texture.kind == "points":
        raise UsageError(
            "analyze.variant",
            f"'{variant}' cannot fit an image: it needs a mesh",
            "give MESH and PROMPT, or leave it out",
        )
    return dataclasses.replace(fitted, texture=dataclasses.replace(fitted.texture, tv_weight=0.0))


def paint_settings(config: PaintConfig, variant: str) -> PaintConfig:
    """``config`` as ``variant`` paints.

    Raises:
        UsageError: an unknown variant, or one without steps that a gradient takes.
    """
    painted = variants.apply(config, variant)
    if painted.method != "distillation":
        raise UsageError("analyze.variant", f"'{variant}' is not painted by gradients", "leave it out of --variants")
    return painted


def fit(config: PaintConfig, target: Tensor, at: Iterable[int]) -> Iterator[State]:
    """Fit the base colour of a field to ``target`` by its mean absolute error, through the map itself (4.1).

    Args:
        config: texture and optimiser, from :func:`fit_settings`; nothing else is read but seed and device.
        target: (h, w, 3) sRGB-coded, of the texture's size.
        at: steps after which the base colour is handed out.
    """
    device, _ = choose_device(config.device)
    field = make_field(config.texture, 1, Streams(config.seed)["field"]).to(device)
    wanted, truth, optim = frozenset(at), target.to(device)[None], config.optim
    optimizer = torch.optim.Adam(field.parameters(), lr=optim.lr)
    schedule = torch.optim.lr_scheduler.StepLR(optimizer, optim.decay_every, optim.decay)
    for step in range(optim.steps + 1):
        coded = encode_srgb(field().base_color)
        if step in wanted:
            yield step, coded.detach()
        if step == optim.steps:
            return
        optimizer.zero_grad(set_to_none=True)
        (coded - truth).abs().mean().backward()
        optimizer.step()
        schedule.step()


def paint(
    config: PaintConfig, mesh: Mesh, prompt: str, at: Iterable[int], *,
    outside: Outside = "filled", prior: Prior | None = None, light: Light | None = None,
) -> Iterator[State]:  # fmt: skip
    """Paint ``mesh`` and hand out the base colour of its painted layers after the steps ``at`` (4.2)."""
    painter = Painter(mesh, prompt, config, prior, light, unpainted_maps(mesh, config.texture.size))
    painted = torch.tensor([layer.painted for layer in mesh.layers])
    wanted = frozenset(at)

    def state() -> State:
        maps = painter.maps()
        maps = painter.fill_gutters(maps) if outside == "filled" else maps
        return painter.step, encode_srgb(maps.base_color[painted.to(maps.base_color.device)])

    if painter.step in wanted:
        yield state()
    for step in painter:
        if step.index in wanted:
            yield state()


def trace(
    variant: str, seed: int, states: Iterable[State], *, target: Tensor | None = None, show: Sequence[int] = ()
) -> tuple[Curve, dict[int, Tensor]]:
    """Follow ``states`` to the end.

    Args:
        target: (h, w, 3), where an image is fitted.
        show: steps whose base colour is kept.

    Returns:
        the curve; and for each kept step the first layer's base colour, (h, w, 3) on the CPU.
    """
    start = time.perf_counter()
    goal = None if target is None else target[None].cpu()
    whole = None if goal is None else band_energy(goal).power
    kept: dict[int, Tensor] = {}
    found: list[tuple[int, Bands, tuple[float, ...]]] = []
    for step, coded in states:
        coded = coded.cpu()
        if step in show:
            kept[step] = coded[0]
        wrong = () if goal is None else band_energy(coded - goal).power
        found.append((step, band_energy(coded), wrong))
    steps, bands, residuals = zip(*found, strict=True)
    residual = None
    if whole is not None:
        residual = tuple(tuple(e / p if p > 0 else 0.0 for e, p in zip(row, whole, strict=True)) for row in residuals)
    curve = Curve(
        variant, seed, steps, tuple(b.magnitude for b in bands), tuple(b.power for b in bands), residual,
        round(time.perf_counter() - start, 3),
    )  # fmt: skip
    return curve, kept


def summary(curves: Sequence[Curve]) -> dict[str, Any]:
    """The curves of one variant in numbers, one entry per ring, each over the seeds.

    ``half_power_step``: the step from which on the ring's power is at least half of its last value;
    ``half_fitted_step``: from which on at most half of the target's power is wrong; ``final_magnitude``,
    ``final_power``, ``final_residual``; ``start_share``: the power at the start over the last.
    """
    found = {
        "half_power_step": [curve.half_power() for curve in curves],
        "final_magnitude": [curve.magnitude[-1] for curve in curves],
        "final_power": [curve.power[-1] for curve in curves],
        "start_share": [
            tuple(a / b if b > 0 else 0.0 for a, b in zip(curve.power[0], curve.power[-1], strict=True))
            for curve in curves
        ],
    }
    if all(curve.residual is not None for curve in curves):
        found["half_fitted_step"] = [curve.half_fitted() for curve in curves]
        found["final_residual"] = [curve.residual[-1] for curve in curves if curve.residual is not None]
    return {name: [_spread(ring) for ring in zip(*rows, strict=True)] for name, rows in found.items()}


def _spread(values: Sequence[float | None]) -> dict[str, float | None]:
    """Mean, lowest and highest of the values there are, and how many of them are missing."""
    known = [value for value in values if value is not None]
    missing = len(values) - len(known)
    if not known:
        return {"mean": None, "low": None, "high": None, "missing": missing}
    return {"mean": statistics.fmean(known), "low": min(known), "high": max(known), "missing": missing}
