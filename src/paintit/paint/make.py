"""The method that the settings name."""

from __future__ import annotations

from paintit.config import PaintConfig
from paintit.guidance.prior import Prior
from paintit.mesh.mesh import Mesh
from paintit.paint.method import Method
from paintit.paint.painter import Painter
from paintit.paint.projection import Projector
from paintit.render.light import Light
from paintit.texture.maps import TextureMaps

METHODS: dict[str, type[Painter] | type[Projector]] = {"distillation": Painter, "projection": Projector}


def make_painter(
    mesh: Mesh,
    prompt: str,
    config: PaintConfig,
    prior: Prior | None = None,
    light: Light | None = None,
    fixed: TextureMaps | None = None,
) -> Method:
    """What ``config.method`` names, ready for its first step. Arguments as for :class:`paintit.paint.method.Method`.

    Raises:
        PriorError: the prior cannot do what the method asks of it.
    """
    return METHODS[config.method](mesh, prompt, config, prior, light, fixed)
