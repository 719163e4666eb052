"""What is said where a package is missing, broken or too old: one line, with the command that mends it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.cli.conftest import TINY, Ran

from paintit.errors import PriorError
from paintit.guidance.families import FAMILIES
from paintit.guidance.hub import require_extra
from paintit.guidance.load import load_prior, plan_download, prior_class

pytest.importorskip("diffusers")
INSTALL = "pip install 'paintit[diffusers]'"
UPGRADE = "pip install --upgrade 'paintit[diffusers]'"


def missing(monkeypatch: pytest.MonkeyPatch, *modules: str) -> None:
    for module in modules:
        monkeypatch.setitem(sys.modules, module, None)


def refusal(ask: Callable[[], object]) -> PriorError:
    with pytest.raises(PriorError) as caught:
        ask()
    assert caught.value.code == "prior.extra"
    assert "\n" not in str(caught.value)
    return caught.value


def test_nothing_is_missing_here() -> None:
    for family in FAMILIES.values():
        cls = prior_class(family)
        require_extra(family.about, cls.packages, cls.pipeline)


@pytest.mark.parametrize(
    ("module", "ask", "said"),
    [
        ("diffusers", lambda: load_prior("sdxl"), "Stable Diffusion XL needs the package 'diffusers', which is not"),
        ("transformers", lambda: load_prior("a/b"), "a diffusion model needs the package 'transformers', which is not"),
        ("huggingface_hub", lambda: plan_download("sd15"), "downloading a prior needs the package 'huggingface_hub', "),
        ("google.protobuf", lambda: require_extra("X", ["google.protobuf"]), "X needs the package 'google.protobuf', "),
    ],
)
def test_missing(module: str, ask: Callable[[], object], said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    missing(monkeypatch, module)
    error = refusal(ask)
    assert error.message.startswith(said)
    assert error.message.endswith("which is not installed")
    assert error.hint == INSTALL


def test_broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "broken_one.py").write_text("raise ImportError('no name x in y\\nand more')\n")
    (tmp_path / "broken_two.py").write_text("import not_there_at_all\n")
    one, two = (refusal(lambda name=name: require_extra("X", [name])) for name in ("broken_one", "broken_two"))
    assert one.message == "X needs the package 'broken_one', which cannot be imported: no name x in y"
    assert two.message.endswith("'broken_two', which cannot be imported: No module named 'not_there_at_all'")
    assert one.hint == two.hint == UPGRADE


def test_too_old() -> None:
    error = refusal(lambda: require_extra("X", ["diffusers"], "PipelineOfNextYear"))
    assert error.message.startswith("X needs a newer version of diffusers than 0.")
    assert error.message.endswith(", which has no PipelineOfNextYear")
    assert error.hint == UPGRADE


def test_commands_say_so(cube: Path, here: Path, paintit: Callable[..., Ran], monkeypatch: pytest.MonkeyPatch) -> None:
    missing(monkeypatch, "huggingface_hub", "diffusers")
    assert paintit("priors", "list").code == 0
    for command in (["priors", "pull", "sd15"], ["priors", "pull", "sd15", "--dry-run"],
                    ["paint", str(cube), "red", *TINY, "--prior", "sd15"]):  # fmt: skip
        ran = paintit(*command)
        assert (ran.code, ran.out, len(ran.errors)) == (1, "", 1), ran
        assert ran.err.endswith(f"{INSTALL}\n")
    dry = paintit("paint", cube, "red", *TINY, "--prior", "sd15", "--dry-run")
    assert dry.code == 0
    assert f"which is not installed; {INSTALL}" in dry.out
    assert list(here.iterdir()) == []
