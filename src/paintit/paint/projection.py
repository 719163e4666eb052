"""The projection baseline: sample a view, put it on the surface, move on (TEXTure, Text2Tex; both 2023).

Each view shows three kinds of pixels (TEXTure 3.1): what no view has painted yet is generated, what this view sees much
better than those before is refined, and the rest is kept and held while the others are sampled around it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor

from paintit.color import decode_srgb, encode_srgb
from paintit.config import PaintConfig
from paintit.guidance.prior import Prior
from paintit.guidance.sampling import Known, sample, sampling_prior
from paintit.guidance.schedule import settled
from paintit.mesh.mesh import Mesh
from paintit.mesh.uv import nearest_covered
from paintit.paint.backproject import Pixels, Texels, look_up, quality
from paintit.paint.method import Clock, Method, Step
from paintit.paint.tour import Tour, Trust, trust
from paintit.render.camera import Cameras
from paintit.render.gbuffer import rasterize
from paintit.render.light import Light
from paintit.render.render import Channels, render
from paintit.rng import uniform
from paintit.texture.fixed import with_fixed
from paintit.texture.maps import TextureMaps

#: Where sampling starts.
START = 0.99
#: A texel that two views paint is blended by their qualities to this power: the better one all but wins.
SHARPNESS = 4
#: Quality above which a texel has all the support that an exporter asks for.
ENOUGH = 0.3
#: Quality of layers that are not painted: no view is better.
_FIXED = 1e6
#: Roughness and metalness where the prior reads pictures only: nothing says what they are.
PLAIN = (0.7, 0.0)


class Projector(Method):
    """Paints by sampled views. Arguments as for :class:`paintit.paint.method.Method`; a step is a view.

    A prior that reads material channels gives the maps as it samples them. From one that reads pictures only, the base
    colour is the picture, with its light baked in, and roughness and metalness are :data:`PLAIN`; it is shown the base
    colour without any light, or the light would be added again with every view. The normal map stays flat.

    Attributes:
        support: (layers, h, w) in [0, 1], from the quality of the best view of each texel.

    Raises:
        PriorError: the prior sees no geometry, or its samples cannot be decoded.
    """

    def __init__(
        self,
        mesh: Mesh,
        prompt: str,
        config: PaintConfig,
        prior: Prior | None = None,
        light: Light | None = None,
        fixed: TextureMaps | None = None,
        *,
        profile: bool = False,
    ) -> None:
        super().__init__(mesh, prompt, config, prior, light, fixed, profile=profile)
        self._sampled = sampling_prior(self.prior, "projection")
        self.total = config.projection.views
        self.next_view = Tour(mesh, self.geometry, config)
        size = config.texture.size
        self._texels = Texels(mesh, self.geometry, size)
        shape = (len(mesh.layers), size, size)
        self._material = torch.tensor([0.5, 0.5, 0.5, *PLAIN], device=self.device).repeat(*shape, 1)
        """(layers, h, w, 5) linear base colour, roughness, metalness."""
        self._best = torch.zeros(shape, device=self.device)
        """(layers, h, w) quality of the best view so far."""
        self._best[[not painted for painted in self._painted]] = _FIXED
        rotation = config.light.rotation
        turn = uniform(0.0, 2 * math.pi, 1, self.streams["light"]) if rotation is None else math.radians(rotation)
        self._rotation = float(turn)

    def _advance(self) -> Step:
        """One view."""
        streams, settings, clock = self.streams, self.config.projection, Clock(self.device, self.profile)
        best = self.fill_gutters.filled(self._best[..., None])[..., 0]
        views = self.next_view(self.step, best, streams["views"])
        clock("view")
        image = self._render(views.cameras)
        found = trust(image.gbuffer, best, self.config.views.radius, settings.better)
        free_below = settings.refine * found.badly.float() + found.unseen.float()
        x = self._sampled.encode_image(self._read(image))
        clock("render")
        noise = torch.randn(x.shape, generator=streams["noise"]).to(x)
        words = self._embed(views)
        geometry = self._sampled.encode_geometry(self.place(image.geometry()))
        # The freest pixel decides for a cell of a coarser grid: held pixels keep their texels all the same.
        known = Known(x, F.adaptive_max_pool2d(free_below[:, None], x.shape[-2:]))
        x = sample(
            self._sampled, noise, words.text, words.negative, geometry,
            scale=settled(settings.scale), steps=settings.steps, start=START, known=known,
            eta=settings.eta, generator=streams["noise"],
        )  # fmt: skip
        clock("sampling")
        self._put(self._sampled.decode_image(x), image, views.cameras, found)
        clock("projection")
        self.step += 1
        painted = float((found.unseen | found.badly).sum() / image.mask.sum().clamp_min(1))
        return Step(self.step, self.total, START, 0.0, 0.0, 0.0, sum(clock.seconds.values()), clock.seconds, painted)

    def _render(self, cameras: Cameras) -> Channels:
        views = self.config.views
        gbuffer = rasterize(self.geometry, cameras, views.size)
        return render(gbuffer, self.maps(), self.light, rotation=self._rotation, background=views.background)

    def _read(self, image: Channels) -> dict[str, Tensor]:
        """The channels for the prior, encoded for display; unlit for one that reads pictures alone."""
        channels = image.encoded()
        if "base_color" not in self.prior.reads:
            behind = self.config.views.background * (1 - image.mask)
            channels["shaded"] = encode_srgb(image.base_color + behind)
        return channels

    def _put(self, picture: Mapping[str, Tensor], image: Channels, camera: Cameras, found: Trust) -> None:
        """Blend the sampled channels (1, h, w, c) into the texels that the view paints."""
        color = picture.get("base_color", picture.get("shaded"))
        assert color is not None
        rough, metal = (
            picture.get(name, torch.full_like(color[..., :1], plain))
            for name, plain in zip(("roughness", "metallic"), PLAIN, strict=True)
        )
        material = torch.cat([decode_srgb(color), rough, metal], -1)[0].float()
        seen = self._texels.seen_by(camera)
        pixels = Pixels.of(image.gbuffer, (found.unseen | found.badly)[0], (material.shape[0], material.shape[1]))
        values, weight = look_up(material, pixels, seen, camera.fov)
        best, texels = self._best.view(-1), self._material.view(-1, material.shape[-1])
        now, before = quality(seen.cosine, seen.depth, self.config.views.radius) * weight, best[seen.index]
        share = now**SHARPNESS / (now**SHARPNESS + before**SHARPNESS).clamp_min(1e-30)
        texels[seen.index] = torch.lerp(texels[seen.index], values, share[:, None])
        best[seen.index] = torch.maximum(before, now)
        self.support = (self._best / ENOUGH).clamp(0, 1)

    @torch.no_grad()
    def maps(self) -> TextureMaps:
        """The maps as they stand; texels that no view has painted take the nearest painted one of their layer."""
        painted = (self._best > 0).cpu().numpy()
        nearest = torch.from_numpy(nearest_covered(painted)).to(self.device)
        material = self._material.reshape(-1, self._material.shape[-1])[nearest][self._painted]
        flat = torch.tensor([0.0, 0.0, 1.0], device=self.device).expand(*material.shape[:-1], 3)
        maps = TextureMaps.unpacked(torch.cat([material, flat], -1))
        return with_fixed(maps, self._fixed, self._painted)

    def state_dict(self) -> dict[str, Any]:
        return {
            "step": self.step,
            "field": {"material": self._material, "best": self._best},
            "optimizer": {},
            "streams": self.streams.state_dict(),
            "support": self.support,
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self.step = state["step"]
        self._material.copy_(state["field"]["material"])
        self._best.copy_(state["field"]["best"])
        self.streams.load_state_dict(state["streams"])
        self.support.copy_(state["support"])
