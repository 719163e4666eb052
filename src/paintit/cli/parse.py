"""Arguments of one command -> its dataclass, by tyro. Every mistake becomes one ``UsageError`` with one line."""

from __future__ import annotations

import ast
import contextlib
import dataclasses
import functools
import inspect
import io
import itertools
import re
import sys
from collections.abc import Sequence
from typing import Annotated, Any, TypeVar, get_type_hints

import tyro
from tyro.constructors import (
    ConstructorRegistry,
    PrimitiveConstructorSpec,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

from paintit import config
from paintit.cli.globals import GLOBAL_FLAGS
from paintit.config import AUTO, NONE, RANDOM, FocusConfig, PaintConfig
from paintit.errors import UsageError
from paintit.settings import nearest

T = TypeVar("T")

#: Everyday spellings of nested settings. ``--group.name`` works too, in every case.
ALIASES = {
    "texture.size": "--texture-size",
    "light.path": "--light",
    "views.count": "--views",
    "views.size": "--render-size",
    "views.focus": "--focus",
    "prompt.negative": "--negative",
    "guidance.prior": "--prior",
    "guidance.control": "--control",
    "guidance.lora": "--lora",
    "guidance.reference": "--reference",
    "optim.steps": "--steps",
    "compute.memory": "--memory",
    "materials": "--material",
}
#: Flags that turn a setting off, and how tyro spells them.
OFF = {"--no-focus": "--views.no-auto-focus"}
_GROUPS = {hint: name for name, hint in get_type_hints(PaintConfig).items() if dataclasses.is_dataclass(hint)}
_GROUPS[PaintConfig] = ""


def focus(text: str) -> FocusConfig:
    """``x,y,z,radius[,name]`` in the file's units.

    Raises:
        UsageError: it is anything else.
    """
    parts = text.split(",", 4)
    try:
        x, y, z, radius = map(float, parts[:4])
    except ValueError:
        raise UsageError("usage.focus", f"--focus is '{text}'", "write x,y,z,radius or x,y,z,radius,name") from None
    name = parts[4].strip() if len(parts) > 4 else ""
    return FocusConfig((x, y, z), radius, name or FocusConfig.name)


def _focus_text(region: FocusConfig) -> str:
    return ",".join([*(f"{v:g}" for v in (*region.center, region.radius)), region.name])


_FOCUS = PrimitiveConstructorSpec(
    nargs="*",
    metavar="X,Y,Z,RADIUS[,NAME]",
    instance_from_str=lambda texts: tuple(focus(text) for text in texts),
    is_instance=lambda value: isinstance(value, tuple),
    str_from_instance=lambda regions: [_focus_text(region) for region in regions],
)


def _number_or(word: str, unit: str) -> PrimitiveConstructorSpec[float | None]:
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar=f"{unit}|{word}",
        instance_from_str=lambda texts: None if texts[0] == word else float(texts[0]),
        is_instance=lambda value: value is None or isinstance(value, (int, float)),
        str_from_instance=lambda value: [word if value is None else f"{value:g}"],
    )


#: Settings that no built-in rule of tyro reads as we write them.
_SPECS: dict[str, Any] = {
    "views.focus": _FOCUS,
    "light.rotation": _number_or(RANDOM, "DEGREES"),
    "guidance.scale": _number_or(AUTO, "FLOAT"),
    "guidance.scale_end": _number_or(NONE, "FLOAT"),
    "projection.scale": _number_or(AUTO, "FLOAT"),
    "compute.memory": _number_or(NONE, "GB"),
}


def _registry() -> ConstructorRegistry:
    """A rule that adds aliases and special forms to ``config.py``'s dataclasses, which know nothing of tyro."""
    registry = ConstructorRegistry()

    @registry.struct_rule
    def group(info: StructTypeInfo) -> StructConstructorSpec | None:
        if info.type not in _GROUPS:
            return None
        given = info.default if isinstance(info.default, info.type) else info.type()
        helps = _docstrings().get(info.type.__name__, {})
        fields = [
            StructFieldSpec(
                name, _type(f"{_GROUPS[info.type]}.{name}".lstrip("."), hint), getattr(given, name), helps.get(name)
            )
            for name, hint in get_type_hints(info.type).items()
        ]
        return StructConstructorSpec(info.type, tuple(fields))

    return registry


def _type(name: str, hint: Any) -> Any:
    kind: Any = Annotated[object, _SPECS[name]] if name in _SPECS else hint
    return Annotated[kind, tyro.conf.arg(aliases=[ALIASES[name]])] if name in ALIASES else kind


@functools.cache
def _docstrings() -> dict[str, dict[str, str]]:
    """Class -> field -> the docstring under it in ``config.py``, without the marks of its markup."""
    found: dict[str, dict[str, str]] = {}
    for node in ast.parse(inspect.getsource(config)).body:
        if not isinstance(node, ast.ClassDef):
            continue
        fields = found.setdefault(node.name, {})
        for field, text in itertools.pairwise(node.body):
            match field, text:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(words))):
                    fields[name] = " ".join(words.replace("``", "").split())
    return found


@functools.cache
def flags(command: type) -> tuple[str, ...]:
    """Every flag that ``command`` takes, aliases and global flags included."""
    found: list[str] = []
    for name, hint in get_type_hints(command, include_extras=True).items():
        base = getattr(hint, "__origin__", hint) if hasattr(hint, "__metadata__") else hint
        metadata = getattr(hint, "__metadata__", ())
        if any("ositional" in str(m) for m in metadata):
            continue
        if dataclasses.is_dataclass(base):
            found += [*_setting_flags(base), *OFF] if base is PaintConfig else _setting_flags(base, f"{name}.")
            continue
        found.append("--" + name.replace("_", "-"))
        found += [alias for m in metadata for alias in getattr(m, "aliases", None) or ()]
        if base is bool:
            found.append("--no-" + name.replace("_", "-"))
    return (*found, *GLOBAL_FLAGS, "-h", "--help")


