"""Settings in and out of dicts and TOML, and their checks. Unknown keys are errors that name the nearest known one."""

from __future__ import annotations

import dataclasses
import difflib
import json
import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import UnionType
from typing import Any, Literal, NoReturn, Union, get_args, get_origin, get_type_hints

from paintit.config import (
    POCKET,
    FocusConfig,
    GuidanceConfig,
    PaintConfig,
    PromptConfig,
    TextureConfig,
    plain,
    preset,
    to_dict,
    with_prior,
    word_for_none,
)  # fmt: skip
from paintit.control import Control
from paintit.errors import UsageError
from paintit.scaled import scaled


def from_dict(data: Mapping[str, Any], base: PaintConfig = POCKET) -> PaintConfig:
    """``base`` with the values of a nested dict put in their places; see :func:`with_prior` where the prior changes.

    Raises:
        UsageError: an unknown key (the nearest one is named), or a value of the wrong type or out of range.
    """
    guidance = data.get("guidance")
    prior = guidance.get("prior") if isinstance(guidance, Mapping) else None
    config = _merge(with_prior(base, prior) if isinstance(prior, str) else base, data, "")
    validate(config)
    return config


def same_settings(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Whether two nested dicts say the same, a setting that one of them does not know yet standing at its default."""
    try:
        return from_dict(one, PaintConfig()) == from_dict(other, PaintConfig())
    except UsageError:  # a setting that is no more
        return one == other


def merge(base: PaintConfig, changes: Mapping[str, Any]) -> PaintConfig:
    """``base`` with dotted keys replaced: ``merge(POCKET, {"optim.steps": 20})``. Errors as ``from_dict``."""
    nested: dict[str, Any] = {}
    for key, value in changes.items():
        *groups, name = key.split(".")
        place = nested
        for group in groups:
            place = place.setdefault(group, {})
        place[name] = value
    return from_dict(nested, base)


def names(cls: Any = PaintConfig, prefix: str = "") -> tuple[str, ...]:
    """Dotted names of every setting, in order: ``texture.kind``, ..., ``dtype``."""
    hints = get_type_hints(cls)
    found: list[str] = []
    for f in dataclasses.fields(cls):
        nested = dataclasses.is_dataclass(hints[f.name])
        found += names(hints[f.name], f"{prefix}{f.name}.") if nested else [prefix + f.name]
    return tuple(found)


def nearest(word: str, choices: Iterable[str]) -> str | None:
    """The choice most like ``word``, or None where none is alike; bare ``steps`` finds ``optim.steps``."""
    choices = tuple(choices)
    for choice in choices:
        if choice.rpartition(".")[2] == word.rpartition(".")[2]:
            return choice
    close = difflib.get_close_matches(word, choices, n=1, cutoff=0.6)
    return close[0] if close else None


def load_toml(path: Path, base: PaintConfig | None = None) -> PaintConfig:
    """Settings from a TOML file over ``base``; without one, over the preset that its key ``preset`` names, else pocket.

    Raises:
        UsageError: no such file, not TOML, or what ``from_dict`` refuses; the message names the file.
    """
    try:
        data = tomllib.loads(path.read_text("utf-8"))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise UsageError("config.unreadable", f"cannot read settings from {path}: {reason}", "check the path") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())
        raise UsageError("config.not_toml", f"{path} is not TOML: {reason}", "correct that line") from None
    named = data.pop("preset", None)
    if base is None:
        base = POCKET if named is None else preset(str(named))
    try:
        return from_dict(data, base)
    except UsageError as error:
        raise UsageError(error.code, f"{path}: {error.message}", error.hint) from None


def dump_toml(config: PaintConfig) -> str:
    """Every setting as TOML text; ``load_toml`` of it gives ``config`` back over any base."""
    return "\n".join(_toml_table(to_dict(config), "")).strip() + "\n"


def _toml_table(table: Mapping[str, Any], name: str) -> list[str]:
    lines = [f"{key} = {_toml_value(value)}" for key, value in table.items() if not isinstance(value, dict)]
    for key, value in table.items():
        if isinstance(value, dict):
            inner = f"{name}.{key}" if name else key
            lines += ["", f"[{inner}]", *_toml_table(value, inner)]
    return lines


def _toml_value(value: Any) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case dict():
            return "{ " + ", ".join(f"{k} = {_toml_value(v)}" for k, v in value.items()) + " }"
        case list():
            return "[" + ", ".join(_toml_value(v) for v in value) + "]"
        case _:
            return repr(value)


def _merge(base: Any, data: Any, prefix: str) -> Any:
    if not isinstance(data, Mapping):
        raise UsageError(
            "config.wrong_type", f"'{prefix[:-1]}' is {data!r}, not a table of settings", f"write it as [{prefix[:-1]}]"
        )
    hints = get_type_hints(type(base))
    changes: dict[str, Any] = {}
    for key, value in data.items():
        if key not in hints:
            near = nearest(prefix + key, (*names(), *(f.name for f in dataclasses.fields(base))))
            hint = f"did you mean '{near}'?" if near else f"known here: {', '.join(hints)}"
            raise UsageError("config.unknown_key", f"unknown setting '{prefix}{key}'", hint)
        current = getattr(base, key)
        if dataclasses.is_dataclass(current):
            changes[key] = _merge(current, value, f"{prefix}{key}.")
        else:
            changes[key] = _typed(value, hints[key], prefix + key)
    return dataclasses.replace(base, **changes)


def _typed(value: Any, hint: Any, name: str) -> Any:
    """``value`` as the annotated type; only harmless changes: int to float, list to tuple, the word for None to it."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Literal:
        if value in inner:
            return value
        near = nearest(str(value), inner)
        raise UsageError(
            "config.choice",
            f"'{name}' is {value!r}",
            f"did you mean {near!r}?" if near else f"choose one of {', '.join(map(str, inner))}",
        )
    if origin in (Union, UnionType):
        if value is None or value == word_for_none(name):
            return None
        return _typed(value, next(t for t in inner if t is not type(None)), name)
    if origin is tuple:
        if isinstance(value, (list, tuple)) and (inner[-1] is Ellipsis or len(value) == len(inner)):
            parts = [inner[0]] * len(value) if inner[-1] is Ellipsis else inner
            return tuple(_typed(v, t, f"{name}[{i}]") for i, (v, t) in enumerate(zip(value, parts, strict=True)))
    elif dataclasses.is_dataclass(hint) and isinstance(hint, type):
        if isinstance(value, hint):
            return value
        if isinstance(value, Mapping):
            return _focus(value, name)
    elif hint is float and isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    elif isinstance(hint, type) and isinstance(value, hint) and not (hint is int and isinstance(value, bool)):
        return value
    wanted = {int: "a whole number", float: "a number", str: "text", bool: "true or false"}.get(hint, "")
    if origin is tuple:
        wanted = "a list" if inner[-1] is Ellipsis else f"a list of {len(inner)} values"
    raise UsageError("config.wrong_type", f"'{name}' is {value!r}", f"it must be {wanted or 'a table'}")


def _focus(data: Mapping[str, Any], name: str) -> FocusConfig:
    hints = get_type_hints(FocusConfig)
    for key in data:
        if key not in hints:
            raise UsageError("config.unknown_key", f"unknown setting '{name}.{key}'", f"known here: {', '.join(hints)}")
    for key in ("center", "radius"):
        if key not in data:
            raise UsageError("config.missing_key", f"'{name}' has no {key}", "write center = [x, y, z] and radius")
    return FocusConfig(**{key: _typed(value, hints[key], f"{name}.{key}") for key, value in data.items()})


#: What a prior can read (``guidance.prior.ReadChannel``, which this file may not import).
CHANNELS = ("shaded", "base_color", "roughness", "metallic")
#: What the paper of ``nfsd`` moves away from (2310.17590).
NEGATIVE_EXAMPLE = (
    "'unrealistic, blurry, low quality, out of focus, ugly, low contrast, dull, dark, low-resolution, gloomy'"
)
#: Lowest and highest allowed value (both allowed) of each bounded number, by dotted name.
_LIMITS: dict[str, tuple[float, float]] = {
    "texture.size": (8, 8192),
    "texture.input_channels": (1, 1024),
    "texture.min_roughness": (0, 1),
    "texture.normal_strength": (0, 1),
    "texture.tv_weight": (0, math.inf),
    "texture.grid_levels": (1, 32),
    "texture.grid_features": (1, 16),
    "texture.grid_table": (4, 24),
    "texture.grid_base": (1, 1024),
    "texture.hidden": (1, 1024),
    "light.exposure": (0, math.inf),
    "light.rotation": (-math.inf, math.inf),
    "views.count": (1, 256),
    "views.radius": (1, 1000),
    "views.fov": (1, 170),
    "views.close_up": (0, 1),
    "views.size": (8, 8192),
    "views.background": (0, 1),
    "guidance.scale": (-math.inf, math.inf),
    "guidance.rescale": (0, 1),
    "guidance.control_end": (0, 1),
    "optim.steps": (1, 10_000_000),
    "optim.decay": (0, 1),
    "optim.decay_every": (1, 10_000_000),
    "optim.clip": (0, math.inf),
    "projection.views": (1, 100_000),
    "projection.steps": (1, 1000),
    "projection.scale": (-math.inf, math.inf),
    "projection.eta": (0, 1),
    "projection.refine": (0, 1),
    "projection.better": (1, 1000),
    "compute.memory": (0.1, 1e6),
    "compute.chunk": (0, 1_000_000),
    "compute.recompute": (0, 1_000_000),
    "limits.file_mib": (1, 1_000_000_000),
    "limits.faces": (1, 1_000_000_000),
    "limits.nodes": (1, 1_000_000_000),
    "limits.materials": (1, 1_000_000),
    "limits.image_megapixels": (1, 1_000_000),
    "seed": (0, 2**63 - 1),
}
#: Pairs (low, high), each with the range both ends must lie in.
_RANGES: dict[str, tuple[float, float]] = {
    "views.elevation": (-90, 90),
    "views.focus_elevation": (-90, 90),
    "views.azimuth": (-720, 720),
    "guidance.t_start": (0.001, 1),
    "guidance.t_end": (0.001, 1),
}


def _get(config: PaintConfig, name: str) -> Any:
    value: Any = config
    for part in name.split("."):
        value = getattr(value, part)
    return value


def _refuse(name: str, value: Any, remedy: str) -> NoReturn:
    raise UsageError("config.value", f"{name} is {_toml_value(plain(value))}", remedy)


def validate(config: PaintConfig) -> None:
    """Check every value against its range.

    Raises:
        UsageError: ``config.value``, naming the first offending value and what it may be.
    """
    for name, (low, high) in _LIMITS.items():
        value = _get(config, name)
        if value is not None and not (low <= value <= high and math.isfinite(value)):
            span = f"at least {low}" if high == math.inf else f"from {low} to {high}"
            _refuse(name, value, "it must be a finite number" if low == -math.inf else f"it must be {span}")
    if not 0 < config.optim.lr < math.inf:
        _refuse("optim.lr", config.optim.lr, "it must be greater than 0")
    for name, (low, high) in _RANGES.items():
        a, b = _get(config, name)
        if not low <= a <= b <= high:
            _refuse(name, (a, b), f"it must be two numbers, the lower first, from {low} to {high}")
    if config.method == "distillation":  # a projection has neither network nor loss
        _validate_texture(config.texture)
        _validate_loss(config.guidance, config.prompt)
    reads = config.guidance.reads
    if config.texture.maps == "base_color" and reads and not {"shaded", "base_color"} & set(reads):
        _refuse("guidance.reads", reads, "include shaded or base_color: texture.maps base_color learns nothing else")
    for index, focus in enumerate(config.views.focus):
        if not 0 < focus.radius < math.inf:
            _refuse(f"views.focus[{index}].radius", focus.radius, "it must be greater than 0")
        if not all(map(math.isfinite, focus.center)):
            _refuse(f"views.focus[{index}].center", focus.center, "it must be three finite numbers")
    if "{prompt}" not in config.prompt.template:
        _refuse("prompt.template", config.prompt.template, "it must contain {prompt}")
    if not re.fullmatch(r"auto|mps|(cpu|cuda(:\d+)?)(,(cpu|cuda(:\d+)?))*", config.device):
        _refuse("device", config.device, "choose auto, cpu, cuda, cuda:N, mps, or several GPUs as cuda:0,cuda:1")
    for channel in config.guidance.reads:
        if channel not in CHANNELS:
            _refuse("guidance.reads", config.guidance.reads, f"choose from {', '.join(CHANNELS)}")
    _validate_control(config.guidance.control)
    _validate_compute(config)
    _validate_additions(config.guidance)
    if not config.guidance.prior.strip():
        _refuse("guidance.prior", config.guidance.prior, "name one; 'paintit priors list' shows them")


def _validate_loss(guidance: GuidanceConfig, prompt: PromptConfig) -> None:
    loss = guidance.loss
    if guidance.rescale and loss in ("csd", "nfsd", "bridge"):
        _refuse("guidance.rescale", guidance.rescale, f"it must be 0 with {loss}, which forms no guided prediction")
    if guidance.perp_neg and loss in ("nfsd", "bridge"):
        _refuse("guidance.perp_neg", True, f"it must be false with {loss}, which has its own use of negative words")
    if (guidance.perp_neg or loss == "nfsd") and not prompt.negative.strip():
        why = "perp_neg" if guidance.perp_neg else loss
        _refuse("prompt.negative", prompt.negative, f"{why} needs words to move away from: {NEGATIVE_EXAMPLE}")
    if loss == "bridge" and not prompt.source.strip():
        _refuse("prompt.source", prompt.source, "bridge needs words for how a paint looks so far")
    if guidance.timesteps == "non-increasing" and guidance.t_end[0] > guidance.t_start[1]:
        remedy = f"with non-increasing timesteps its lowest must not be above {guidance.t_start[1]}, where they start"
        _refuse("guidance.t_end", guidance.t_end, remedy)


def _validate_compute(config: PaintConfig) -> None:
    if config.compute.compile == "on" and config.compute.offload:
        _refuse("compute.compile", "on", "with compute.offload it must be auto or off: weights would come and go")


def _validate_control(texts: tuple[str, ...]) -> None:
    kinds = [Control.parse(text).kind for text in texts]
    for kind in kinds:
        if kinds.count(kind) > 1:
            _refuse("guidance.control", texts, f"name {kind} once")


def _validate_additions(guidance: GuidanceConfig) -> None:
    for text in guidance.lora:
        scaled(text, "guidance.lora")
    if guidance.reference and scaled(guidance.reference, "guidance.reference")[1] < 0:
        _refuse("guidance.reference", guidance.reference, "its scale must be 0 or more")
    if guidance.adapter and not guidance.reference:
        _refuse("guidance.adapter", guidance.adapter, "it needs a picture: --reference IMAGE")


def _validate_texture(texture: TextureConfig) -> None:
    if texture.kind != "dcpbr":
        return
    levels = len(texture.widths)
    if not levels or min(texture.widths) < 1:
        _refuse("texture.widths", texture.widths, "it must be one or more positive channel counts, finest level first")
    if len(texture.skip_widths) != levels or min(texture.skip_widths) < 0:
        _refuse("texture.skip_widths", texture.skip_widths, f"it must be {levels} counts of 0 or more, one per level")
    if texture.upsample < 1 or texture.upsample & (texture.upsample - 1):
        _refuse("texture.upsample", texture.upsample, "it must be a power of two: 1, 2, 4, ...")
    unit = texture.upsample * 2**levels
    if texture.size % unit or texture.size < 2 * unit:
        near = max(2, round(texture.size / unit)) * unit
        network = f"{levels} levels" + (f" at 1/{texture.upsample} of it" if texture.upsample > 1 else "")
        need = f"need a multiple of {unit}, at least {2 * unit}, for example {near}"
        _refuse("texture.size", texture.size, f"{network} {need}")
