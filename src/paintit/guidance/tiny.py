"""Tiny autoencoders (TAESD and its kin) in place of a prior's own: 1.2 million parameters in the encoder instead of 34.

They speak of the same latents, scaled already, and less exactly: the gradient that they pass back is another one.
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import torch

from paintit.errors import PriorError
from paintit.guidance import hub
from paintit.guidance.economy import Economy
from paintit.guidance.families import TINY_AUTOENCODER
from paintit.guidance.footprint import outline as fake
from paintit.guidance.hub import Checkpoint
from paintit.guidance.loading import Loading

AUTO = "auto"
#: Class of the autoencoders that they can stand in for.
STANDS_FOR = "AutoencoderKL"


def named(loading: Loading, found: Checkpoint) -> Economy:
    """``loading.economy``, naming the tiny autoencoder that it asks for beside the prior ``found``, if it asks for one.

    Raises:
        PriorError: none is known for it, or it cannot have one.
    """
    if not loading.economy.tiny:
        return loading.economy
    if _own(found).get("_class_name") != STANDS_FOR:
        raise PriorError(
            "prior.tiny", f"no tiny autoencoder that diffusers reads can stand in for that of '{found.id}'",
            "leave out --compute.tiny-vae",
        )  # fmt: skip
    wanted = loading.tiny if loading.economy.tiny == AUTO else loading.economy.tiny
    if not wanted:
        raise PriorError(
            "prior.tiny", f"no tiny autoencoder is known for '{found.id}'", "name one: --compute.tiny-vae FOLDER_OR_ID"
        )
    return replace(loading.economy, tiny=wanted)


def stand_in(loading: Loading, found: Checkpoint) -> str:
    """The one that a budget may fall back on; empty where there is none."""
    return loading.tiny if _own(found).get("_class_name") == STANDS_FOR else ""


def load(loading: Loading, found: Checkpoint, dtype: torch.dtype) -> Any:
    """The tiny autoencoder ``loading.economy.tiny``, seen to suit the prior ``found``.

    Raises:
        PriorError: it is not there, or it is made for other latents.
    """
    from diffusers.models.autoencoders.autoencoder_tiny import AutoencoderTiny

    small = hub.open_checkpoint(loading.economy.tiny, TINY_AUTOENCODER, allow_download=loading.allow_download)
    own = _own(found)
    ours, theirs = _latents(own), _latents(small.index)
    if ours != theirs:
        raise PriorError(
            "prior.tiny",
            f"the tiny autoencoder '{small.id}' has latents of {theirs[0]} channels, {theirs[1]} pixels a side, and "
            f"'{found.id}' of {ours[0]}, {ours[1]} pixels a side",
            f"choose {loading.tiny or 'one that was made for this model'}",
        )
    part = small.part(AutoencoderTiny, "", dtype)
    if "sample_size" in own:  # where some families keep the size of their pictures
        part.register_to_config(sample_size=own["sample_size"])
    return part


def outline(found: Checkpoint) -> Any:
    """One as it would suit the prior ``found``, without contents, in the usual widths."""
    from diffusers.models.autoencoders.autoencoder_tiny import AutoencoderTiny

    channels, factor = _latents(_own(found))
    levels = factor.bit_length()
    widths, blocks = (64,) * levels, (1, *(3,) * (levels - 1))
    with fake():
        return AutoencoderTiny(
            latent_channels=channels, encoder_block_out_channels=widths, decoder_block_out_channels=widths,
            num_encoder_blocks=blocks, num_decoder_blocks=blocks[::-1],
        )  # fmt: skip


def _own(found: Checkpoint) -> dict[str, Any]:
    """Configuration of the prior's own autoencoder; empty where it has none."""
    file = found.folder / "vae" / "config.json"
    return json.loads(file.read_text("utf-8")) if file.is_file() else {}


def _latents(config: Any) -> tuple[int, int]:
    """Channels of the latents, and pixels to each, a side."""
    widths = config.get("encoder_block_out_channels") or config["block_out_channels"]
    return int(config["latent_channels"]), 2 ** (len(widths) - 1)