def _setting_flags(cls: Any, prefix: str = "") -> list[str]:
    found: list[str] = []
    for name, hint in get_type_hints(cls).items():
        if dataclasses.is_dataclass(hint):
            found += _setting_flags(hint, f"{name}.")
        else:
            key = (prefix + name).replace("_", "-")
            found.append("--" + key)
            if hint is bool:
                found.append(f"--{prefix}no-{name.replace('_', '-')}")
            if prefix + name in ALIASES:
                found.append(ALIASES[prefix + name])
    return found


def _check_flags(arguments: Sequence[str], known: tuple[str, ...], program: str) -> None:
    """Refuse a misspelt flag before anything else, naming the nearest one."""
    for token in arguments:
        if token == "--":
            return
        flag = token.partition("=")[0]
        if not re.match(r"--?[A-Za-z]", flag) or flag.replace("_", "-") in known:
            continue
        near = nearest(flag, known)
        hint = f"did you mean {near}?" if near else f"'{program} --help' lists them"
        raise UsageError("usage.unknown_flag", f"unknown flag {flag}", hint)


def gather(arguments: Sequence[str], flag: str, spellings: Sequence[str] = ()) -> list[str]:
    """``arguments`` with every ``flag V`` joined into one ``flag V V ...`` behind the rest: it may be repeated."""
    end = list(arguments).index("--") if "--" in arguments else len(arguments)
    rest: list[str] = []
    values: list[str] = []
    tokens = iter(arguments[:end])
    for token in tokens:
        name, equals, value = token.partition("=")
        if name not in (flag, *spellings):
            rest.append(token)
        elif equals:
            values.append(value)
        else:
            values += [v for v in [next(tokens, None)] if v is not None]
    return [*rest, *([flag, *values] if values else []), *arguments[end:]]


def peek(arguments: Sequence[str], flag: str) -> str | None:
    """The last value of ``flag`` in ``arguments`` before parsing; None where it is absent."""
    found = None
    for index, token in enumerate(arguments):
        name, equals, value = token.partition("=")
        if token == "--":
            break
        if name == flag:
            found = value if equals else (arguments[index + 1] if index + 1 < len(arguments) else None)
    return found


def parse(command: type[T], arguments: Sequence[str], program: str, about: str, default: T | None = None) -> T:
    """``arguments`` as an instance of ``command``; prints help and exits with 0 where it is asked for.

    Raises:
        UsageError: an unknown flag, a value that cannot be read, an argument too many.
    """
    _check_flags(arguments, flags(command), program)
    end = list(arguments).index("--") if "--" in arguments else len(arguments)
    arguments = [*(OFF.get(token, token) for token in arguments[:end]), *arguments[end:]]
    captured = io.StringIO()
    try:
        with contextlib.redirect_stderr(captured):
            parsed: Any
            parsed, unknown = tyro.cli(
                command, args=arguments, prog=program, description=about, default=default,
                return_unknown_args=True, registry=_registry(),
                config=(tyro.conf.HelptextFromCommentsOff,),
            )  # fmt: skip
    except SystemExit as stop:
        if not stop.code:
            raise
        raise _value_error(_one_line(captured.getvalue()), f"'{program} --help' shows the forms") from None
    sys.stderr.write(captured.getvalue())
    if unknown:
        raise UsageError(
            "usage.extra_argument", f"unexpected argument '{unknown[0]}'", "put quotes around a prompt of several words"
        )
    return parsed


def _one_line(box: str) -> str:
    """The words inside the box that tyro draws, without colours and rules."""
    text = re.sub(r"\x1b\[[0-9;]*m", "", box)
    return " ".join(re.sub(r"[│|╭╮╰╯─┌┐└┘]+", " ", text).split())


def _value_error(text: str, remedy: str) -> UsageError:
    """tyro's complaint in our form: the flag and the value it was given, then what it may be."""
    if found := re.search(r"invalid choice '(.*?)' for argument '([^'/]+).*?\((.*?)\)", text):
        value, flag, choices = found.groups()
        known = [choice.strip("' ") for choice in choices.split(",") if choice.strip("' ")]
        near = nearest(value, known)
        hint = f"did you mean '{near}'?" if near else f"choose one of {', '.join(known)}"
        return UsageError("usage.choice", f"{flag} is '{value}'", hint)
    if found := re.search(r"[Mm]issing value for argument '([^'/]+).*?Expected (\d+)", text):
        flag, count = found.groups()
        return UsageError("usage.no_value", f"{flag} has too few values", f"it takes {count}")
    if found := re.search(r"parsing ([^/: ]+).*?(?:literal for (int)|string to (float)).*?: '(.*?)'", text):
        flag, whole, _, value = found.groups()
        kind = "a whole number" if whole else "a number"
        return UsageError("usage.not_a_number", f"{flag} is '{value}'", f"it must be {kind}")
    return UsageError("usage.invalid", text[:1].lower() + text[1:], remedy)


def check_range(flag: str, value: float, low: float, high: float) -> None:
    """Refuse ``value`` outside [low, high].

    Raises:
        UsageError: it is; the flag, the value and the range are named.
    """
    if not low <= value <= high:
        raise UsageError("usage.value", f"{flag} is {value:g}", f"it must be from {low:g} to {high:g}")
