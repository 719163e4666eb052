"""Painter state <-> one safetensors file with a JSON header. Versioned; no pickle, so a checkpoint cannot run code."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as to_bytes
from torch import Tensor

from paintit.errors import RunError
from paintit.files import atomic
from paintit.paint.method import Method

VERSION = 1


def save(path: Path, painter: Method) -> None:
    """Write the painter's state to ``path``, whole or not at all.

    Raises:
        OutputError: the file system refuses.
    """
    state = painter.state_dict()
    tensors: dict[str, Tensor] = {f"field/{name}": value for name, value in state["field"].items()}
    tensors |= {f"streams/{name}": value for name, value in state["streams"].items()}
    for index, slots in state["optimizer"].items():
        tensors |= {f"optimizer/{index}/{name}": torch.as_tensor(value) for name, value in slots.items()}
    tensors["support/all"] = state["support"]
    header = {"paintit": json.dumps({"version": VERSION, "step": state["step"]})}
    contents = {name: value.detach().cpu().contiguous().clone() for name, value in tensors.items()}
    with atomic(path) as temporary:  # safetensors' own writer would hide from it that the disk is full
        temporary.write_bytes(to_bytes(contents, header))


def load(path: Path, painter: Method) -> None:
    """Put the state in ``path`` into ``painter``, which must have been made from the same mesh and settings.

    Raises:
        RunError: the file is missing, damaged, of another version, or of another shape.
    """
    remedy = "start again without --resume"
    try:
        with safe_open(path, "pt") as file:
            header = json.loads((file.metadata() or {}).get("paintit", "{}"))
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except FileNotFoundError:
        raise RunError("checkpoint.missing", f"there is no checkpoint {path}", remedy) from None
    except (SafetensorError, OSError, ValueError) as error:
        raise RunError("checkpoint.damaged", f"the checkpoint {path} cannot be read ({error})", remedy) from error
    if header.get("version") != VERSION:
        raise RunError(
            "checkpoint.version",
            f"the checkpoint {path} has version {header.get('version')}, this is {VERSION}",
            remedy,
        )
    state: dict[str, Any] = {"step": header["step"], "field": {}, "optimizer": {}, "streams": {}, "support": {}}
    for name, value in tensors.items():
        kind, _, rest = name.partition("/")
        if kind == "optimizer":
            index, _, slot = rest.partition("/")
            state["optimizer"].setdefault(int(index), {})[slot] = value
        else:
            state[kind][rest] = value
    state["support"] = state["support"]["all"]
    try:
        painter.load_state_dict(state)
    except (RuntimeError, KeyError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise RunError("checkpoint.mismatch", f"the checkpoint {path} does not fit ({reason})", remedy) from error
