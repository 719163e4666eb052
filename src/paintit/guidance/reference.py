"""A reference picture beside the words, through an IP-Adapter (Ye 2023): every cross-attention of the U-Net also looks
at a few rows that an image encoder and a small network made of the picture."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from paintit.errors import PriorError
from paintit.guidance import hub
from paintit.guidance.additions import Weights, find_adapter, on_record, read_picture, shapes
from paintit.guidance.loading import Loading
from paintit.scaled import scaled


class Reference:
    """The rows of a picture, which follow the rows of a text in the same tensor.

    Args:
        shown: (1, r, d) rows of the picture, which every text gets but
        hidden: (1, r, d) those of no picture, which the unconditional texts get.
        loading: says which texts those are.
        record: the picture and the adapter in words.
    """

    def __init__(self, shown: Tensor, hidden: Tensor, loading: Loading, record: tuple[str, ...]) -> None:
        self.record = record
        self._shown, self._hidden = shown, hidden
        self._blind = {"", loading.negative}
        self._source = f", {loading.source}" if loading.source else ""

    def sees(self, text: str) -> bool:
        """Whether the picture belongs to ``text``: neither to the empty and the negative prompt, nor to a text that
        says how a paint looks so far (``prompt.source``)."""
        return text not in self._blind and not (self._source and text.endswith(self._source))

    def behind(self, words: Tensor, text: str) -> Tensor:
        """(1, n, d) embedding of ``text`` -> (1, n + r, d)."""
        return torch.cat([words, (self._shown if self.sees(text) else self._hidden).to(words)], 1)

    def split(self, packed: Tensor) -> tuple[Tensor, Tensor]:
        """(b, n + r, d) -> the words (b, n, d) and the picture (b, r, d)."""
        rows = self._shown.shape[1]
        return packed[:, :-rows], packed[:, -rows:]


def add_reference(pipeline: Any, loading: Loading, id: str) -> Reference | None:
    """The reference picture of ``loading``, encoded; None where there is none. Its encoder is not kept.

    Afterwards the U-Net takes a pair (words, [rows of the picture (b, 1, r, d)]) in place of the words. The network
    that makes rows of what the encoder says has done its work and is taken out of the U-Net: no step repeats it.

    Args:
        pipeline: an instance of a diffusers pipeline that takes IP-Adapters, on the host or on the device; its U-Net is
            changed in place.
        id: of the prior, for messages.

    Raises:
        PriorError: the picture or the adapter cannot be read, or the adapter is made for another U-Net.
    """
    if not loading.reference:
        return None
    name, scale = scaled(loading.reference, "guidance.reference")
    picture, digest = read_picture(name, loading.megapixels)
    source = loading.adapter
    found = find_adapter(source, loading.allow_download)
    read, width = _check(found, source, pipeline.unet, id)
    unet, device = pipeline.unet, torch.device(loading.device)
    with hub.quiet():
        from transformers import CLIPImageProcessor, CLIPVisionModelWithProjection

        encoder = _load(CLIPVisionModelWithProjection, found, source, unet.dtype).to(device)
        gives = getattr(encoder.config, read)
        if gives != width:
            raise PriorError(
                "prior.adapter",
                f"the IP-Adapter '{source}' reads {width} numbers, and its image encoder gives {gives}",
                "put the image encoder that it was trained with beside it",
            )
        side = encoder.config.image_size
        pipeline.register_modules(
            image_encoder=encoder, feature_extractor=CLIPImageProcessor(size=side, crop_size=side)
        )
        folder, file = str(found.file.parent), found.file.name
        pipeline.load_ip_adapter(folder, "", file, image_encoder_folder=None, local_files_only=True)
        pipeline.set_ip_adapter_scale(scale)
        with torch.no_grad():
            # The second half is of the picture, the first of none: what the pipeline gives to its unconditional half.
            embedded = pipeline.prepare_ip_adapter_image_embeds(picture, None, device, 1, True)
            rows = unet.encoder_hid_proj([part.to(unet.device, unet.dtype) for part in embedded])[0]
            hidden, shown = rows[:, 0].split(1)
        unet.encoder_hid_proj = None
        pipeline.register_modules(image_encoder=None, feature_extractor=None)
    record = (on_record("reference", name, scale, digest), on_record("IP-Adapter", source, 1.0, found.revision))
    return Reference(shown, hidden, loading, record)


def weigh(loading: Loading) -> int:
    """Bytes that the IP-Adapter of ``loading`` adds to the network's weights; its image encoder is not kept.

    Raises:
        PriorError: it cannot be had.
    """
    if not loading.reference or not loading.adapter:
        return 0
    found = find_adapter(loading.adapter, loading.allow_download)
    sizes = [math.prod(s) for name, s in shapes(found.file, loading.adapter).items() if name.startswith("ip_adapter.")]
    return sum(sizes) * hub.precision(torch.device(loading.device), loading.dtype).itemsize


def _check(found: Weights, source: str, unet: Any, id: str) -> tuple[str, int]:
    """That the adapter was made for such a U-Net, by the shapes of its arrays.

    Returns:
        What of its image encoder it reads, as that one's configuration calls the width of it, and that width.

    Raises:
        PriorError: it was not; or it is none of the plain, plus or full-face kinds; or it cannot be read.
    """
    arrays = shapes(found.file, source)
    plain, face, plus = (f"image_proj.{name}.weight" for name in ("proj", "proj.0", "proj_in"))
    reads = next((name for name in (plain, face, plus) if name in arrays), None)
    of_faces = any("to_k_lora" in name or "perceiver_resampler" in name for name in arrays)
    if reads is None or of_faces or (reads == face and "image_proj.proj.3.weight" not in arrays):
        kind = "is made for recognised faces" if of_faces or reads == face else "is no IP-Adapter"
        raise PriorError("prior.adapter", f"'{source}' {kind}", "give a plain or a plus one, such as ip-adapter_sd15")
    wanted = [tuple(m.attn2.to_k.weight.shape) for m in unet.modules() if getattr(m, "attn2", None) is not None]
    given = [shape for name, shape in arrays.items() if name.endswith("to_k_ip.weight")]
    if sorted(wanted) != sorted(given):
        raise PriorError(
            "prior.adapter",
            f"the IP-Adapter '{source}' is made for {_described(given)}, and '{id}' has {_described(wanted)}",
            "choose one made for this architecture; Stable Diffusion 1.x, 2.x and XL each need their own",
        )
    return "projection_dim" if reads == plain else "hidden_size", arrays[reads][1]


def _described(attentions: list[tuple[int, ...]]) -> str:
    widths = sorted({shape[1] for shape in attentions})
    return f"{len(attentions)} cross-attentions to {' or '.join(map(str, widths)) or 'no'} numbers"


def _load(cls: Any, found: Weights, source: str, dtype: torch.dtype) -> Any:
    """The image encoder beside the adapter, safetensors only."""
    try:
        folder = found.beside[0].parent
        return cls.from_pretrained(folder, local_files_only=True, use_safetensors=True, dtype=dtype).eval()
    except Exception as error:
        reason = next(iter(str(error).strip().splitlines()), "") or type(error).__name__
        raise PriorError(
            "prior.load", f"the image encoder of '{source}' cannot be loaded: {reason}", "fetch it again"
        ) from error
