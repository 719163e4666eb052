"""LoRAs on every family, made by peft and saved by diffusers, against their definition and the families' pipelines.

Those of Stable Diffusion are held to theirs in ``test_reference.py``, together with all else that is added to it.
"""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file, save_file
from tests.guidance.contract import check_prior
from tests.guidance.fake_hub import COMMIT, FakeHub
from tests.guidance.pipeline_step import guided_noise
from tests.guidance.test_flow import as_picture, level
from tests.guidance.tiny import save_tiny, save_tiny_if, save_tiny_sdxl
from tests.guidance.tiny_additions import save_kohya_lora, save_lora
from tests.guidance.tiny_flow import save_tiny_flux2, save_tiny_sd3, save_tiny_z_image
from torch import Tensor

from paintit.config import POCKET
from paintit.errors import PriorError, UsageError
from paintit.guidance.diffusers_prior import DiffusersPrior
from paintit.guidance.flow import FlowPrior
from paintit.guidance.load import load_prior
from paintit.guidance.loading import Loading
from paintit.scaled import scaled
from paintit.settings import merge

pytest.importorskip("diffusers")
pytest.importorskip("peft")
SAVED: dict[str, Callable[[Path], Path]] = {
    "sd": save_tiny,
    "sdxl": save_tiny_sdxl,
    "if": save_tiny_if,
    "sd3": save_tiny_sd3,
    "flux2-klein": save_tiny_flux2,
    "z-image": save_tiny_z_image,
}
PROMPTS = ["a red cow", "blue"]


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Folder of a family's checkpoint; saved when first asked for."""
    root = tmp_path_factory.mktemp("lora")
    return lambda name: root / name if (root / name).is_dir() else SAVED[name](root / name)


@pytest.fixture(scope="session")
def lora(folder: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """File of a LoRA for a family; saved when first asked for."""
    root = tmp_path_factory.mktemp("loras")

    def saved(name: str, seed: int = 1) -> Path:
        place = root / f"{name}-{seed}"
        found = place / "pytorch_lora_weights.safetensors"
        return found if found.is_file() else save_lora(place, load(folder(name)).pipe, seed=seed)

    return saved


def load(source: Path, *loras: str | Path) -> DiffusersPrior:
    prior = load_prior(str(source), Loading(lora=tuple(map(str, loras))))
    assert isinstance(prior, DiffusersPrior)
    return prior


def weights(prior: DiffusersPrior) -> dict[str, Tensor]:
    """Every parameter, as part.name."""
    parts = {name: part for name, part in prior.pipe.components.items() if isinstance(part, torch.nn.Module)}
    return {f"{name}.{key}": value for name, part in parts.items() for key, value in part.named_parameters()}


def changed(plain: DiffusersPrior, other: DiffusersPrior) -> dict[str, Tensor]:
    before, after = weights(plain), weights(other)
    assert list(before) == list(after), "modules are plain again"
    return {name: after[name] - before[name] for name in before if not torch.equal(before[name], after[name])}


def products(file: Path) -> dict[str, Tensor]:
    """(alpha / rank) B A of every pair in a LoRA as diffusers saves them, with rank 2 and alpha 3."""
    arrays = load_file(file)
    names = [name.removesuffix(".lora_A.weight") for name in arrays if name.endswith(".lora_A.weight")]
    return {f"{name}.weight": 1.5 * arrays[f"{name}.lora_B.weight"] @ arrays[f"{name}.lora_A.weight"] for name in names}


@pytest.mark.parametrize("name", SAVED)
def test_weights_are_those_of_the_definition_and_the_contract_holds(
    name: str, folder: Callable[[str], Path], lora: Callable[..., Path]
) -> None:
    plain, prior = load(folder(name)), load(folder(name), f"{lora(name)}:0.7")
    wanted = products(lora(name))
    got = changed(plain, prior)
    assert set(got) == set(wanted)
    parts = {key.split(".")[0] for key in got}
    texts = {
        "sd": {"text_encoder"},
        "sdxl": {"text_encoder", "text_encoder_2"},
        "sd3": {"text_encoder", "text_encoder_2"},
    }
    assert parts == {"unet" if hasattr(plain.pipe, "unet") else "transformer"} | texts.get(name, set())
    for key, product in wanted.items():
        torch.testing.assert_close(got[key], 0.7 * product, atol=1e-5, rtol=1e-4)
    assert not any(parameter.requires_grad for parameter in weights(prior).values())
    (added,) = prior.spec.added
    assert re.fullmatch(r"LoRA 0.7: pytorch_lora_weights.safetensors \(\w{64}\)", added)
    assert plain.spec.added == ()
    check_prior(prior)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["sd3", "flux2-klein", "z-image"])
