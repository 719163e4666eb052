"""Scores of one painted mesh that need no reference set. Each is a small function of what the protocol's views see."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor

from paintit.color import lab, luminance
from paintit.evaluate.features import Network, view_features
from paintit.evaluate.protocol import Protocol, light_of, surface, turntable
from paintit.evaluate.truth import truth_scores
from paintit.export.seams import seam_figure
from paintit.mesh.mesh import Mesh
from paintit.render.light import Light
from paintit.render.render import Channels
from paintit.texture.maps import TextureMaps

#: Name -> a number, or None where there is nothing to measure.
Scores = dict[str, float | None]
#: Level views that the many-faces score compares.
JANUS_VIEWS = 12
#: Change of features, relative to them, below which a front has nothing that could recur.
_FAINT = 0.05


def asset_scores(
    mesh: Mesh,
    maps: TextureMaps,
    protocol: Protocol,
    network: Network | None = None,
    truth: TextureMaps | None = None,
    truth_mesh: Mesh | None = None,
    prompt: str = "",
) -> Scores:
    """Every score of one painted mesh that can be had.

    Args:
        network: for ``janus``, and for the CLIP score where it reads text and there is a ``prompt``.
        truth: what the same shape should look like; ``truth_mesh`` where its texture coordinates are its own.
    """
    seen = surface(mesh, maps, protocol)
    seam = seam_figure(mesh, maps)
    scores: Scores = {
        "seam": seam.ratio if seam else None,
        "saturation": saturation(seen),
        "flatness": flatness(seen, light_of(protocol.light, protocol.exposure)),
    }
    if network is not None:
        scores[f"janus_{network.name}"] = janus(mesh, maps, protocol, network, seen)
    if network is not None and network.words is not None and prompt:
        views = view_features(mesh, maps, protocol, network)
        scores[f"score_{network.name}"] = text_score(views, network.words([prompt]))
    if truth is not None:
        scores |= truth_scores(mesh, maps, truth, protocol, truth_mesh)
    return finite(scores)


def saturation(seen: Channels) -> float:
    """Mean chroma C*ab (CIE 1976) of the base colour: 0 for greys, about 100 for the primaries.

    Distillation at high guidance is known for colours that are too strong; beside the truth's own figure it says so.
    """
    return float(lab(seen.base_color[seen.gbuffer.mask])[..., 1:].norm(dim=-1).mean())


def flatness(seen: Channels, light: Light) -> float:
    """Correlation of the base colour's luminance with the irradiance on the bare surface, in [-1, 1]; 0 is good.

    Pearson's r over all pixels of all views. Positive: the light that it was painted under is baked into the base
    colour. Negative: it was painted against. An even base colour, which hides no light, has 0.
    """
    mask = seen.gbuffer.mask
    albedo = luminance(seen.base_color[mask]).double()
    irradiance = luminance(light.diffuse(seen.gbuffer.normal[mask])).double()
    albedo, irradiance = albedo - albedo.mean(), irradiance - irradiance.mean()
    spread = float(albedo.norm() * irradiance.norm())
    # Below half an 8-bit step of deviation the base colour is even.
    even = float(albedo.square().mean().sqrt()) < 0.5 / 255
    return 0.0 if even or spread == 0 else float(albedo @ irradiance) / spread


def janus(
    mesh: Mesh, maps: TextureMaps, protocol: Protocol, network: Network, seen: Channels | None = None
) -> float | None:
    """How much of what one side shows recurs on the others: 0 for one face, 1 for the same face on every side.

    Let g(a) be what painting adds to the features of the level view from azimuth a: features of the picture less those
    of the same mesh in its mean material. The face is the view f with the largest g. The score is the mean of
    ``clamp(g(a).g(f) / |g(f)|^2, 0, 1)`` over the views at least 90 degrees away from it; the formula is ours. A
    pattern that belongs on every side recurs too: read it only where the prompt has a front. None where no view shows
    anything.

    Args:
        seen: :func:`paintit.evaluate.protocol.surface` of the same, where it is at hand.
    """
    mean = mean_maps(seen or surface(mesh, maps, protocol), maps.layers)
    cameras = turntable(protocol, JANUS_VIEWS)
    painted = view_features(mesh, maps, protocol, network, cameras)
    plain = view_features(mesh, mean, protocol, network, cameras)
    added = painted - plain
    face = int(added.norm(dim=1).argmax())
    if added[face].norm() < _FAINT * plain[face].norm():
        return None
    away = (torch.arange(JANUS_VIEWS) - face) % JANUS_VIEWS * (360 / JANUS_VIEWS)
    others = added[(away >= 90) & (away <= 270)]
    return float((others @ added[face] / added[face].square().sum()).clamp(0, 1).mean())


def mean_maps(seen: Channels, layers: int) -> TextureMaps:
    """Even maps (layers, 4, 4) of the mean material that the views see, without relief."""
    mask = seen.gbuffer.mask
    value = torch.cat([x[mask].mean(0) for x in (seen.base_color, seen.roughness, seen.metallic)])
    even = torch.cat([value, value.new_tensor([0.0, 0.0, 1.0])])
    return TextureMaps.unpacked(even.expand(layers, 4, 4, 8).clone())


def text_score(views: Tensor, text: Tensor) -> float:
    """CLIP score (Hessel et al. 2021): 100 times the cosine of a view and the prompt, at least 0, mean over views.

    Args:
        views: (n, d) image embeddings. text: (1, d).
    """
    cosine = F.cosine_similarity(views, text)
    return float(100 * cosine.clamp_min(0).mean())


def finite(scores: Scores) -> Scores:
    """The same without NaN, which JSON has no word for."""
    return {name: None if value is None or not math.isfinite(value) else value for name, value in scores.items()}
