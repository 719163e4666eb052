"""Reference pictures through IP-Adapters in the published layout, against the families' own pipelines."""

from __future__ import annotations

import io
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from PIL import Image
from safetensors.torch import load_file, save_file
from tests.cli.conftest import CUBE, TINY
from tests.guidance.contract import check_prior, make_channels
from tests.guidance.fake_hub import COMMIT, FakeHub
from tests.guidance.pipeline_step import guided_noise, pipeline_steps
from tests.guidance.tiny import save_tiny, save_tiny_controlnet, save_tiny_sdxl
from tests.guidance.tiny_additions import save_ip_adapter, save_lora, save_picture
from torch import Tensor

from paintit.cli.main import main
from paintit.config import POCKET
from paintit.control import Control
from paintit.errors import PriorError
from paintit.guidance import hub as hub_module
from paintit.guidance.additions import read_picture
from paintit.guidance.ddpm import DdpmPrior
from paintit.guidance.economy import Economy
from paintit.guidance.families import FAMILIES
from paintit.guidance.known import known_prior
from paintit.guidance.load import load_prior
from paintit.guidance.loading import Loading
from paintit.guidance.prompt import Prompts
from paintit.settings import merge

pytest.importorskip("diffusers")
SAVED: dict[str, Callable[[Path], Path]] = {"sd": save_tiny, "sdxl": save_tiny_sdxl}
KINDS = [("sd", ""), ("sd", "-plus"), ("sdxl", ""), ("sdxl", "-plus")]
#: Rows of the picture: four, or as many as a plus adapter has latents.
ROWS = {"": 4, "-plus": 3}
PROMPTS = ["a red cow", "blue"]


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Folder of ``sd`` or ``sdxl``, or of an adapter, ``sd-ip`` or ``sd-ip-plus``; saved when first asked for."""
    root = tmp_path_factory.mktemp("reference")

    def saved(name: str) -> Path:
        family, adapter, plus = (*name.split("-"), "", "")[:3]
        if not (root / name).is_dir() and adapter:
            save_ip_adapter(root / name, load_prior(str(saved(family))).unet, plus=bool(plus))  # type: ignore
        elif not (root / name).is_dir():
            SAVED[family](root / name)
        return root / name

    return saved


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    return save_picture(tmp_path / "oak.png")


@pytest.fixture(scope="session")
def seeing(folder: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, str], DdpmPrior]:
    """A prior that sees the picture at scale 0.6, its negative prompt ``ugly``; loaded once."""
    loaded: dict[str, DdpmPrior] = {}
    picture = save_picture(tmp_path_factory.mktemp("picture") / "oak.png")

    def prior(name: str, kind: str) -> DdpmPrior:
        if name + kind not in loaded:
            adapter = folder(f"{name}-ip{kind}")
            loaded[name + kind] = load(folder(name), f"{picture}:0.6", adapter, negative="ugly")
        return loaded[name + kind]

    return prior


def load(checkpoint: Path, picture: Path | str = "", adapter: Path | str = "", **options: Any) -> DdpmPrior:
    prior = load_prior(str(checkpoint), Loading(reference=str(picture), adapter=str(adapter), **options))
    assert isinstance(prior, DdpmPrior)
    return prior


def with_adapter(folder: Callable[[str], Path], name: str, kind: str, scale: float) -> Any:
    """The family's own pipeline with the adapter, loaded by diffusers alone."""
    pipeline = load(folder(name)).pipe
    adapter = str(folder(f"{name}-ip{kind}"))
    pipeline.load_ip_adapter(adapter, "", "ip-adapter.safetensors", local_files_only=True)
    pipeline.set_ip_adapter_scale(scale)
    return pipeline


