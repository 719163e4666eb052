"""Published feature networks whose weights are not ours to ship: FID's Inception, and CLIP through ``transformers``."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from paintit.errors import PaintitError
from paintit.evaluate.features import Network

#: TorchScript of the network that FID was published with, as the StyleGAN family and clean-fid read it.
INCEPTION_URL = "https://nvlabs-fi-cdn.nvidia.com/stylegan2-ada-pytorch/pretrained/metrics/inception-2015-12-05.pt"
INCEPTION_HASH = "f58cb9b6"
INCEPTION_FEATURES, INCEPTION_SIDE = 2048, 299
#: Hub ids of the published checkpoints.
CLIP_SOURCES = {"clip": "openai/clip-vit-base-patch32", "clip-large": "openai/clip-vit-large-patch14-336"}
#: Mean and deviation of the pictures that CLIP was trained on.
_MEAN, _DEVIATION = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)


def inception(weights: str = "", allow_download: bool = False) -> Network:
    """Inception v3's 2048 pooled features.

    Args:
        weights: the TorchScript file; "" takes the one in torch's hub folder.

    Raises:
        PaintitError: there is no such file, or it is no such network.
    """
    cached = Path(torch.hub.get_dir()) / "checkpoints" / INCEPTION_URL.rpartition("/")[2]
    path = Path(weights) if weights else cached
    if not path.is_file() and not weights and allow_download:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            torch.hub.download_url_to_file(INCEPTION_URL, str(path), INCEPTION_HASH, progress=False)
        except OSError as error:
            raise _absent("inception", f"{INCEPTION_URL} cannot be fetched ({error})") from error
    if not path.is_file():
        raise _absent("inception", f"there is no {path}")
    try:
        with warnings.catch_warnings():  # torch would have TorchScript replaced, but it is what was published
            warnings.filterwarnings("ignore", ".*torch.jit", DeprecationWarning)
            net: Any = torch.jit.load(str(path), map_location="cpu").eval()
        found = net(torch.zeros(1, 3, INCEPTION_SIDE, INCEPTION_SIDE), return_features=True).shape[-1]
    except (RuntimeError, ValueError, TypeError) as error:
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise _absent("inception", f"{path} is not that network: {reason}") from error
    # It wants 0 to 255, and resizes nothing that is of its own size already.
    return Network("inception", found, INCEPTION_SIDE, lambda images: net(images * 255, return_features=True))


def clip(name: str, weights: str = "", allow_download: bool = False) -> Network:
    """CLIP's image and text embeddings, not yet of unit length.

    Args:
        name: a key of :data:`CLIP_SOURCES`.
        weights: a folder that ``transformers`` saved; "" takes the published checkpoint from the hub's cache.

    Raises:
        PaintitError: the extra is not installed, or the checkpoint is not there.
    """
    try:
        import transformers
    except ImportError:
        raise PaintitError(
            "evaluate.extra", f"'{name}' needs transformers", "install it: pip install 'paintit[evaluate]'"
        ) from None
    source = weights or CLIP_SOURCES[name]
    hub: Any = transformers
    try:
        net = hub.CLIPModel.from_pretrained(source, local_files_only=not allow_download, dtype=torch.float32).eval()
        tokenizer = hub.CLIPTokenizer.from_pretrained(source, local_files_only=not allow_download)
    except (OSError, ValueError) as error:
        raise _absent(name, f"'{source}' is not on this machine") from error
    net.requires_grad_(False)
    mean, deviation = (torch.tensor(x)[:, None, None] for x in (_MEAN, _DEVIATION))

    def read(images: Tensor) -> Tensor:
        return _embedding(net.get_image_features(pixel_values=(images - mean) / deviation))

    def words(texts: Sequence[str]) -> Tensor:
        tokens = tokenizer(list(texts), padding=True, truncation=True, return_tensors="pt")
        with torch.no_grad():
            return _embedding(net.get_text_features(tokens.input_ids, tokens.attention_mask))

    return Network(name, net.config.projection_dim, net.config.vision_config.image_size, read, words)


def _embedding(output: Any) -> Tensor:
    """The projected embedding: newer versions wrap it."""
    return output if isinstance(output, Tensor) else output.pooler_output


def _absent(name: str, reason: str) -> PaintitError:
    return PaintitError(
        "evaluate.weights", f"the weights of '{name}' are missing: {reason}",
        "give --weights PATH, add --allow-download, or use --features pocket, which needs none",
    )  # fmt: skip
