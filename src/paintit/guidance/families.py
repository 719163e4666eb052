"""The families of diffusion models: which checkpoints each reads, and of what parts they are made. No torch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

_MODEL = "model"
_DIFFUSION = "diffusion_pytorch_model"


@dataclass(frozen=True)
class Family:
    """Checkpoints that one class reads."""

    name: str
    """As in ``PriorSpec.family``."""
    place: str
    """``module:class``; imported when such a checkpoint is loaded."""
    about: str
    """Name for people."""
    pipelines: tuple[str, ...]
    """What ``model_index.json`` may say it is."""
    weights: Mapping[str, str]
    """Folder of each part that holds weights -> stem of its weight files. The network that denoises comes first."""
    tokenizers: tuple[str, ...] = ("tokenizer",)
    optional: tuple[str, ...] = ()
    """Parts that a checkpoint may leave out."""
    flow: bool = False
    """Whether these are flow models: noise is added along a straight path, and the schedulers are FlowMatch ones."""
    controlled: bool = False
    """Whether ControlNets can stand beside its network."""
    pictures: bool = False
    """Whether it takes a reference picture, through an IP-Adapter."""
    index: str = "model_index.json"
    """The file that says of which class it is; ``config.json`` for a single network, whose folder is ``""``."""


FAMILIES: dict[str, Family] = {
    family.name: family
    for family in (
        Family(
            "stable-diffusion",
            "paintit.guidance.stable_diffusion:StableDiffusionPrior",
            "Stable Diffusion 1.x and 2.x",
            ("StableDiffusionPipeline", "StableDiffusionImg2ImgPipeline", "StableDiffusionDepth2ImgPipeline"),
            {"unet": _DIFFUSION, "vae": _DIFFUSION, "text_encoder": _MODEL},
            controlled=True,
            pictures=True,
        ),
        Family(
            "sdxl",
            "paintit.guidance.sdxl:SDXLPrior",
            "Stable Diffusion XL",
            ("StableDiffusionXLPipeline", "StableDiffusionXLImg2ImgPipeline"),
            {"unet": _DIFFUSION, "vae": _DIFFUSION, "text_encoder": _MODEL, "text_encoder_2": _MODEL},
            ("tokenizer", "tokenizer_2"),
            controlled=True,
            pictures=True,
        ),
        Family(
            "deepfloyd-if",
            "paintit.guidance.deepfloyd:DeepFloydPrior",
            "DeepFloyd IF stage I",
            ("IFPipeline",),
            {"unet": _DIFFUSION, "text_encoder": _MODEL},
        ),
        Family(
            "sd3",
            "paintit.guidance.flow_sd3:SD3Prior",
            "Stable Diffusion 3 and 3.5",
            ("StableDiffusion3Pipeline", "StableDiffusion3Img2ImgPipeline"),
            {
                "transformer": _DIFFUSION,
                "vae": _DIFFUSION,
                "text_encoder": _MODEL,
                "text_encoder_2": _MODEL,
                "text_encoder_3": _MODEL,
            },
            ("tokenizer", "tokenizer_2", "tokenizer_3"),
            optional=("text_encoder_3", "tokenizer_3"),
            flow=True,
        ),
        Family(
            "flux2-klein",
            "paintit.guidance.flow_flux2:Flux2KleinPrior",
            "FLUX.2-klein",
            ("Flux2KleinPipeline",),
            {"transformer": _DIFFUSION, "vae": _DIFFUSION, "text_encoder": _MODEL},
            flow=True,
        ),
        Family(
            "z-image",
            "paintit.guidance.flow_zimage:ZImagePrior",
            "Z-Image",
            ("ZImagePipeline",),
            {"transformer": _DIFFUSION, "vae": _DIFFUSION, "text_encoder": _MODEL},
            flow=True,
        ),
    )
}
"""Name -> family."""

CONTROLNET = Family(
    "controlnet", "", "plain ControlNets", ("ControlNetModel",), {"": _DIFFUSION}, tokenizers=(), index="config.json"
)
"""A network beside a prior's own, not a prior."""
TINY_AUTOENCODER = Family(
    "tiny-autoencoder", "", "tiny autoencoders", ("AutoencoderTiny",), {"": _DIFFUSION}, tokenizers=(),
    index="config.json",
)  # fmt: skip
"""A stand-in for a prior's own autoencoder, not a prior."""


def family_of(pipeline: str) -> Family | None:
    """The family that reads checkpoints of the diffusers class ``pipeline``."""
    families = (*FAMILIES.values(), CONTROLNET, TINY_AUTOENCODER)
    return next((family for family in families if pipeline in family.pipelines), None)


def foreign_schedule(family: Family, scheduler: str) -> bool:
    """Whether the class ``scheduler`` adds noise otherwise than ``family`` does; EDM's sigmas suit none (Karras 2022).

    >>> foreign_schedule(FAMILIES["sdxl"], "EDMDPMSolverMultistepScheduler")
    True
    >>> foreign_schedule(FAMILIES["sdxl"], "DPMSolverMultistepScheduler")
    False
    """
    return scheduler.startswith("EDM") or scheduler.startswith("FlowMatch") != family.flow


def supported() -> str:
    """The families in words."""
    return ", ".join(family.about for family in FAMILIES.values())