@pytest.mark.parametrize(("name", "kind"), KINDS)
def test_contract(name: str, kind: str, folder: Callable[[str], Path], seeing: Callable[[str, str], DdpmPrior]) -> None:
    prior = seeing(name, kind)
    check_prior(prior)
    rows = load(folder(name)).encode_text(["a"]).shape[1]
    assert prior.encode_text(["a"]).shape[1] == rows + ROWS[kind]
    assert prior.pipe.image_encoder is None
    digest = re.fullmatch(r"reference 0.6: oak.png \(\w{64}\)", prior.spec.added[0])
    assert digest
    assert re.fullmatch(rf"IP-Adapter 1: {name}-ip{kind} \(\w{{64}}\)", prior.spec.added[1])


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("name", "kind"), KINDS)
def test_guided_prediction_is_the_pipelines_own(
    name: str, kind: str, folder: Callable[[str], Path], picture: Path, seeing: Callable[[str, str], DdpmPrior]
) -> None:
    prior, pipeline = seeing(name, kind), with_adapter(folder, name, kind, 0.6)
    latents = torch.randn(2, 4, 16, 16, generator=torch.Generator().manual_seed(0))
    steps = pipeline_steps(
        pipeline,
        lambda: pipeline(PROMPTS, negative_prompt=["ugly"] * 2, num_inference_steps=2, guidance_scale=7.5,
                         latents=latents, output_type="latent", ip_adapter_image=Image.open(picture)),
    )  # fmt: skip
    text, uncond = prior.encode_text(PROMPTS), prior.encode_text(["ugly"])
    assert len(steps) == 2
    for step in steps:
        ours = guided_noise(prior, step.x_t, step.timestep / 1000, text, uncond, 7.5)
        torch.testing.assert_close(ours, step.guided, atol=1e-4, rtol=1e-4)


def rows_of(prior: DdpmPrior, text: str) -> Tensor:
    assert prior.reference
    return prior.reference.split(prior.encode_text([text]))[1]


def test_which_texts_see_the_picture(folder: Callable[[str], Path], picture: Path) -> None:
    prior = load(folder("sd"), picture, folder("sd-ip"), negative="ugly", source="blurry, grey")
    shown, hidden = rows_of(prior, "a cow"), rows_of(prior, "")
    assert not torch.allclose(shown, hidden, atol=0.1)
    for text, rows in {"a pig": shown, "ugly cow": shown, "blurry, grey": shown, "ugly": hidden,
                       "a cow, blurry, grey": hidden}.items():  # fmt: skip
        assert torch.equal(rows_of(prior, text), rows), text
    config = merge(POCKET, {"prompt.negative": "ugly", "prompt.source": "blurry, grey", "guidance.loss": "bridge"})
    loading, prompts = Loading.of(config), Prompts.of("a cow", config, [])
    assert (loading.negative, loading.source) == ("ugly", "blurry, grey")
    assert prompts.with_source("a cow") == "a cow, blurry, grey"
    other = load(folder("sd"), save_picture(picture.with_name("pine.jpg"), 1), folder("sd-ip"))
    assert torch.equal(rows_of(other, ""), hidden)
    assert not torch.equal(rows_of(other, "a cow"), shown)


