"""The Stable Diffusion adapter on small random weights of the real diffusers and transformers classes."""

from __future__ import annotations

import json
import logging
import shutil
from pathlib import Path

import pytest
import torch
from tests.guidance.contract import check_gradient, check_prior, make_channels
from tests.guidance.tiny import save_tiny
from torch.nn import functional

from paintit.errors import PriorError
from paintit.guidance.ddpm import to_epsilon
from paintit.guidance.depth import relative_disparity
from paintit.guidance.loading import Loading
from paintit.guidance.sds import sds_gradient
from paintit.guidance.stable_diffusion import StableDiffusionPrior

pytest.importorskip("diffusers")
SCALING = 0.3


@pytest.fixture(scope="session")
def checkpoints(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("tiny")
    return {kind: save_tiny(folder / kind, kind, SCALING) for kind in ("epsilon", "v_prediction", "sample")}


@pytest.fixture(params=["epsilon", "v_prediction", "sample"])
def prior(request: pytest.FixtureRequest, checkpoints: dict[str, Path]) -> StableDiffusionPrior:
    return StableDiffusionPrior.load(checkpoints[request.param])


@pytest.fixture
def broken(checkpoints: dict[str, Path], tmp_path: Path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(checkpoints["epsilon"], tmp_path / "copy"))


def test_contract(prior: StableDiffusionPrior) -> None:
    check_prior(prior)


def test_spec_comes_from_the_checkpoint(prior: StableDiffusionPrior, checkpoints: dict[str, Path]) -> None:
    kind = prior.spec.prediction_type
    assert prior.spec.id == str(checkpoints[kind])
    assert prior.spec.resolution == 32, "16 latents a side, times 2 for the autoencoder's one downsampling"
    assert len(prior.spec.revision) == 64
    assert prior.reads == ("shaded",)
    assert prior.encode_image(make_channels(("shaded",), 3, 20)).shape == (3, 4, 16, 16)


def test_noise_is_added_as_the_scheduler_does(prior: StableDiffusionPrior, checkpoints: dict[str, Path]) -> None:
    from diffusers import DDPMScheduler

    scheduler = DDPMScheduler.from_pretrained(checkpoints["epsilon"] / "scheduler")
    x, noise = torch.randn(2, 2, 4, 8, 8, generator=torch.Generator().manual_seed(0)).unbind()
    for t, step in ((0.001, 1), (0.02, 20), (0.5, 500), (0.98, 980), (1.0, 999)):
        expected = scheduler.add_noise(x, noise, torch.tensor([step, step]))
        torch.testing.assert_close(prior.add_noise(x, noise, t), expected)
        assert prior.weight(t) == pytest.approx(1 - scheduler.alphas_cumprod[step].item())


def test_velocity_is_converted_as_the_scheduler_defines_it(checkpoints: dict[str, Path]) -> None:
    from diffusers import DDPMScheduler

    prior = StableDiffusionPrior.load(checkpoints["v_prediction"])
    scheduler = DDPMScheduler.from_pretrained(checkpoints["v_prediction"] / "scheduler")
    x, noise = torch.randn(2, 2, 4, 8, 8, generator=torch.Generator().manual_seed(0)).unbind()
    for t in (0.02, 0.5, 0.98):
        steps = torch.full((2,), prior.timestep(t))
        velocity, x_t = scheduler.get_velocity(x, noise, steps), scheduler.add_noise(x, noise, steps)
        levels = prior.alpha_sigma(t)
        torch.testing.assert_close(to_epsilon(velocity, x_t, *levels, "v_prediction"), noise, atol=1e-5, rtol=1e-5)
        torch.testing.assert_close(to_epsilon(x, x_t, *levels, "sample"), noise, atol=1e-4, rtol=1e-4)
        assert torch.equal(to_epsilon(noise, x_t, *levels, "epsilon"), noise)


def test_prediction_is_the_networks_own(prior: StableDiffusionPrior) -> None:
    x_t = torch.randn(2, 4, 16, 16, generator=torch.Generator().manual_seed(0))
    text = prior.encode_text(["a cow", "a pig"])
    with torch.no_grad():
        native = prior.unet(x_t, 400, encoder_hidden_states=text).sample
    got = prior.predict_noise(x_t, 0.4, text)
    alpha, sigma = prior.alpha_sigma(0.4)
    match prior.spec.prediction_type:
        case "epsilon":
            torch.testing.assert_close(got, native)
        case "v_prediction":  # x = alpha x_t - sigma v and x_t = alpha x + sigma epsilon
            torch.testing.assert_close(alpha * (alpha * x_t - sigma * native) + sigma * got, x_t)
        case _:
            torch.testing.assert_close(alpha * native + sigma * got, x_t)


def test_chunks_change_nothing(prior: StableDiffusionPrior) -> None:
    x_t = torch.randn(5, 4, 16, 16, generator=torch.Generator().manual_seed(0))
    text = prior.encode_text(["a", "b", "c", "d", "e"])
    whole = prior.predict_noise(x_t, 0.4, text)
    prior.chunk = 2
    sizes: list[int] = []
    hook = prior.unet.register_forward_pre_hook(lambda _, args: sizes.append(len(args[0])))
    torch.testing.assert_close(prior.predict_noise(x_t, 0.4, text), whole, atol=1e-5, rtol=1e-4)
    hook.remove()
    assert sizes == [2, 2, 1]


@pytest.fixture(scope="session")
def depth_prior(tmp_path_factory: pytest.TempPathFactory) -> StableDiffusionPrior:
    return StableDiffusionPrior.load(save_tiny(tmp_path_factory.mktemp("tiny") / "depth", depth=True))


def test_a_network_with_one_channel_more_sees_depth(depth_prior: StableDiffusionPrior) -> None:
    check_prior(depth_prior)
    assert depth_prior.sees == ("depth", "mask")
    x_t = torch.randn(2, 4, 16, 16, generator=torch.Generator().manual_seed(0))
    text = depth_prior.encode_text(["a cow", "a pig"])
    channels = make_channels(("depth", "mask"), 2, 32)
    shown = depth_prior.encode_geometry(channels)
    assert shown is not None
    assert shown.shape == (2, 1, 16, 16)
    with torch.no_grad():
        native = depth_prior.unet(torch.cat([x_t, shown], 1), 400, encoder_hidden_states=text).sample
    torch.testing.assert_close(depth_prior.predict_noise(x_t, 0.4, text, shown), native)
    other = depth_prior.encode_geometry(channels | {"depth": channels["depth"].flip(1)})
    assert not torch.equal(depth_prior.predict_noise(x_t, 0.4, text, other), native)
    with pytest.raises(ValueError, match="sees"):
        depth_prior.predict_noise(x_t, 0.4, text)


def test_depth_is_told_as_the_pipeline_tells_it(depth_prior: StableDiffusionPrior) -> None:
    """Nearest 1, behind it all -1, between them inverse depth; the pipeline's own preparation changes nothing."""
    from diffusers import StableDiffusionDepth2ImgPipeline

    depth = torch.tensor([2.0, 8 / 3, 4.0, 0.0]).repeat_interleave(8)[None, None, :, None].expand(1, 32, 32, 1)
    shown = relative_disparity(depth, (depth > 0).float(), 32)
    torch.testing.assert_close(shown[0, 0, 5, ::8], torch.tensor([1.0, 0.5, 0.0, -1.0]))
    # Called without an instance, whose other parts would be a depth estimator: it needs the autoencoder's factor alone.
    pipeline = type("Parts", (), {"vae_scale_factor": 1})()
    again = StableDiffusionDepth2ImgPipeline.prepare_depth_map(
        pipeline, [torch.zeros(3, 32, 32)], shown[:, 0], 1, False, torch.float32, torch.device("cpu")
    )
    torch.testing.assert_close(again, shown, atol=1e-5, rtol=0)
    even = relative_disparity(torch.full((1, 8, 8, 1), 3.0), torch.ones(1, 8, 8, 1), 4)
    assert torch.equal(even, torch.ones(1, 1, 4, 4))


def test_decoding_is_the_autoencoders_own(prior: StableDiffusionPrior) -> None:
    x = 0.1 * torch.randn(2, 4, 16, 16, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        image = prior.pipe.vae.decode(x / SCALING).sample
    shaded = prior.decode_image(x)["shaded"]
    assert shaded.shape == (2, 32, 32, 3)
    torch.testing.assert_close(shaded, (image.permute(0, 2, 3, 1) / 2 + 0.5).clamp(0, 1), atol=1e-5, rtol=1e-4)


@pytest.mark.filterwarnings("ignore")
def test_text_and_latents_are_those_of_the_pipeline(checkpoints: dict[str, Path]) -> None:
    from diffusers import StableDiffusionPipeline
    from diffusers.image_processor import VaeImageProcessor

    prior = StableDiffusionPrior.load(checkpoints["epsilon"])
    pipeline = StableDiffusionPipeline(
        prior.pipe.vae,
        prior.pipe.text_encoder,
        prior.pipe.tokenizer,
        prior.unet,
        None,
        None,
        None,
        requires_safety_checker=False,
    )
    words = ["a red cow", "blue"]
    with torch.no_grad():
        wanted, negative = pipeline.encode_prompt(words, "cpu", 1, True, ["", ""])
    torch.testing.assert_close(prior.encode_text(words), wanted)
    torch.testing.assert_close(prior.encode_text(["", ""]), negative)

    image = torch.rand(2, 32, 32, 3, generator=torch.Generator().manual_seed(0))
    signed = VaeImageProcessor().preprocess(image.permute(0, 3, 1, 2))
    latents = prior.pipe.vae.config.scaling_factor * prior.pipe.vae.encode(signed).latent_dist.mode()
    assert prior.pipe.vae.config.scaling_factor == SCALING
    torch.testing.assert_close(prior.encode_image({"shaded": image}), latents)


@pytest.mark.parametrize("size", [32, 20, 48])
def test_gradient_through_the_autoencoder_matches_finite_differences(checkpoints: dict[str, Path], size: int) -> None:
    check_gradient(StableDiffusionPrior.load(checkpoints["epsilon"], Loading(dtype="float64")), size)


def test_each_text_is_encoded_once(prior: StableDiffusionPrior) -> None:
    calls: list[int] = []
    prior.pipe.text_encoder.register_forward_hook(lambda *_: calls.append(1))
    first = prior.encode_text(["a", "b", "a"])
    assert torch.equal(first[0], first[2])
    assert torch.equal(prior.encode_text(["b", "a"]), first[[1, 0]])
    assert len(calls) == 2


def test_a_prompt_that_is_cut_is_reported(prior: StableDiffusionPrior, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        assert prior.encode_text(["abc " * 20]).shape[1] == 24
    assert "takes 62 tokens" in caplog.text
    assert "reads 24" in caplog.text


def test_score_distillation_runs_end_to_end(prior: StableDiffusionPrior) -> None:
    image = make_channels(("shaded",), 2, 24)["shaded"].requires_grad_()
    latents = prior.encode_image({"shaded": image})
    text, uncond = prior.encode_text(["a", "b"]), prior.encode_text(["bad"])
    noise = torch.randn(1, *latents.shape[1:], generator=torch.Generator().manual_seed(0))
    gradient, record = sds_gradient(prior, latents, text, uncond, 0.5, noise, 101.0)
    latents.backward(gradient)
    assert record.gradient_norm > 0
    assert record.nonfinite == 0
    assert image.grad is not None
    assert image.grad.isfinite().all()
    assert all(p.grad is None for m in (prior.unet, prior.pipe.vae, prior.pipe.text_encoder) for p in m.parameters())


@pytest.mark.parametrize("dtype", ["bfloat16", "float16"])
def test_low_precision_is_near(checkpoints: dict[str, Path], dtype: str) -> None:
    exact = StableDiffusionPrior.load(checkpoints["epsilon"])
    coarse = StableDiffusionPrior.load(checkpoints["epsilon"], Loading(dtype=dtype))
    channels = make_channels(("shaded",), 1, 32)
    assert coarse.pipe.vae.dtype == (torch.float32 if dtype == "float16" else torch.bfloat16)
    x = exact.encode_image(channels)
    assert coarse.encode_image(channels).dtype == torch.float32
    assert functional.mse_loss(coarse.encode_image(channels), x) < 1e-3 * x.square().mean()
    a, b = (p.predict_noise(x, 0.5, p.encode_text(["a cow"])) for p in (exact, coarse))
    assert b.dtype == torch.float32
    assert not torch.equal(a, b)
    assert functional.mse_loss(a, b) < 1e-3 * a.square().mean()


def refused(source: Path | str, **options: str) -> PriorError:
    with pytest.raises(PriorError) as caught:
        StableDiffusionPrior.load(source, Loading(**options))
    assert caught.value.hint
    assert "\n" not in caught.value.message
    return caught.value


def test_fp16_files_are_found(broken: Path) -> None:
    for path in list(broken.rglob("*.safetensors")):
        path.rename(path.with_suffix(".fp16.safetensors"))
    assert StableDiffusionPrior.load(broken).spec.resolution == 32
    (broken / "vae/diffusion_pytorch_model.fp16.safetensors").rename(broken / "vae/diffusion_pytorch_model.safetensors")
    assert refused(broken).code == "prior.weights"


def test_pickle_is_refused(broken: Path) -> None:
    (broken / "unet/diffusion_pytorch_model.safetensors").rename(broken / "unet/diffusion_pytorch_model.bin")
    error = refused(broken)
    assert error.code == "prior.pickle"
    assert "unet" in error.message


def test_missing_weights(broken: Path) -> None:
    (broken / "vae/diffusion_pytorch_model.safetensors").unlink()
    error = refused(broken)
    assert error.code == "prior.weights"
    assert "vae" in error.message


def test_truncated_weights(broken: Path) -> None:
    weights = broken / "unet/diffusion_pytorch_model.safetensors"
    weights.write_bytes(weights.read_bytes()[:5000])
    assert refused(broken).code == "prior.load"


@pytest.mark.parametrize("part", ["tokenizer", "scheduler"])
def test_missing_part_without_weights(broken: Path, part: str) -> None:
    shutil.rmtree(broken / part)
    error = refused(broken)
    assert error.code == "prior.weights"
    assert part in error.message


def test_folder_of_something_else(broken: Path, tmp_path: Path) -> None:
    index = broken / "model_index.json"
    index.write_text(json.dumps({"_class_name": "StableDiffusionXLPipeline"}))
    error = refused(broken)
    assert error.code == "prior.kind"
    assert "StableDiffusionXLPipeline" in error.message
    index.write_text("not json")
    assert refused(broken).code == "prior.folder"
    assert refused(tmp_path).code == "prior.folder"


def test_inpainting_network_is_refused(broken: Path) -> None:
    from diffusers import UNet2DConditionModel

    config = UNet2DConditionModel.load_config(broken / "unet") | {"in_channels": 9}
    UNet2DConditionModel.from_config(config).save_pretrained(broken / "unet")
    error = refused(broken)
    assert error.code == "prior.kind"
    assert "9 channels" in error.message


def test_unknown_precision(checkpoints: dict[str, Path]) -> None:
    assert "int4" in refused(checkpoints["epsilon"], dtype="int4").message


def test_without_the_extra(checkpoints: dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "diffusers", None)
    error = refused(checkpoints["epsilon"])
    assert error.code == "prior.extra"
    assert error.hint == "pip install 'paintit[diffusers]'"