def test_guided_prediction_of_a_flow_model_is_the_pipelines_own(
    name: str, folder: Callable[[str], Path], lora: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    prior = load(folder(name), f"{lora(name)}:0.7")
    assert isinstance(prior, FlowPrior)
    pipeline = _with_lora(load(folder(name)).pipe, lora(name))
    pipeline.set_progress_bar_config(disable=True)
    steps: list[tuple[Tensor, float, Tensor]] = []
    step = pipeline.scheduler.step

    def listen(velocity: Tensor, time: Tensor, sample: Tensor, **options: Any) -> Any:
        steps.append((as_picture(velocity), time.item() / 1000, as_picture(sample)))
        return step(velocity, time, sample, **options)

    monkeypatch.setattr(pipeline.scheduler, "step", listen)
    words = {} if name == "flux2-klein" else {"negative_prompt": ["bad", "bad"]}
    pipeline(prompt=list(PROMPTS), height=32, width=32, num_inference_steps=3, guidance_scale=4.0, output_type="latent",
             generator=torch.Generator().manual_seed(0), **words)  # fmt: skip
    scale = 5.0 if name == "z-image" else 4.0  # its pipeline counts from the conditional half
    text, uncond = prior.encode_text(PROMPTS), prior.encode_text(["bad" if words else ""])
    for velocity, s, sample in steps:
        ours = guided_noise(prior, sample, level(prior, s), text, uncond, scale)
        torch.testing.assert_close(ours, sample + (1 - s) * velocity, atol=1e-4, rtol=1e-4)


def _with_lora(pipeline: Any, file: Path) -> Any:
    """The pipeline with the LoRA beside its layers, not in their weights."""
    pipeline.load_lora_weights(str(file.parent), weight_name=file.name, adapter_name="other")
    pipeline.set_adapters(["other"], [0.7])
    return pipeline


def test_layout_of_most_published_files(folder: Callable[[str], Path], tmp_path: Path) -> None:
    """Flat names, the text encoder's with a level that it has lost since, and an alpha that is not the rank."""
    plain = load(folder("sd"))
    file = save_kohya_lora(tmp_path / "style.safetensors", plain.pipe, alpha=3.0)
    got = changed(plain, load(folder("sd"), file))
    arrays = load_file(file)
    flat = {f"lora_{name}".replace(".", "_").removesuffix("_weight"): value for name, value in got.items()}
    flat = {name.replace("lora_text_encoder_", "lora_te_text_model_"): value for name, value in flat.items()}
    assert set(flat) == {name.split(".")[0] for name in arrays}
    for name, difference in flat.items():
        product = arrays[f"{name}.lora_up.weight"] @ arrays[f"{name}.lora_down.weight"]
        torch.testing.assert_close(difference, 3 / 2 * product, atol=1e-5, rtol=1e-4)


def test_weight_0_is_none_and_two_add_up(folder: Callable[[str], Path], lora: Callable[..., Path]) -> None:
    plain = load(folder("sd"))
    assert changed(plain, load(folder("sd"), f"{lora('sd')}:0")) == {}
    one, two = products(lora("sd")), products(lora("sd", 2))
    both = load(folder("sd"), lora("sd"), f"{lora('sd', 2)}:-0.5")
    for name, difference in changed(plain, both).items():
        torch.testing.assert_close(difference, one[name] - 0.5 * two[name], atol=1e-5, rtol=1e-4)
    assert [text.split(":")[0] for text in both.spec.added] == ["LoRA 1", "LoRA -0.5"]


@pytest.mark.parametrize(
    ("text", "name", "scale"),
    [
        ("style.safetensors", "style.safetensors", 1),
        ("someone/style:0.8", "someone/style", 0.8),
        ("C:\\styles\\style.safetensors", "C:\\styles\\style.safetensors", 1),
        ("C:/style.safetensors:-2", "C:/style.safetensors", -2),
        ("a:b:1e-1", "a:b", 0.1),
    ],
)
def test_scale_stands_behind_the_last_colon(text: str, name: str, scale: float) -> None:
    assert scaled(text, "guidance.lora") == (name, scale)


@pytest.mark.parametrize("text", ["", ":0.5", " :1", "style:", "style:much", "style:nan", "style:inf"])
def test_no_name_and_no_number_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match="write NAME or NAME:SCALE") as caught:
        merge(POCKET, {"guidance.lora": [text]})
    assert f'guidance.lora is "{text}"' in caught.value.message


