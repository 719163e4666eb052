"""LoRAs: small changes to the weights of a network and its text encoders (Hu 2021), added to them before painting."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from torch import Tensor, nn

from paintit.errors import PriorError
from paintit.guidance import hub
from paintit.guidance.additions import Weights, belongs, find_lora, on_record
from paintit.guidance.loading import Loading
from paintit.scaled import scaled


def add_loras(pipeline: Any, loading: Loading, id: str) -> tuple[str, ...]:
    """W + s (alpha / rank) B A in place of W, for every LoRA of ``loading`` one after another: s is its scale.

    Afterwards the pipeline's modules are plain again, so that a step costs what it costs without.

    Args:
        pipeline: an instance of a diffusers pipeline that can load LoRAs; its modules are changed in place.
        id: of the prior, for messages.

    Returns:
        Each in words.

    Raises:
        PriorError: there is no such file, it is pickled, holds no LoRA, or is made for another model.
    """
    added: list[str] = []
    for text in loading.lora:
        source, scale = scaled(text, "guidance.lora")
        found = find_lora(source, loading.allow_download)
        with hub.quiet():
            _fuse(pipeline, found, source, scale, id)
        added.append(on_record("LoRA", source, scale, found.revision))
    return tuple(added)


def _fuse(pipeline: Any, found: Weights, source: str, scale: float, id: str) -> None:
    place: dict[str, Any] = {"weight_name": found.file.name, "local_files_only": True, "use_safetensors": True}
    folder, name = str(found.file.parent), "paintit"
    try:
        pipeline.load_lora_weights(folder, adapter_name=name, **place)
        state = pipeline.lora_state_dict(folder, **place)
        given = _numbers((state[0] if isinstance(state, tuple) else state).items())
        modules = [part for part in pipeline.components.values() if isinstance(part, nn.Module)]
        taken = sum(_numbers(module.named_parameters()) for module in modules)
        if taken != given:  # diffusers leaves out what it finds no place for
            raise ValueError(f"{taken} of its {given} numbers have a place in it")
        pipeline.fuse_lora(lora_scale=scale, safe_fusing=True, adapter_names=[name])
        pipeline.unload_lora_weights()
    except Exception as error:  # whatever diffusers and peft say of a LoRA for another network
        raise PriorError(
            "prior.lora",
            f"the LoRA '{source}' does not fit '{id}': {_reason(error)}",
            "choose one that was made for this model",
        ) from error


def _reason(error: Exception) -> str:
    """``error`` in a few words; of arrays with the wrong shape, the first."""
    text = " ".join(str(error).split()) or type(error).__name__
    shapes = re.search(r"size mismatch for (\S+?)(?:\.weight)?: .*?Size\(\[(.*?)\]\).*?Size\(\[(.*?)\]\)", text)
    if not shapes:
        return text[:200]
    name, given, wanted = shapes.groups()
    return f"its {name} is ({given}), not ({wanted})"


def _numbers(arrays: Iterable[tuple[str, Tensor]]) -> int:
    """How many numbers the arrays of a LoRA have, ``alpha`` left out."""
    return sum(array.numel() for name, array in arrays if belongs(name) and not name.endswith("alpha"))
