"""The pocket prior: a small diffusion model of rendered materials that ships in the package and runs on a CPU.

It denoises, at 32x32, shaded RGB together with base colour, roughness and metalness, and sees normals and places of the
surface. Guidance on the material channels is what tells metal from plastic; on shaded RGB alone it does not
(docs/pocket.md).
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

from paintit.device import native_bfloat16
from paintit.errors import PriorError
from paintit.guidance.lexicon import Lexicon
from paintit.guidance.pocket_net import PocketConfig, PocketNet, alpha_sigma, pack_geometry
from paintit.guidance.prior import PriorSpec, ReadChannel, SeeChannel

#: Channels of each read, in the order of the stack.
STACK: dict[ReadChannel, int] = {"shaded": 3, "base_color": 3, "roughness": 1, "metallic": 1}


def weights_path() -> Path:
    """The weights inside the package."""
    return Path(str(resources.files("paintit.guidance") / "pocket.safetensors"))


class PocketPrior:
    """``guidance.prior.Prior`` over :class:`PocketNet`.

    Args:
        weights: a ``.safetensors`` file; the one in the package by default.
        device: where it runs.
        dtype: ``float32``, or ``bfloat16`` for half the memory.

    Raises:
        PriorError: the weights are absent or not those of a pocket prior.
    """

    reads: tuple[ReadChannel, ...] = ("shaded", "base_color", "roughness", "metallic")
    sees: tuple[SeeChannel, ...] = ("normal", "mask", "position", "normal_object")
    bound: float = 1.0

    def __init__(
        self,
        weights: Path | str | None = None,
        *,
        device: str | torch.device = "cpu",
        dtype: torch.dtype = torch.float32,
    ) -> None:
        path = weights_path() if weights is None else Path(weights)
        config, state, words, digest = _read(path)
        with torch.device("meta"):  # no initialisation: nothing is drawn from torch's global generator
            net = PocketNet(config)
        net.load_state_dict(state, assign=True)
        layout = torch.channels_last
        self.net = net.requires_grad_(False).eval().to(device=device, dtype=dtype, memory_format=layout)  # type: ignore[call-overload]
        self.net.text.float()  # encoded once per paint; words are told apart in float32
        self.net.text.known = words or None
        self.lexicon = Lexicon(words)
        self.device, self.dtype = torch.device(device), dtype
        self.spec = PriorSpec(
            id="pocket", family="pocket", revision=digest, licence="Apache-2.0", resolution=config.resolution,
            prediction_type="v_prediction", guidance_scale=3.0, movable=True,
        )  # fmt: skip

    @classmethod
    def load(cls, *, device: str = "cpu", dtype: str = "auto") -> PocketPrior:
        """The prior in the package. ``auto``: bfloat16 on GPUs and on CPUs that multiply it natively, being quicker."""
        quickest = torch.bfloat16 if native_bfloat16(torch.device(device)) else torch.float32
        names = ("float32", "bfloat16", "float16")
        types = {"auto": quickest, **{name: getattr(torch, name) for name in names}}
        if dtype not in types:
            raise PriorError("prior.dtype", f"there is no precision '{dtype}'", f"choose one of {', '.join(types)}")
        return cls(device=device, dtype=types[dtype])

    @torch.no_grad()
    def encode_text(self, prompts: Sequence[str]) -> Tensor:
        """(n, 25, width + 1) float32: a summary token, up to 24 words, then zeros; the last feature is 1 where valid.

        Words that no training caption held are read as their nearest known meaning (:class:`lexicon.Lexicon`). One by
        one, so that a prompt gives the same bits in whatever company.
        """
        rows = 1 + self.net.config.max_words
        texts = [self.net.text([self.lexicon.rewrite(prompt) if self.lexicon.known else prompt]) for prompt in prompts]
        valid = [text * text[..., -1:] for text in texts]
        return torch.cat([F.pad(text, (0, 0, 0, rows - text.shape[1])) for text in valid])

    def readings(self, prompt: str) -> dict[str, str]:
        """Words of the prompt that are read as others: as they stand there -> what they are taken to mean."""
        return self.lexicon.readings(prompt) if self.lexicon.known else {}

    def encode_image(self, channels: Mapping[str, Tensor]) -> Tensor:
        """Channels (n, h, w, c) in [0, 1] -> (n, 8, 32, 32) in [-1, 1], averaged over areas as the training data were.

        Raises:
            PriorError: a channel is missing or has the wrong number of components.
        """
        parts = []
        for name, width in STACK.items():
            if name not in channels or channels[name].shape[-1] != width:
                found = "missing" if name not in channels else f"{channels[name].shape[-1]} wide"
                raise PriorError("prior.channels", f"channel '{name}' is {found}, the pocket prior reads {width}")
            parts.append(channels[name])
        return self._resample(torch.cat(parts, -1)) * 2 - 1

    @torch.no_grad()
    def decode_image(self, x: Tensor) -> dict[str, Tensor]:
        """(n, 8, 32, 32) in [-1, 1] -> the ``reads`` channels (n, 32, 32, c) in [0, 1]."""
        image = (x.movedim(1, -1).clamp(-1, 1) + 1) / 2
        return dict(zip(STACK, image.split(list(STACK.values()), -1), strict=True))

    @torch.no_grad()
    def encode_geometry(self, channels: Mapping[str, Tensor]) -> Tensor:
        """The ``sees`` channels (n, h, w, c) -> (n, places, 32, 32), see :func:`pocket_net.pack_geometry` and
        :meth:`PocketNet.places`: once a step, however often the network is asked about it."""
        mask = channels["mask"].to(channels["normal"].dtype)
        packed = pack_geometry(
            channels["normal"], mask, channels["position"], channels["normal_object"], self.net.config.resolution
        )
        return self.net.places(packed.to(self.device, self.dtype), self.dtype).movedim(-1, 1)

    @torch.no_grad()
    def mean_material(self, prompt: str) -> Tensor:
        """(5,) mean base colour (sRGB-coded), roughness and metalness in [0, 1] that the text alone suggests."""
        return self.net.mean(self.encode_text([prompt])[:, 0, :-1].to(self.dtype))[0].float().clamp(-1, 1) / 2 + 0.5

    def add_noise(self, x: Tensor, noise: Tensor, t: float) -> Tensor:
        """x_t = cos(pi t / 2) x + sin(pi t / 2) noise."""
        alpha, sigma = alpha_sigma(t)
        return alpha.to(x) * x + sigma.to(x) * noise

    @torch.no_grad()
    def predict_noise(self, x_t: Tensor, t: float, text: Tensor, geometry: Tensor | None = None) -> Tensor:
        """epsilon-hat from v: x0 = alpha x_t - sigma v, clipped to [-1, 1]; epsilon = (x_t - alpha x0) / sigma.

        Clipped, because what lies beyond black and white is no material and a large guidance scale would multiply it.
        Without ``geometry`` the network sees none, as in part of its training.
        """
        n = len(x_t)
        if geometry is None:
            nothing = x_t.new_zeros(n, self.net.config.geometry, *x_t.shape[2:])
            places = self.net.places(nothing.to(self.device), self.dtype)
        else:
            places = geometry.to(self.device, self.dtype).movedim(1, -1)
        longest = int(text[..., -1].sum(1).max())  # rows after the longest prompt are padding
        noisy, words = (a.to(self.device, self.dtype) for a in (x_t, text[:, :longest]))
        level = torch.full((n,), float(t), device=self.device)
        v = self.net.denoise(noisy, level, words, places).to(x_t)
        alpha, sigma = (a.to(x_t) for a in alpha_sigma(t))
        clean = (alpha * x_t - sigma * v).clamp(-1, 1)
        return (x_t - alpha * clean) / sigma.clamp_min(1e-4)

    def weight(self, t: float) -> float:
        """m(t) = 1 - alphabar(t) = sigma(t)^2."""
        return float(alpha_sigma(t)[1] ** 2)

    def _resample(self, image: Tensor) -> Tensor:
        """(n, h, w, c) -> (n, c, side, side) by exact area averages (bilinear where the image is smaller)."""
        x, side = image.permute(0, 3, 1, 2), self.net.config.resolution
        if min(x.shape[2:]) < side:
            return F.interpolate(x, (side, side), mode="bilinear", align_corners=False)
        return F.adaptive_avg_pool2d(x, side)


def _read(path: Path) -> tuple[PocketConfig, dict[str, Tensor], frozenset[str], str]:
    """Configuration, float32 weights, the words of the training captions, and SHA-256 of a weights file."""
    from safetensors import SafetensorError, safe_open

    try:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        with safe_open(str(path), "pt") as file:
            notes = file.metadata() or {}
            stored, words = json.loads(notes["config"]), frozenset(json.loads(notes.get("words", "[]")))
            state = {name: file.get_tensor(name).float() for name in file.keys()}  # noqa: SIM118
        known = {f.name for f in dataclasses.fields(PocketConfig)}
        if set(stored) != known:
            raise KeyError(f"settings {sorted(set(stored) ^ known)}")
        return PocketConfig(**stored), state, words, digest
    except FileNotFoundError as error:
        message = f"there are no weights at '{path}'"
        raise PriorError("prior.missing", message, "reinstall the package or name another prior") from error
    except (OSError, SafetensorError, KeyError, ValueError) as error:
        message = f"'{path.name}' does not hold a pocket prior ({error})"
        raise PriorError("prior.weights", message, "name another file") from error