@pytest.mark.parametrize(("name", "kind"), KINDS)
def test_scale_0_is_none(
    name: str, kind: str, folder: Callable[[str], Path], picture: Path, seeing: Callable[[str, str], DdpmPrior]
) -> None:
    plain, none = load(folder(name)), load(folder(name), f"{picture}:0", folder(f"{name}-ip{kind}"))
    x_t = torch.randn(2, 4, 16, 16, generator=torch.Generator().manual_seed(0))
    wanted = plain.predict_noise(x_t, 0.4, plain.encode_text(PROMPTS))
    torch.testing.assert_close(none.predict_noise(x_t, 0.4, none.encode_text(PROMPTS)), wanted, atol=1e-6, rtol=0)
    prior = seeing(name, kind)
    assert (prior.predict_noise(x_t, 0.4, prior.encode_text(PROMPTS)) - wanted).abs().max() > 0.01


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", SAVED)
def test_with_a_lora_and_a_controlnet_it_is_still_the_pipelines_own(
    name: str, folder: Callable[[str], Path], picture: Path, tmp_path: Path
) -> None:
    """And in chunks, and with the network's weights on the host."""
    import diffusers
    from diffusers.schedulers.scheduling_ddim import DDIMScheduler

    control = Control("depth", 0.8, str(save_tiny_controlnet(tmp_path / "net", folder(name))))
    lora = save_lora(tmp_path / "lora", load(folder(name)).pipe)
    options: dict[str, Any] = {"lora": (f"{lora}:0.7",), "control": (control,), "negative": "ugly"}
    prior, saving = (
        load(folder(name), f"{picture}:0.6", folder(f"{name}-ip"), economy=economy, **options)
        for economy in (Economy(), Economy(chunk=3, offload=True))
    )
    assert [text.split(" ")[0] for text in prior.spec.added] == ["LoRA", "reference", "IP-Adapter", "depth"]
    geometry = prior.encode_geometry(make_channels(prior.sees, 2, 32, seed=3))
    assert prior.controls
    assert geometry is not None

    parts = load(folder(name)).pipe.components
    scheduler = DDIMScheduler.from_config(parts["scheduler"].config, clip_sample=False)
    parts |= {"controlnet": prior.controls.nets[0], "scheduler": scheduler}
    kind = "StableDiffusionControlNetPipeline" if name == "sd" else "StableDiffusionXLControlNetPipeline"
    pipeline = getattr(diffusers, kind)(**parts, **({"requires_safety_checker": False} if name == "sd" else {}))
    pipeline.load_lora_weights(str(lora.parent), weight_name=lora.name, adapter_name="other")
    pipeline.set_adapters(["other"], [0.7])
    pipeline.load_ip_adapter(str(folder(f"{name}-ip")), "", "ip-adapter.safetensors", local_files_only=True)
    pipeline.set_ip_adapter_scale(0.6)
    x = torch.randn(2, 4, 16, 16, generator=torch.Generator().manual_seed(0))
    steps = pipeline_steps(
        pipeline,
        lambda: pipeline(PROMPTS, image=geometry, controlnet_conditioning_scale=0.8, negative_prompt=["ugly"] * 2,
                         num_inference_steps=2, guidance_scale=7.5, latents=x, output_type="latent",
                         ip_adapter_image=Image.open(picture)),
    )  # fmt: skip
    for step in steps:
        for ours in (prior, saving):
            text, uncond = ours.encode_text(PROMPTS), ours.encode_text(["ugly"])
            got = guided_noise(ours, step.x_t, step.timestep / 1000, text, uncond, 7.5, geometry)
            torch.testing.assert_close(got, step.guided, atol=1e-4, rtol=1e-4)


def test_what_it_adds_to_the_network_is_weighed(
    folder: Callable[[str], Path], picture: Path, seeing: Callable[[str, str], DdpmPrior]
) -> None:
    sizes = [
        sum(weight.nbytes for weight in prior.unet.parameters()) for prior in (load(folder("sd")), seeing("sd", ""))
    ]
    loading = Loading(reference=str(picture), adapter=str(folder("sd-ip")))
    found = hub_module.open_checkpoint(folder("sd"), FAMILIES["stable-diffusion"])
    plain, heavier = (type(seeing("sd", "")).footprint(found, which) for which in (Loading(), loading))
    assert heavier.network - plain.network == sizes[1] - sizes[0]
    assert plain.network == sizes[0]


def test_pictures_are_shown_upright_and_on_white(tmp_path: Path) -> None:
    red, clear = (255, 0, 0, 255), (0, 0, 0, 0)
    image = Image.new("RGBA", (3, 2), clear)
    image.putpixel((0, 0), red)
    image.save(tmp_path / "a.png")
    read, digest = read_picture(str(tmp_path / "a.png"), 1)
    assert (read.mode, len(digest)) == ("RGB", 64)
    assert [read.getpixel(at) for at in ((0, 0), (1, 0))] == [(255, 0, 0), (255, 255, 255)]
    turned = Image.Exif()
    turned[0x0112] = 6  # to be turned by 90 degrees
    image.save(tmp_path / "b.png", exif=turned)
    read, _ = read_picture(str(tmp_path / "b.png"), 1)
    assert read.size == (2, 3)
    assert read.getpixel((1, 0)) == (255, 0, 0)
    Image.new("I;16", (2, 2), 0x8080).save(tmp_path / "grey.png")
    assert read_picture(str(tmp_path / "grey.png"), 1)[0].getpixel((0, 0)) == (128, 128, 128)