def refused(source: Path, lora: str | Path, **options: Any) -> PriorError:
    with pytest.raises(PriorError) as caught:
        load_prior(str(source), Loading(lora=(str(lora),), **options))
    assert caught.value.hint
    assert "\n" not in str(caught.value)
    return caught.value


def test_what_cannot_be_used_is_refused(
    folder: Callable[[str], Path], lora: Callable[..., Path], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    sd = folder("sd")
    arrays = load_file(lora("sd"))
    for missing in (tmp_path / "none.safetensors", "./none", "styles/none.safetensors", "none.safetensors"):
        assert refused(sd, missing).code == "prior.missing"
    assert refused(sd, tmp_path).code == "prior.weights"
    (tmp_path / "a.bin").write_bytes(b"x")
    assert refused(sd, tmp_path / "a.bin").code == "prior.pickle"
    assert refused(sd, tmp_path).code == "prior.pickle"
    (tmp_path / "b.safetensors").write_bytes(lora("sd").read_bytes()[:1000])
    assert refused(sd, tmp_path).code == "prior.load"
    shutil.copy(lora("sd"), tmp_path / "c.safetensors")
    several = refused(sd, tmp_path)
    assert several.code == "prior.several"
    assert "b.safetensors, c.safetensors" in several.message
    network = sd / "unet/diffusion_pytorch_model.safetensors"
    assert "conv_in" in refused(sd, network).message
    assert refused(sd, network).code == "prior.lora"
    nan = {name: torch.full_like(array, torch.nan) for name, array in arrays.items()}
    dora = arrays | {"lora_unet_mid_block_attentions_0_proj_in.dora_scale": torch.ones(16, 1)}
    strange = arrays | {"unet.elsewhere.to_q.lora_A.weight": torch.ones(2, 8)}
    strange |= {"unet.elsewhere.to_q.lora_B.weight": torch.ones(8, 2)}
    for name, spoilt in {"nan": nan, "dora": dora, "strange": strange, "nothing": {}}.items():
        save_file(spoilt, tmp_path / f"{name}.safetensors")
        assert refused(sd, tmp_path / f"{name}.safetensors").code == "prior.lora", name
    for other in ("sdxl", "sd3", "flux2-klein", "z-image"):
        error = refused(sd, lora(other))
        assert error.code == "prior.lora", other
        assert "does not fit" in error.message
    error = refused(folder("sdxl"), lora("sd"))
    assert error.code == "prior.lora"
    assert re.search(r"its mid_block\S+lora_A.paintit is \(2, 16\), not \(2, 40\)", error.message)
    assert "unsuccessful" not in capfd.readouterr().err, "the libraries do not tell it too"
    with pytest.raises(PriorError, match="takes no LoRA"):
        load_prior("pocket", Loading(lora=(str(lora("sd")),)))


def test_without_the_extra(
    folder: Callable[[str], Path], lora: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "peft", None)
    error = refused(folder("sd"), lora("sd"))
    assert error.code == "prior.extra"
    assert "'peft'" in error.message


def test_of_the_hub(
    hub: FakeHub, folder: Callable[[str], Path], lora: Callable[..., Path], caplog: pytest.LogCaptureFixture
) -> None:
    sd = folder("sd")
    hub.folders["someone/style"] = lora("sd").parent
    assert refused(sd, "someone/style:0.5").code == "prior.not_cached"
    assert hub.requests == []
    fetched = load_prior(str(sd), Loading(lora=("someone/style:0.5",), allow_download=True))
    assert "licence: test-licence" in caplog.text
    assert hub.fetched == ["pytorch_lora_weights.safetensors"]
    hub.requests.clear()
    cached = load(sd, "someone/style:0.5")
    named = load(sd, "someone/style/pytorch_lora_weights.safetensors:0.5")
    assert hub.requests == []
    assert fetched.spec.added == cached.spec.added == (f"LoRA 0.5: someone/style ({COMMIT})",)
    assert changed(cached, named) == {}
    assert refused(sd, "someone/style/other.safetensors").code == "prior.not_cached"
    assert refused(sd, "someone/style/other.safetensors", allow_download=True).code == "prior.weights"
    assert refused(sd, "someone/nothing", allow_download=True).code == "prior.withdrawn"
