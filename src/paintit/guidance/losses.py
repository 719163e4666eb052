"""What is done with a prior's predictions: score distillation, and what has been published since to mend it.

Each loss is one function of a :class:`Question`, with its formula and paper; ``e(...)`` in a formula is the prior's
epsilon-hat at the noise level t, m the prior's ``weight(t)``, s the guidance scale. ``sds_gradient`` in ``sds.py`` is
the first of them by itself, to be read before this file. docs/losses.md compares them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from paintit.config import GuidanceConfig
from paintit.errors import PriorError
from paintit.guidance.prior import Prior, signal_and_noise
from paintit.guidance.sds import SdsRecord, norm

#: NFSD drops the negative prompt below this t: 200 of 1000 steps (2310.17590).
NFSD_CLEAN = 0.2
#: Share of the steps after which SDS-Bridge changes the source, as its authors' program does in 2D: 500 of 1000.
BRIDGE_FROM = 0.5
#: ASD's shift: a tenth of the way from its lowest t, both as published (2407.02040).
ASD_SHIFT, ASD_FLOOR = 0.1, 0.02
#: RFDS divides by the share of the image in x_t; below this, next to t = 1, there is nothing left to say about it.
RFDS_SIGNAL = 1e-3


@dataclass(frozen=True)
class Words:
    """Embedded texts, each (n, ...), one per view."""

    text: Tensor
    """What is to be seen."""
    negative: Tensor
    """The negative prompt; the empty one where there is none."""
    empty: Tensor | None = None
    """The empty prompt, for ``nfsd`` and perpendicular negatives."""
    source: Tensor | None = None
    """The text with words for how a paint looks so far, for ``bridge``."""


#: What is left of the prediction to descend along, before weighting, and what the words alone say in it (for the log).
Residual = tuple[Tensor, Tensor | None]


@dataclass(frozen=True)
class Question:
    """One step's views, and how to ask a prior about them."""

    prior: Prior
    x: Tensor
    """(n, c, h, w), detached."""
    noise: Tensor
    """epsilon, as large."""
    t: float
    words: Words
    scale: float
    progress: float
    """0 at the first step, 1 at the last."""
    geometry: Tensor | None = None
    rescale: float = 0.0
    perp_neg: bool = False

    def predict(self, *texts: Tensor, t: float | None = None) -> tuple[Tensor, ...]:
        """epsilon-hat of each text, all in one batch; at another noise level where ``t`` is given."""
        t, count = self.t if t is None else t, len(texts)
        x_t = self.prior.add_noise(self.x, self.noise, t)
        geometry = None if self.geometry is None else torch.cat([self.geometry] * count)
        return self.prior.predict_noise(torch.cat([x_t] * count), t, torch.cat(texts), geometry).chunk(count)

    def directions(self) -> tuple[Tensor, Tensor, Tensor]:
        """Unconditional and conditional epsilon-hat, and the direction from the one to the other.

        The negative prompt stands for the unconditional one, as in the paper; with ``perp_neg`` the empty prompt does,
        and the direction is that of Perp-Neg (2304.04968, one negative of weight 1):

            d = p - (q - (q . p / p . p) p),    p = e(text) - e(empty),    q = e(negative) - e(empty)
        """
        if not self.perp_neg:
            without, with_text = self.predict(self.words.negative, self.words.text)
            return without, with_text, with_text - without
        without, with_text, negative = self.predict(_given(self.words.empty), self.words.text, self.words.negative)
        direction = with_text - without
        return without, with_text, direction - perpendicular(negative - without, direction)

    def guided(self) -> Residual:
        """epsilon-hat of classifier-free guidance, e(negative) + s (e(text) - e(negative)), and its direction."""
        if self.scale == 1 and not self.perp_neg:
            return self.predict(self.words.text)[0], None
        without, with_text, direction = self.directions()
        return rescaled(without + self.scale * direction, with_text, self.rescale), direction


def sds(ask: Question) -> Residual:
    """m (e_s - epsilon): score distillation (DreamFusion 2209.14988, eq. 3; Paint-it, eq. 1 and 3)."""
    predicted, direction = ask.guided()
    return predicted - ask.noise, direction


def csd(ask: Question) -> Residual:
    """m s (e(text) - e(negative)): classifier score distillation (2310.19415, its two weights equal).

    The direction of guidance alone. s keeps the size that it has in SDS, so that clipping means the same.
    """
    _, _, direction = ask.directions()
    return ask.scale * direction, direction


def nfsd(ask: Question) -> Residual:
    """m (d + s (e(text) - e(empty))): noise-free score distillation (2310.17590).

    d = e(empty) - e(negative), or e(empty) where t < 0.2: so little noise that the prediction is held to be the image's
    own flaws.
    """
    empty, text, negative = _given(ask.words.empty), ask.words.text, ask.words.negative
    if ask.t < NFSD_CLEAN:
        domain, with_text = ask.predict(empty, text)
        direction = with_text - domain
    else:
        without, with_text, unwanted = ask.predict(empty, text, negative)
        direction, domain = with_text - without, without - unwanted
    return domain + ask.scale * direction, direction


def bridge(ask: Question) -> Residual:
    """m s (e(text) - e(source)) in the second half, SDS before: SDS-Bridge, second stage (2406.09417).

    The source is the text with words for how a paint looks when SDS is done with it.
    """
    if ask.progress < BRIDGE_FROM:
        return sds(ask)
    source, target = ask.predict(_given(ask.words.source), ask.words.text)
    return ask.scale * (target - source), target - source


