"""Stable Diffusion 1.x and 2.x as a prior, also conditioned on depth, from any diffusers checkpoint: hub id or local
folder, safetensors only."""

from __future__ import annotations

import hashlib
import importlib
import json
import logging
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor
from torch.nn import functional

from paintit.errors import PriorError
from paintit.guidance.depth import relative_disparity
from paintit.guidance.prior import PriorSpec, ReadChannel, SeeChannel

if TYPE_CHECKING:
    from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
    from diffusers.models.unets.unet_2d_condition import UNet2DConditionModel
    from diffusers.schedulers.scheduling_ddim import DDIMScheduler
    from transformers import CLIPTextModel, CLIPTokenizer

log = logging.getLogger(__name__)

#: Pipelines whose parts are one U-Net, one KL autoencoder and one CLIP text encoder.
PIPELINES = ("StableDiffusionPipeline", "StableDiffusionImg2ImgPipeline", "StableDiffusionDepth2ImgPipeline")
#: Folder of each part that holds weights -> the stem of its weight file.
WEIGHTS = {"unet": "diffusion_pytorch_model", "vae": "diffusion_pytorch_model", "text_encoder": "model"}
#: What is fetched of a hub repository: the parts in one precision, not its single-file copies.
FILES = (
    "model_index.json",
    "scheduler/*",
    "tokenizer/*",
    *(f"{part}/config.json" for part in WEIGHTS),
    *(f"{part}/{stem}{ending}" for part, stem in WEIGHTS.items() for ending in (".safetensors", "-0*.safetensors")),
    *(f"{part}/{stem}.safetensors.index.json" for part, stem in WEIGHTS.items()),
)
DTYPES = {"float32": torch.float32, "bfloat16": torch.bfloat16, "float16": torch.float16, "float64": torch.float64}


