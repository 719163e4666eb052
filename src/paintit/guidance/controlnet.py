"""ControlNets beside a U-Net (Zhang 2023, 2302.05543): they look at pictures of the mesh and steer the prediction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from paintit.control import Control
from paintit.errors import PriorError
from paintit.guidance import hub
from paintit.guidance.depth import relative_disparity
from paintit.guidance.families import CONTROLNET
from paintit.guidance.footprint import outline, outline_part
from paintit.guidance.loading import Loading
from paintit.guidance.prior import SeeChannel

if TYPE_CHECKING:
    from paintit.guidance.hub import Checkpoint

#: What must be alike in both networks for the one's features to be added to the other's.
ALIKE = (
    "in_channels", "block_out_channels", "layers_per_block", "cross_attention_dim", "addition_embed_type",
    "addition_time_embed_dim", "projection_class_embeddings_input_dim",
)  # fmt: skip
#: What a ControlNet of depth or normals is by itself: it looks at colour pictures, place by place.
WANTED = {"conditioning_channels": 3, "global_pool_conditions": False}


def find(loading: Loading) -> list[Checkpoint]:
    """The ControlNets that ``loading.control`` names, whole on this machine.

    Raises:
        PriorError: as :func:`hub.open_checkpoint`.
    """
    return [
        hub.open_checkpoint(control.model, CONTROLNET, allow_download=loading.allow_download)
        for control in loading.control
    ]


def weigh(loading: Loading) -> int:
    """Bytes of the weights of the ControlNets that ``loading.control`` names; their configurations alone are read."""
    if not loading.control:
        return 0
    from diffusers.models.controlnets.controlnet import ControlNetModel

    dtype = hub.precision(torch.device(loading.device), loading.dtype)
    with outline():
        nets = [outline_part(checkpoint.folder, ControlNetModel, "", dtype) for checkpoint in find(loading)]
    return sum(weight.numel() * weight.element_size() for net in nets for weight in net.parameters())


class Controls:
    """ControlNets beside one U-Net, each with a scale that falls over the paint.

    Args:
        nets: one ``ControlNetModel`` for each of ``controls``; frozen.
        controls: what they are shown, and their scales at first.
        end: share of the scale at the last step.
        side: of the pictures they look at, the prior's own resolution in pixels.

    Attributes:
        sees: what they need of the renderer.
        share: of the scales, at present.
    """

    def __init__(self, nets: Sequence[Any], controls: Sequence[Control], *, end: float = 1.0, side: int) -> None:
        self.nets = nn.ModuleList(nets).requires_grad_(False).eval()
        self.controls = tuple(controls)
        self.end = end
        self.side = side
        self.share = 1.0
        kinds: tuple[SeeChannel, ...] = ("depth", "normal")
        shown = [control.kind for control in controls]
        self.sees: tuple[SeeChannel, ...] = (*(kind for kind in kinds if kind in shown), "mask")

    @classmethod
    def load(
        cls, found: Sequence[Checkpoint], unet: Any, loading: Loading, *, id: str, side: int, factor: int
    ) -> Controls:
        """ControlNets from :func:`find` beside ``unet``, the network of the prior ``id``, in its precision.

        Args:
            side: of its pictures, in pixels. factor: pixels per latent, a side.

        Raises:
            PriorError: one is made for another network.
        """
        from diffusers.models.controlnets.controlnet import ControlNetModel

        for checkpoint in found:
            check_fit(checkpoint.index, unet.config, factor, checkpoint.id, id)
        nets = [checkpoint.part(ControlNetModel, "", unet.dtype).to(loading.device) for checkpoint in found]
        if loading.economy.channels_last:
            nets = [net.to(memory_format=torch.channels_last) for net in nets]
        return cls(nets, loading.control, end=loading.control_end, side=side)

    def pace(self, progress: float) -> None:
        """The scales at this share of the paint, 0 to 1, linearly to ``end`` of what they are at first."""
        self.share = 1 + progress * (self.end - 1)

    @torch.no_grad()
    def draw(self, channels: Mapping[str, Tensor]) -> Tensor:
        """(n, 3 per ControlNet, side, side): the pictures that they look at, in [0, 1], in order."""
        draw = {"depth": depth_picture, "normal": normal_picture}
        return torch.cat([draw[c.kind](channels[c.kind], channels["mask"], self.side) for c in self.controls], 1)

    def __call__(self, x_t: Tensor, timestep: Tensor, text: Tensor, pictures: Tensor, **more: Any) -> dict[str, Any]:
        """What the U-Net is to add to its features, as further arguments of it.

        All texts get the same, the unconditional ones too, as in diffusers' pipelines without ``guess_mode``.

        Args:
            x_t: (n, c, h', w'). text: (n, tokens, d). Both as the U-Net gets them.
            pictures: from :meth:`draw`.
            more: further arguments of the U-Net that it shares with the ControlNets.
        """
        total: list[Tensor] = []
        for net, control, picture in zip(self.nets, self.controls, pictures.chunk(len(self.nets), 1), strict=True):
            down, mid = net(x_t, timestep, text, picture.to(x_t), return_dict=False, **more)
            scaled = [self.share * control.scale * part for part in (*down, mid)]
            total = [one + other for one, other in zip(total, scaled, strict=True)] if total else scaled
        return {"down_block_additional_residuals": total[:-1], "mid_block_additional_residual": total[-1]}


def check_fit(net: Mapping[str, Any], unet: Mapping[str, Any], factor: int, id: str, prior: str) -> None:
    """That the ControlNet ``id`` was made for a U-Net like that of ``prior``, by their configurations.

    Args:
        factor: pixels per latent, a side, of the prior.

    Raises:
        PriorError: it was not.
    """
    facts = {key: (net.get(key), unet.get(key)) for key in ALIKE}
    facts |= {key: (net.get(key, wanted), wanted) for key, wanted in WANTED.items()}
    # Each stage of the layers that take the picture in but the first halves it (ControlNetConditioningEmbedding).
    stages = net.get("conditioning_embedding_out_channels") or (16, 32, 96, 256)
    facts["pixels per latent"] = (2 ** (len(stages) - 1), factor)
    for key, (found, wanted) in facts.items():
        if _plain(found) != _plain(wanted):
            raise PriorError(
                "prior.control",
                f"the ControlNet '{id}' does not fit '{prior}': {key} is {found}, not {wanted}",
                "choose one made for this model; Stable Diffusion 1.x, 2.x and XL each need their own",
            )


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, (list, tuple)) else value


def depth_picture(depth: Tensor, mask: Tensor, side: int) -> Tensor:
    """(n, 3, side, side) grey: inverse depth of (n, h, w, 1), nearest white, farthest mid-grey, black off the mesh.

    The depth ControlNets were taught with MiDaS and its successors, which say inverse depth up to scale and shift,
    brightest where it is nearest. In a photograph an object stands before something; so the mesh takes the upper half
    of the range, as for the depth-to-image models.
    """
    return ((relative_disparity(depth, mask, side) + 1) / 2).expand(-1, 3, -1, -1)


def normal_picture(normal: Tensor, mask: Tensor, side: int) -> Tensor:
    """(n, 3, side, side): the normals (n, h, w, 3), view space, x right, y up, z toward the camera, as colours.

    The normal ControlNets were taught with the estimator of Bae et al. (2021), trained on ScanNet: (1 + n) / 2 with x
    to the left, y up, z toward the camera. Their authors say it so: "blue is front, red is left, green is top"
    (README of ControlNet 1.1, "Normal 1.1", which takes a renderer's normals in these colours). Off the mesh stands
    what the estimator sees in a wall that faces the camera: (0.5, 0.5, 1).
    """
    facing = normal.new_tensor([0.0, 0.0, 1.0])
    shown = torch.where(mask > 0, normal * normal.new_tensor([-1.0, 1.0, 1.0]), facing)
    picture = ((1 + shown) / 2).permute(0, 3, 1, 2)
    return functional.interpolate(picture, (side, side), mode="bilinear", antialias=True)
