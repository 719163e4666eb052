"""Settings: presets, dicts, TOML, and what is refused."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any, get_args

import pytest

from paintit.config import PAPER, POCKET, PRESETS, FocusConfig, PaintConfig, preset, to_dict, with_prior
from paintit.errors import UsageError
from paintit.settings import CHANNELS, dump_toml, from_dict, load_toml, merge, names, nearest, same_settings, validate

UNUSUAL = merge(
    PAPER,
    {
        "views.focus": [{"center": [1, -2.5, 3e-7], "radius": 0.25, "name": 'a "nose"\n\\ é'}],
        "prompt.template": "{prompt}, \t'quoted' \"twice\" \x7f",
        "light.rotation": "random",
        "texture.widths": [8, 16],
        "texture.skip_widths": [0, 4],
        "guidance.reads": ["shaded"],
        "optim.lr": 1e-7,
        "seed": 2**40,
    },
)


@pytest.mark.parametrize("config", [*PRESETS.values(), PaintConfig(), UNUSUAL])
def test_toml_and_dict_give_the_same_back_over_any_base(config: PaintConfig, tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text(dump_toml(config), "utf-8")
    for base in (POCKET, PAPER, UNUSUAL):
        assert load_toml(path, base) == config
        assert from_dict(to_dict(config), base) == config


def test_the_unusual_is_unusual() -> None:
    assert UNUSUAL.views.focus == (FocusConfig((1.0, -2.5, 3e-7), 0.25, 'a "nose"\n\\ é'),)
    assert UNUSUAL.light.rotation is None
    assert PAPER.light.rotation == 0.0


@pytest.mark.parametrize("config", PRESETS.values(), ids=PRESETS)
def test_presets_are_valid(config: PaintConfig) -> None:
    validate(config)


def test_every_field_is_named_once_and_found_by_its_name() -> None:
    assert len(names()) == len(set(names()))
    for name in names():
        value: Any = POCKET
        for part in name.split("."):
            value = getattr(value, part)
        assert not dataclasses.is_dataclass(value)


def test_toml_keeps_what_it_does_not_name(tmp_path: Path) -> None:
    path = tmp_path / "some.toml"
    path.write_text("seed = 7\n[optim]\nsteps = 11\n")
    config = load_toml(path, PAPER)
    assert (config.seed, config.optim.steps, config.optim.lr) == (7, 11, PAPER.optim.lr)
    assert config.texture == PAPER.texture


def test_toml_may_name_its_preset(tmp_path: Path) -> None:
    path = tmp_path / "some.toml"
    path.write_text('preset = "paper"\nseed = 3\n')
    assert load_toml(path) == dataclasses.replace(PAPER, seed=3)
    assert load_toml(path, POCKET) == dataclasses.replace(POCKET, seed=3)


@pytest.mark.parametrize(
    ("key", "value", "code", "message"),
    [
        ("optim.step", 3, "config.unknown_key", "unknown setting 'optim.step'; did you mean 'optim.steps'?"),
        ("steps", 3, "config.unknown_key", "unknown setting 'steps'; did you mean 'optim.steps'?"),
        ("guidence.scale", 3, "config.unknown_key", "unknown setting 'guidence'; did you mean 'guidance'?"),
        ("texture", 3, "config.wrong_type", "'texture' is 3, not a table of settings; write it as [texture]"),
        ("texture.size", 2.5, "config.wrong_type", "'texture.size' is 2.5; it must be a whole number"),
        ("texture.size", True, "config.wrong_type", "'texture.size' is True; it must be a whole number"),
        ("optim.lr", "fast", "config.wrong_type", "'optim.lr' is 'fast'; it must be a number"),
        ("views.fov", False, "config.wrong_type", "'views.fov' is False; it must be a number"),
        ("views.front_first", 1, "config.wrong_type", "'views.front_first' is 1; it must be true or false"),
        ("views.elevation", [1], "config.wrong_type", "'views.elevation' is [1]; it must be a list of 2 values"),
        ("texture.widths", [8, "x"], "config.wrong_type", "'texture.widths[1]' is 'x'; it must be a whole number"),
        ("texture.kind", "pixel", "config.choice", "'texture.kind' is 'pixel'; did you mean 'pixels'?"),
        ("dtype", "int8", "config.choice", "'dtype' is 'int8'; choose one of auto, float32, bfloat16, float16"),
        ("light.rotation", "left", "config.wrong_type", "'light.rotation' is 'left'; it must be a number"),
        (
            "views.focus", [{"radius": 1}], "config.missing_key",
            "'views.focus[0]' has no center; write center = [x, y, z] and radius",
        ),
        (
            "views.focus", [{"centre": [0, 0, 0]}], "config.unknown_key",
            "unknown setting 'views.focus[0].centre'; known here: center, radius, name",
        ),
        ("texture.size", -5, "config.value", "texture.size is -5; it must be from 8 to 8192"),
        ("views.count", 0, "config.value", "views.count is 0; it must be from 1 to 256"),
        ("views.close_up", 1.5, "config.value", "views.close_up is 1.5; it must be from 0 to 1"),
        ("texture.tv_weight", -1, "config.value", "texture.tv_weight is -1.0; it must be at least 0"),
        ("optim.lr", 0, "config.value", "optim.lr is 0.0; it must be greater than 0"),
        ("guidance.scale", float("nan"), "config.value", "guidance.scale is nan; it must be a finite number"),
        (
            "views.elevation", [60, -60], "config.value",
            "views.elevation is [60.0, -60.0]; it must be two numbers, the lower first, from -90 to 90",
        ),
        (
            "guidance.t_end", [0.3, 1.2], "config.value",
            "guidance.t_end is [0.3, 1.2]; it must be two numbers, the lower first, from 0.001 to 1",
        ),
        (
            "texture.size", 100, "config.value",
            "texture.size is 100; 5 levels at 1/2 of it need a multiple of 64, at least 128, for example 128",
        ),
        (
            "texture.size", 64, "config.value",
            "texture.size is 64; 5 levels at 1/2 of it need a multiple of 64, at least 128, for example 128",
        ),
        ("texture.upsample", 0, "config.value", "texture.upsample is 0; it must be a power of two: 1, 2, 4, ..."),
        ("texture.upsample", 3, "config.value", "texture.upsample is 3; it must be a power of two: 1, 2, 4, ..."),
        (
            "texture.skip_widths", [1, 2], "config.value",
            "texture.skip_widths is [1, 2]; it must be 5 counts of 0 or more, one per level",
        ),
        ("prompt.template", "a thing", "config.value", 'prompt.template is "a thing"; it must contain {prompt}'),
        (
            "guidance.reads", ["shadow"], "config.value",
            'guidance.reads is ["shadow"]; choose from shaded, base_color, roughness, metallic',
        ),
    ],
)  # fmt: skip
def test_refused(key: str, value: Any, code: str, message: str) -> None:
    with pytest.raises(UsageError) as caught:
        merge(POCKET, {key: value})
    assert (caught.value.code, str(caught.value)) == (code, message)


def test_a_preset_that_is_not_there() -> None:
    with pytest.raises(UsageError, match="there is no preset 'draft'; choose one of pocket, paper"):
        preset("draft")


def test_the_size_suits_the_levels_without_upsampling() -> None:
    assert merge(POCKET, {"texture.upsample": 1, "texture.size": 96}).texture.size == 96
    with pytest.raises(UsageError, match="5 levels need a multiple of 32, at least 64, for example 96"):
        merge(POCKET, {"texture.upsample": 1, "texture.size": 100})


def test_the_pixels_field_has_no_levels() -> None:
    assert merge(POCKET, {"texture.kind": "pixels", "texture.size": 100}).texture.size == 100


def test_nearest() -> None:
    assert nearest("--stpes", ["--steps", "--step-size"]) == "--steps"
    assert nearest("xyzzy", ["--steps"]) is None


def test_channels_are_those_of_the_prior_contract() -> None:
    from paintit.guidance.prior import ReadChannel

    assert get_args(ReadChannel) == CHANNELS


def test_settings_of_an_older_version_are_the_same_where_the_new_ones_stand_at_their_defaults() -> None:
    now = json.loads(json.dumps(to_dict(preset("pocket"))))
    older = json.loads(json.dumps(now))
    del older["limits"], older["method"], older["optim"]["decay"]
    assert same_settings(older, now)
    assert not same_settings(older, now | {"method": "projection"})
    assert not same_settings(older, now | {"seed": 1})
    assert not same_settings(older | {"gone": 1}, now)


def scales(config: PaintConfig) -> tuple[float | None, float | None, float | None]:
    return config.guidance.scale, config.guidance.scale_end, config.projection.scale


def test_the_scales_of_a_preset_are_those_of_its_prior_alone() -> None:
    assert scales(POCKET) == (3.0, 1.5, 2.0)
    assert scales(PAPER) == (101.0, None, 7.5)
    assert with_prior(POCKET, "pocket") is POCKET
    assert scales(with_prior(POCKET, "klein")) == (None, None, None)
    assert scales(merge(POCKET, {"guidance.prior": "klein"})) == (None, None, None)
    assert scales(merge(POCKET, {"guidance.prior": "pocket", "seed": 3})) == scales(POCKET)
    assert scales(merge(PAPER, {"guidance.prior": "sd15", "guidance.scale": 50})) == (50.0, None, None)
    assert scales(merge(POCKET, {"guidance.scale": "auto", "projection.scale": "auto"})) == (None, 1.5, None)


def test_the_word_auto_is_written_and_read(tmp_path: Path) -> None:
    path = tmp_path / "some.toml"
    config = merge(POCKET, {"guidance.prior": "klein"})
    path.write_text(dump_toml(config), "utf-8")
    assert 'scale = "auto"\nscale_end = "none"' in path.read_text("utf-8")
    assert load_toml(path, PAPER) == config
    path.write_text('[guidance]\nprior = "sd15"\n')
    assert scales(load_toml(path)) == (None, None, None)
    path.write_text('[guidance]\nprior = "sd15"\nscale = 7\n')
    assert scales(load_toml(path)) == (7.0, None, None)