class StableDiffusionPrior:
    """A latent diffusion model behind the :class:`~paintit.guidance.prior.Prior` contract.

    Reads ``shaded`` alone; sees no geometry, or, where the U-Net takes one channel more than the latents have (the
    depth-to-image family), the depth. Latents are the mean of the autoencoder's posterior, without sampling
    noise, times the autoencoder's own scaling factor. t is rounded to the nearest of the model's training timesteps.

    Args:
        scheduler: source of ``alphas_cumprod`` and of the prediction type (epsilon, v_prediction or sample).
        chunk: most latents that go through the U-Net at once, to save memory; 0 for no limit.
    """

    reads: tuple[ReadChannel, ...] = ("shaded",)
    sees: tuple[SeeChannel, ...] = ()
    bound: float = math.inf

    def __init__(
        self,
        unet: UNet2DConditionModel,
        vae: AutoencoderKL,
        text_encoder: CLIPTextModel,
        tokenizer: CLIPTokenizer,
        scheduler: DDIMScheduler,
        *,
        id: str,
        revision: str = "",
        licence: str = "",
        chunk: int = 0,
    ) -> None:
        # diffusers' configs are attribute dictionaries that its annotations do not describe.
        unet_config: Any = unet.config
        vae_config: Any = vae.config
        prediction_type = str(scheduler.config["prediction_type"])
        if prediction_type not in ("epsilon", "v_prediction", "sample"):
            raise PriorError("prior.prediction", f"'{id}' predicts '{prediction_type}'", "choose an epsilon or v model")
        latent = vae_config.latent_channels
        if unet_config.in_channels not in (latent, latent + 1):
            raise PriorError(
                "prior.kind",
                f"the U-Net of '{id}' takes {unet_config.in_channels} channels, not {latent} (or {latent + 1}: depth)",
                "choose a text-to-image or depth-to-image checkpoint, not one for inpainting",
            )
        if unet_config.in_channels > latent:
            self.sees = ("depth", "mask")
        self.unet, self.vae, self.text_encoder, self.tokenizer = unet, vae, text_encoder, tokenizer
        for model in (unet, vae, text_encoder):
            model.requires_grad_(False).eval()
        self.chunk = chunk
        self.scaling_factor = float(vae_config.scaling_factor)
        self._factor = 2 ** (len(vae_config.block_out_channels) - 1)
        self.alphas_cumprod: list[float] = scheduler.alphas_cumprod.double().tolist()
        self._texts: dict[str, Tensor] = {}
        self.spec = PriorSpec(
            id=id,
            family="stable-diffusion",
            revision=revision,
            licence=licence,
            resolution=_side(unet_config.sample_size) * self._factor,
            prediction_type=prediction_type,
            guidance_scale=101.0,
        )

    @classmethod
    def load(
        cls,
        source: str | Path,
        *,
        device: str | torch.device = "cpu",
        dtype: str = "auto",
        revision: str = "",
        allow_download: bool = False,
        licence: str = "",
        chunk: int = 0,
    ) -> StableDiffusionPrior:
        """The checkpoint in the folder ``source``, or with the hub id ``source``.

        Args:
            dtype: ``auto`` is float32 on a CPU or MPS and, on CUDA, bfloat16 or, where the card has none, float16. The
                autoencoder keeps float32 beside a float16 U-Net: its gradients overflow otherwise.
            revision: commit, tag or branch of a hub id.
            allow_download: without it, a hub id must already be in the local cache.

        Raises:
            PriorError: the extra is not installed, the checkpoint is not there, or it is of another kind.
        """
        _require_extra()
        import diffusers
        import transformers

        local = Path(source).expanduser()
        folder = local if local.is_dir() else _snapshot(str(source), revision, allow_download)
        try:
            variant = _check(folder, str(source))
        except PriorError as error:
            if error.code == "prior.weights" and folder != local and not allow_download:
                raise _not_cached(str(source), revision) from error
            raise
        device = torch.device(device)
        precision = _precision(device, dtype)
        vae_precision = torch.float32 if precision == torch.float16 else precision
        options: dict[str, Any] = {"use_safetensors": True, "variant": variant, "local_files_only": True}
        hub: Any = diffusers
        clip: Any = transformers
        progress_bar = clip.utils.logging.is_progress_bar_enabled()
        clip.utils.logging.disable_progress_bar()
        try:
            unet = hub.UNet2DConditionModel.from_pretrained(folder, subfolder="unet", torch_dtype=precision, **options)
            vae = hub.AutoencoderKL.from_pretrained(folder, subfolder="vae", torch_dtype=vae_precision, **options)
            text_encoder = clip.CLIPTextModel.from_pretrained(
                folder, subfolder="text_encoder", dtype=precision, **options
            )
            tokenizer = clip.CLIPTokenizer.from_pretrained(folder, subfolder="tokenizer", local_files_only=True)
            scheduler = hub.DDIMScheduler.from_pretrained(folder, subfolder="scheduler", local_files_only=True)
        except Exception as error:
            reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
            raise PriorError(
                "prior.load", f"'{source}' cannot be loaded: {reason}", "fetch it again; a file may be cut short"
            ) from error
        finally:
            if progress_bar:
                clip.utils.logging.enable_progress_bar()
        return cls(
            unet.to(device),
            vae.to(device),
            text_encoder.to(device),
            tokenizer,
            scheduler,
            id=str(source),
            revision=folder.name if folder != local else _fingerprint(folder, variant),
            licence=licence,
            chunk=chunk,
        )

    @torch.no_grad()
    def encode_text(self, prompts: Sequence[str]) -> Tensor:
        """(n, tokens, d) CLIP embeddings; each distinct prompt is encoded once and kept."""
        for prompt in dict.fromkeys(prompts):
            if prompt not in self._texts:
                self._texts[prompt] = self.text_encoder(self._tokens(prompt).to(self.text_encoder.device))[0]
        return torch.cat([self._texts[prompt] for prompt in prompts])

    def _tokens(self, prompt: str) -> Tensor:
        """(1, 77) token ids, padded; what does not fit is cut, with a warning."""
        limit = self.tokenizer.model_max_length
        ids = self.tokenizer(prompt, padding="max_length", max_length=limit, truncation=True).input_ids
        needed = len(self.tokenizer(prompt).input_ids)
        if needed > limit:
            log.warning("the prompt takes %d tokens, of which %s reads %d: '%s'", needed, self.spec.id, limit, prompt)
        return torch.tensor([ids])

    def encode_image(self, channels: Mapping[str, Tensor]) -> Tensor:
        """``shaded`` (n, h, w, 3), sRGB-coded in [0, 1] -> latents (n, 4, resolution / 8, resolution / 8) float32."""
        image = channels["shaded"].permute(0, 3, 1, 2)
        size = (self.spec.resolution, self.spec.resolution)
        if image.shape[-2:] != size:
            image = functional.interpolate(image, size, mode="bilinear", antialias=True)
        encoded: Any = self.vae.encode((2 * image - 1).to(self.vae.device, self.vae.dtype))
        latents = self.scaling_factor * encoded.latent_dist.mean
        return latents.to(torch.promote_types(latents.dtype, torch.float32))

    @torch.no_grad()
    def decode_image(self, x: Tensor) -> dict[str, Tensor]:
        """Latents (n, 4, h, w) -> ``shaded`` (n, 8 h, 8 w, 3) in [0, 1]."""
        latents: Any = (x / self.scaling_factor).to(self.vae.device, self.vae.dtype)
        image: Any = torch.cat([self.vae.decode(part, return_dict=False)[0] for part in latents.split(1)])
        return {"shaded": ((image.movedim(1, -1) + 1) / 2).clamp(0, 1).to(x)}

    @torch.no_grad()
    def encode_geometry(self, channels: Mapping[str, Tensor]) -> Tensor | None:
        """None, or inverse depth (n, 1, resolution / 8, resolution / 8), see :func:`depth.relative_disparity`."""
        if not self.sees:
            return None
        return relative_disparity(channels["depth"], channels["mask"], self.spec.resolution // self._factor)

    def timestep(self, t: float) -> int:
        """The training timestep nearest to the fraction t of the schedule."""
        return min(round(t * len(self.alphas_cumprod)), len(self.alphas_cumprod) - 1)

    def alpha_sigma(self, t: float) -> tuple[float, float]:
        """sqrt(alphabar) and sqrt(1 - alphabar)."""
        alphabar = self.alphas_cumprod[self.timestep(t)]
        return alphabar**0.5, (1 - alphabar) ** 0.5

    def add_noise(self, x: Tensor, noise: Tensor, t: float) -> Tensor:
        alpha, sigma = self.alpha_sigma(t)
        return alpha * x + sigma * noise

    @torch.no_grad()
    def predict_noise(self, x_t: Tensor, t: float, text: Tensor, geometry: Tensor | None = None) -> Tensor:
        """epsilon-hat, in the type of ``x_t``, whatever the model predicts.

        Raises:
            ValueError: there is no ``geometry``, and the model sees depth.
        """
        if bool(self.sees) != (geometry is not None):
            raise ValueError(f"'{self.spec.id}' sees {self.sees or 'no geometry'}")
        inputs = x_t if geometry is None else torch.cat([x_t, geometry.to(x_t)], 1)
        native = torch.cat(
            [
                self.unet(part.to(self.unet.dtype), self.timestep(t), words.to(self.unet.dtype)).sample
                for part, words in zip(self._chunks(inputs), self._chunks(text), strict=True)
            ]
        )
        return to_epsilon(native.to(x_t), x_t, *self.alpha_sigma(t), self.spec.prediction_type)

    def _chunks(self, batch: Tensor) -> tuple[Tensor, ...]:
        return batch.split(self.chunk or len(batch))

    def weight(self, t: float) -> float:
        """1 - alphabar(t), as the official script."""
        return 1 - self.alphas_cumprod[self.timestep(t)]


def to_epsilon(native: Tensor, x_t: Tensor, alpha: float, sigma: float, prediction_type: str) -> Tensor:
    """epsilon of x_t = alpha x + sigma epsilon, from a prediction of it, of x, or of v = alpha epsilon - sigma x."""
    match prediction_type:
        case "v_prediction":
            return alpha * native + sigma * x_t
        case "sample":
            return (x_t - alpha * native) / sigma
        case _:
            return native


def _require_extra() -> None:
    for module in ("diffusers", "transformers"):
        try:
            importlib.import_module(module)
        except ImportError as error:
            raise PriorError(
                "prior.extra",
                f"Stable Diffusion needs the package '{module}': {error}",
                "pip install 'paintit[diffusers]'",
            ) from error


def on_this_machine(source: str, revision: str = "") -> bool:
    """Whether the checkpoint of the hub id ``source`` is whole in the local cache. Nothing is loaded or downloaded."""
    try:
        _require_extra()
        _check(_snapshot(source, revision, False), source)
    except PriorError:
        return False
    return True


def _snapshot(source: str, revision: str, allow_download: bool) -> Path:
    """Folder of the hub id ``source`` in the local cache; downloads only where that is allowed."""
    from huggingface_hub import snapshot_download
    from huggingface_hub.errors import HFValidationError, LocalEntryNotFoundError

    try:
        return Path(
            snapshot_download(
                source, revision=revision or None, allow_patterns=list(FILES), local_files_only=not allow_download
            )
        )
    except HFValidationError as error:
        raise PriorError("prior.missing", f"'{source}' is neither a folder nor a hub id", "check the path") from error
    except LocalEntryNotFoundError as error:
        if allow_download:
            raise PriorError("prior.download", f"'{source}' cannot be downloaded", "check the connection") from error
        raise _not_cached(source, revision) from error
    except Exception as error:
        raise PriorError(
            "prior.download",
            f"'{source}' cannot be downloaded: {str(error).strip().splitlines()[0] or type(error).__name__}",
            "check the id, the revision and the connection",
        ) from error


def _not_cached(source: str, revision: str) -> PriorError:
    at = f" at revision '{revision}'" if revision else ""
    return PriorError(
        "prior.not_cached",
        f"'{source}'{at} is not on this machine, and nothing is downloaded unasked",
        "allow the download with --allow-download (allow_download=True in Python), or give a folder",
    )


def _check(folder: Path, source: str) -> str | None:
    """The variant of the weight files in ``folder``, once it is seen to hold every part of such a checkpoint."""
    index = folder / "model_index.json"
    if not index.is_file():
        raise PriorError("prior.folder", f"'{source}' has no model_index.json", "give a folder that diffusers saved")
    try:
        pipeline = json.loads(index.read_text(encoding="utf-8"))["_class_name"]
    except (ValueError, KeyError, TypeError) as error:
        raise PriorError("prior.folder", f"'{index}' is not a diffusers index", "fetch the checkpoint again") from error
    if pipeline not in PIPELINES:
        raise PriorError(
            "prior.kind",
            f"'{source}' is a {pipeline}",
            "choose a Stable Diffusion 1.x or 2.x checkpoint, text-to-image or depth-to-image",
        )
    # transformers makes an empty tokenizer of a missing vocabulary, without a word.
    for needed in (("tokenizer/vocab.json", "tokenizer/tokenizer.json"), ("scheduler/scheduler_config.json",)):
        if not any((folder / name).is_file() for name in needed):
            raise PriorError("prior.weights", f"'{source}' has no {needed[0]}", f"look into {folder}")
    variants = {_variant(folder, part, stem, source) for part, stem in WEIGHTS.items()}
    if len(variants) > 1:
        raise PriorError(
            "prior.weights", f"'{source}' mixes fp16 and plain weight files", "keep one precision of all three parts"
        )
    return variants.pop()


def _variant(folder: Path, part: str, stem: str, source: str) -> str | None:
    there = [path.name for path in (folder / part).glob("*")]
    if any(name.startswith(stem) and name.endswith(".safetensors") and ".fp16" not in name for name in there):
        return None
    if any(name.startswith(stem) and name.endswith(".safetensors") for name in there):
        return "fp16"
    if any(name.endswith((".bin", ".ckpt", ".pt")) for name in there):
        raise PriorError(
            "prior.pickle",
            f"'{source}' has its {part} only as pickle, which can run code when read",
            "choose a checkpoint with safetensors, or convert it with diffusers",
        )
    raise PriorError("prior.weights", f"'{source}' has no weights for its {part}", f"look into {folder / part}")


def _fingerprint(folder: Path, variant: str | None) -> str:
    """SHA-256 of the U-Net's weight files, what a folder has in place of a commit."""
    digest = hashlib.sha256()
    for path in sorted((folder / "unet").glob("*.safetensors")):
        if (".fp16" in path.name) == (variant == "fp16"):
            with path.open("rb") as file:
                digest.update(hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()


def _precision(device: torch.device, dtype: str) -> torch.dtype:
    if dtype == "auto":
        if device.type != "cuda":
            return torch.float32
        return torch.bfloat16 if torch.cuda.is_bf16_supported(including_emulation=False) else torch.float16
    if dtype not in DTYPES:
        raise PriorError("prior.dtype", f"there is no precision '{dtype}'", f"choose auto, {', '.join(DTYPES)}")
    return DTYPES[dtype]


def _side(sample_size: int | Sequence[int]) -> int:
    return sample_size if isinstance(sample_size, int) else int(sample_size[0])