def refused(source: Path | str, picture: Path | str, adapter: Path | str = "", **options: Any) -> PriorError:
    with pytest.raises(PriorError) as caught:
        load_prior(str(source), Loading(reference=str(picture), adapter=str(adapter), **options))
    assert caught.value.hint
    assert "\n" not in str(caught.value)
    return caught.value


def test_pictures_that_cannot_be_used(folder: Callable[[str], Path], picture: Path, tmp_path: Path) -> None:
    sd, adapter = folder("sd"), folder("sd-ip")
    assert "no such file" in refused(sd, tmp_path / "none.png", adapter).message
    for name, data in {
        "cut.png": picture.read_bytes()[:300],
        "text.png": b"nothing",
        "empty.jpg": b"",
        "other.bmp": _saved(Image.open(picture), "BMP"),
        "program.eps": _saved(Image.open(picture), "EPS"),
    }.items():
        (tmp_path / name).write_bytes(data)
        error = refused(sd, tmp_path / name, adapter)
        assert error.code == "prior.picture"
        assert name in error.message
        assert error.hint == "give a PNG, JPEG or WebP picture"
    Image.new("1", (1200, 1000)).save(tmp_path / "large.png")
    error = refused(sd, tmp_path / "large.png", adapter, megapixels=1)
    assert error.code == "prior.picture"
    assert "--limits.image-megapixels 2" in error.hint


def _saved(image: Image.Image, kind: str) -> bytes:
    data = io.BytesIO()
    image.save(data, kind)
    return data.getvalue()


def test_adapters_that_cannot_be_used(folder: Callable[[str], Path], picture: Path, tmp_path: Path) -> None:
    sd, good = folder("sd"), folder("sd-ip")
    unknown = refused(sd, picture)
    assert unknown.code == "prior.adapter"
    assert "--guidance.adapter" in unknown.hint
    other = refused(sd, picture, folder("sdxl-ip"))
    assert other.code == "prior.adapter"
    assert "to 40 numbers" in other.message
    assert "to 16 numbers" in other.message
    copy = Path(shutil.copytree(good, tmp_path / "copy"))
    file = copy / "ip-adapter.safetensors"
    arrays = load_file(file)
    faces = {name.replace("image_proj.proj.", "image_proj.proj.0."): array for name, array in arrays.items()}
    for spoilt, words in ((faces, "recognised faces"), ({"a": torch.ones(1)}, "is no IP-Adapter")):
        save_file(spoilt, file)
        error = refused(sd, picture, file)
        assert error.code == "prior.adapter"
        assert words in error.message
    file.write_bytes(b"short")
    assert refused(sd, picture, copy).code == "prior.load"
    wide = {name: array[:, :7].clone() if name.endswith("image_proj.proj.weight") else array
            for name, array in arrays.items()}  # fmt: skip
    save_file(wide, file)
    assert "reads 7 numbers, and its image encoder gives 20" in refused(sd, picture, copy).message
    encoder = copy / "image_encoder/model.safetensors"
    encoder.write_bytes(encoder.read_bytes()[:2000])
    save_file(arrays, file)
    assert "image encoder" in refused(sd, picture, copy).message
    encoder.unlink()
    missing = refused(sd, picture, copy)
    assert missing.code == "prior.weights"
    assert "image_encoder/config.json" in missing.message
    file.rename(copy / "ip-adapter.bin")
    assert refused(sd, picture, copy).code == "prior.pickle"
    assert "takes no reference picture" in refused("pocket", picture).message
    assert "takes no reference picture" in refused("z-image", picture, allow_download=False).message