def asd(ask: Question) -> Residual:
    """m (e_s - e(text; x_t', t')): asynchronous score distillation (2407.02040), with the same epsilon in x_t'.

    t' = t + 0.1 (t - 0.02), the end of the published range and what its authors' program takes. What the prediction of
    a higher level gets wrong stands in for what a model of the renders would: VSD without training one.
    """
    predicted, direction = ask.guided()
    later = min(ask.t + ASD_SHIFT * max(ask.t - ASD_FLOOR, 0), 1.0)
    (own,) = ask.predict(ask.words.text, t=later)
    return predicted - own, direction


def rfds(ask: Question) -> Residual:
    """v_s - (epsilon - x): rectified flow distillation sampling (2406.03293), unweighted.

    On the straight path x_t = (1 - r) x + r epsilon every velocity is v = (epsilon - x_t) / (1 - r), so that this is
    (e_s - epsilon) / (1 - r): SDS with another weight.
    """
    predicted, direction = ask.guided()
    signal, _ = signal_and_noise(ask.prior, ask.x, ask.t)
    return (predicted - ask.noise) / max(signal, RFDS_SIGNAL), direction


#: ``guidance.loss`` -> the function.
LOSSES: dict[str, Callable[[Question], Residual]] = {
    "sds": sds, "csd": csd, "nfsd": nfsd, "bridge": bridge, "asd": asd, "rfds": rfds,
}  # fmt: skip


@torch.no_grad()
def distil(
    guidance: GuidanceConfig,
    prior: Prior,
    x: Tensor,
    words: Words,
    t: float,
    noise: Tensor,
    scale: float,
    progress: float,
    geometry: Tensor | None = None,
) -> tuple[Tensor, SdsRecord]:
    """The gradient of the loss that ``guidance`` names on the encoded image ``x``; summed over views, as in SDS.

    Args:
        guidance: its ``loss``, ``rescale`` and ``perp_neg`` are read.
        x: (n, c, h, w) from ``prior.encode_image``; its own gradient is not touched.
        t: noise level in (0, 1], one for all views.
        noise: epsilon, (1, c, h, w) shared by all views (supp. A.2) or (n, c, h, w).
        progress: 0 at the first step, 1 at the last.
        geometry: (n, ...) from ``prior.encode_geometry``.

    Returns:
        (n, c, h, w) gradient, to be handed to ``x.backward``; and the record.
    """
    x = x.detach()
    noise = noise.to(x).expand_as(x)
    ask = Question(prior, x, noise, t, words, scale, progress, geometry, guidance.rescale, guidance.perp_neg)
    residual, direction = LOSSES[guidance.loss](ask)
    weight = 1.0 if guidance.loss == "rfds" else prior.weight(t)
    finite = residual.isfinite()
    gradient = torch.where(finite, weight * residual, 0.0)
    text_norm = 0.0 if direction is None else norm(direction)
    return gradient, SdsRecord(t, weight, norm(gradient), text_norm, int((~finite).sum()))


def require(prior: Prior, loss: str) -> None:
    """See that ``prior`` can serve ``loss``: ``rfds`` needs the straight path of flow models, the others any.

    Raises:
        PriorError: ``"prior.loss"``.
    """
    straight = abs(sum(signal_and_noise(prior, torch.zeros(1), 0.5)) - 1) <= 1e-3
    require_path(prior.spec.id, straight, loss)


def require_path(id: str, straight: bool, loss: str) -> None:
    """
    Args:
        id: of a prior, which need not be loaded.
        straight: whether it is a flow model.

    Raises:
        PriorError: ``"prior.loss"``.
    """
    if loss == "rfds" and not straight:
        raise PriorError(
            "prior.loss", f"the loss 'rfds' is for flow models, and the prior '{id}' is none",
            "choose --guidance.loss sds, or a flow model",
        )  # fmt: skip


def perpendicular(a: Tensor, b: Tensor) -> Tensor:
    """What is left of ``a`` (n, ...) without its component along ``b``, view by view; ``a`` where ``b`` is 0."""
    flat_a, flat_b = a.flatten(1), b.flatten(1)
    length = flat_b.square().sum(1, keepdim=True).clamp_min(torch.finfo(b.dtype).tiny)
    return (flat_a - (flat_a * flat_b).sum(1, keepdim=True) / length * flat_b).view_as(a)


def rescaled(guided: Tensor, with_text: Tensor, share: float) -> Tensor:
    """``guided`` (n, c, h, w), ``share`` of the way to the spread of ``with_text`` (Lin 2305.08891, 3.4).

    The spread is the standard deviation over all entries of a view. The paper rescales what its model predicts, v; here
    that is epsilon-hat, as for all else.
    """
    if share == 0:
        return guided
    dims = tuple(range(1, guided.dim()))
    wide = guided.std(dims, correction=0, keepdim=True).clamp_min(torch.finfo(guided.dtype).tiny)
    narrow = with_text.std(dims, correction=0, keepdim=True)
    return share * guided * (narrow / wide) + (1 - share) * guided


def _given(text: Tensor | None) -> Tensor:
    if text is None:
        raise ValueError("this loss needs a text that was not embedded: see Prompts.of")
    return text