def test_known_priors_have_one(
    hub: FakeHub, folder: Callable[[str], Path], picture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """``sd15`` and ``sdxl``; the adapter is fetched with the encoder of its folder, and then found in the cache."""
    sd15, sdxl = known_prior("sd15"), known_prior("sdxl")
    assert sd15
    assert sdxl
    assert sd15.adapter == "h94/IP-Adapter/models/ip-adapter_sd15.safetensors"
    assert sdxl.adapter == "h94/IP-Adapter/sdxl_models/ip-adapter_sdxl.safetensors"
    repository = tmp_path / "IP-Adapter"
    shutil.copytree(folder("sd-ip"), repository / "models")
    (repository / "models/ip-adapter.safetensors").rename(repository / "models/ip-adapter_sd15.safetensors")
    (repository / "models/ip-adapter_sd15.bin").write_bytes(b"x")
    hub.folders["h94/IP-Adapter"] = repository
    hub.folders[sd15.sources[0]] = folder("sd")
    name = sd15.sources[0]
    assert refused(folder("sd"), picture, sd15.adapter).code == "prior.not_cached"
    fetched = load(folder("sd"), picture, sd15.adapter, allow_download=True)
    inside = ("image_encoder/config.json", "image_encoder/model.safetensors", "ip-adapter_sd15.safetensors")
    assert hub.fetched == [f"models/{path}" for path in inside]
    hub.requests.clear()
    again = load(folder("sd"), picture, sd15.adapter)
    assert hub.requests == []
    assert torch.equal(fetched.encode_text(["a"]), again.encode_text(["a"]))
    assert again.spec.added[1] == f"IP-Adapter 1: {sd15.adapter} ({COMMIT})"
    known = load_prior(name, Loading(reference=str(picture), allow_download=True))
    assert known.spec.added[1] == again.spec.added[1]


def test_encoders_of_adapters_called_vit_h(hub: FakeHub, folder: Callable[[str], Path], picture: Path) -> None:
    repository = picture.parent / "IP-Adapter"
    shutil.copytree(folder("sd-ip"), repository / "models")
    place = repository / "sdxl_models"
    shutil.copytree(folder("sdxl-ip-plus"), place)
    (place / "ip-adapter.safetensors").rename(place / "ip-adapter-plus_sdxl_vit-h.safetensors")
    (place / "image_encoder/model.safetensors").write_bytes(b"another")
    hub.folders["h94/IP-Adapter"] = repository
    adapter = "h94/IP-Adapter/sdxl_models/ip-adapter-plus_sdxl_vit-h.safetensors"
    load(folder("sdxl"), picture, adapter, allow_download=True)
    assert [path for path in hub.fetched if "encoder" in path] == [
        "models/image_encoder/config.json", "models/image_encoder/model.safetensors",
    ]  # fmt: skip
    load(folder("sdxl"), picture, place / "ip-adapter-plus_sdxl_vit-h.safetensors")


def test_painting_runs_whole_and_notices_other_files(
    folder: Callable[[str], Path], picture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Same files, same bytes, and nothing of this machine in the record."""
    (tmp_path / "cube.obj").write_text(CUBE)
    style = save_lora(tmp_path / "style", load(folder("sd")).pipe).rename(tmp_path / "style.safetensors")
    command = ["paint", tmp_path / "cube.obj", "a red ball", "--prior", folder("sd"), "--negative", "ugly", *TINY]
    command = [*map(str, command), "--steps", "2", "--guidance.adapter", str(folder("sd-ip"))]
    painted: list[bytes] = []
    for name, lora, seen in (("one", 0.8, 1), ("two", 0.8, 1), ("lora", 0.4, 1), ("seen", 0.8, 0.5)):
        out = tmp_path / f"{name}.glb"
        assert main([*command, "--lora", f"{style}:{lora}", "--reference", f"{picture}:{seen}", "-o", str(out)]) == 0
        painted.append(out.read_bytes())
    assert painted[0] == painted[1]
    assert len(set(painted)) == 3
    run = next(path.parent for path in tmp_path.rglob("run.json") if "one" in str(path.parent))
    record = json.loads((run / "run.json").read_text())
    assert [text.split(" (")[0] for text in record["prior"]["added"]] == [
        "LoRA 0.8: style.safetensors", "reference 1: oak.png", "IP-Adapter 1: sd-ip",
    ]  # fmt: skip
    assert str(tmp_path) not in json.dumps(record)
    data = picture.read_bytes()
    save_picture(picture, 1)
    assert "oak.png" in _resumed(run, capsys)
    picture.write_bytes(data)
    save_lora(tmp_path / "style", load(folder("sd")).pipe, seed=2).rename(style)
    assert "style.safetensors" in _resumed(run, capsys)


def _resumed(run: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """The one line of the error with which the run refuses to go on."""
    capsys.readouterr()
    assert main(["paint", "--resume", str(run)]) == 1
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    return lines[0]
