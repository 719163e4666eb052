"""The SDXL adapter on small random weights of the real classes, held to the diffusers pipeline on the same weights."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import torch
from tests.guidance.contract import check_gradient, check_prior, make_channels
from tests.guidance.pipeline_step import guided_noise, pipeline_steps
from tests.guidance.tiny import save_tiny_sdxl

from paintit.errors import PriorError
from paintit.guidance.load import load_prior
from paintit.guidance.loading import Loading
from paintit.guidance.sds import sds_gradient
from paintit.guidance.sdxl import SDXLPrior

pytest.importorskip("diffusers")


@pytest.fixture(scope="session")
def checkpoints(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("sdxl")
    return {kind: save_tiny_sdxl(folder / kind, kind) for kind in ("epsilon", "v_prediction")}


@pytest.fixture(params=["epsilon", "v_prediction"])
def prior(request: pytest.FixtureRequest, checkpoints: dict[str, Path]) -> SDXLPrior:
    return SDXLPrior.load(checkpoints[request.param])


def pipeline_of(prior: SDXLPrior, folder: Path, kind: str = "StableDiffusionXLPipeline") -> Any:
    """The diffusers pipeline of the same components, with the scheduler that the folder names."""
    import diffusers

    index = json.loads((folder / "model_index.json").read_text())
    return getattr(diffusers, kind)(
        prior.pipe.vae,
        prior.pipe.text_encoder,
        prior.pipe.text_encoder_2,
        prior.pipe.tokenizer,
        prior.pipe.tokenizer_2,
        prior.unet,
        diffusers.EulerDiscreteScheduler.from_pretrained(folder / "scheduler"),
        force_zeros_for_empty_prompt=index["force_zeros_for_empty_prompt"],
        add_watermarker=False,
    )


def test_contract(prior: SDXLPrior) -> None:
    check_prior(prior)


def test_spec_comes_from_the_checkpoint(prior: SDXLPrior) -> None:
    assert prior.spec.family == "sdxl"
    assert prior.spec.resolution == 32, "16 latents a side, times 2 for the autoencoder's one halving"
    assert len(prior.spec.revision) == 64
    assert prior.encode_image(make_channels(("shaded",), 3, 20)).shape == (3, 4, 16, 16)


def test_a_folder_is_recognised(checkpoints: dict[str, Path]) -> None:
    assert isinstance(load_prior(str(checkpoints["epsilon"])), SDXLPrior)


@pytest.mark.parametrize("zeros", [True, False])
def test_text_is_that_of_the_pipeline(tmp_path: Path, zeros: bool) -> None:
    folder = save_tiny_sdxl(tmp_path / "tiny", zeros=zeros)
    prior = SDXLPrior.load(folder)
    with torch.no_grad():
        words, no_words, pooled, no_pooled = pipeline_of(prior, folder).encode_prompt(["a red cow", "blue"])
    for text, hidden, last in (
        (prior.encode_text(["a red cow", "blue"]), words, pooled),
        (prior.encode_text(["", ""]), no_words, no_pooled),
    ):
        torch.testing.assert_close(text[:, :-1], hidden)
        torch.testing.assert_close(text[:, -1, :20], last)
        assert not text[:, -1, 20:].any()
    assert (not no_words.any()) == zeros


def test_guided_prediction_is_the_pipelines(prior: SDXLPrior, checkpoints: dict[str, Path]) -> None:
    """Two steps of the pipeline, at timesteps 501 and 1: the same x_t, texts and sizes give the same guidance."""
    from diffusers import DDIMScheduler

    folder = checkpoints[prior.spec.prediction_type]
    pipeline = pipeline_of(prior, folder)
    latents = torch.randn(2, 4, 16, 16, generator=torch.Generator().manual_seed(0))
    steps = pipeline_steps(
        pipeline,
        lambda: pipeline(
            ["a red cow", "blue"],
            negative_prompt=["ugly", "ugly"],
            num_inference_steps=2,
            guidance_scale=7.5,
            latents=latents,
            output_type="latent",
        ),
    )
    assert [step.timestep for step in steps] == [501, 1]
    text, uncond = prior.encode_text(["a red cow", "blue"]), prior.encode_text(["ugly"])
    scheduler = DDIMScheduler.from_pretrained(folder / "scheduler", clip_sample=False)
    scheduler.set_timesteps(1000)
    for step in steps:
        ours = guided_noise(prior, step.x_t, step.timestep / 1000, text, uncond, 7.5)
        # The library's own word for the noise in its prediction.
        clean = scheduler.step(step.guided, step.timestep, step.x_t).pred_original_sample
        alphabar = scheduler.alphas_cumprod[step.timestep]
        theirs = (step.x_t - alphabar.sqrt() * clean) / (1 - alphabar).sqrt()
        torch.testing.assert_close(ours, theirs, atol=1e-4, rtol=1e-4)
        if prior.spec.prediction_type == "epsilon":
            torch.testing.assert_close(ours, step.guided, atol=1e-4, rtol=0)


def test_sizes_are_told(prior: SDXLPrior) -> None:
    """A network that is told another size predicts something else: the conditioning is not lost on the way."""
    x_t = torch.randn(1, 4, 16, 16, generator=torch.Generator().manual_seed(0))
    text = prior.encode_text(["a red cow"])
    seen: list[dict[str, torch.Tensor]] = []
    hook = prior.unet.register_forward_pre_hook(
        lambda _, args, options: seen.append(options["added_cond_kwargs"]), with_kwargs=True
    )
    prior.predict_noise(x_t, 0.5, text)
    hook.remove()
    assert seen[0]["time_ids"].tolist() == [[32, 32, 0, 0, 32, 32]]
    without_pooled = text.clone()
    without_pooled[:, -1] = 0
    assert not torch.equal(prior.predict_noise(x_t, 0.5, text), prior.predict_noise(x_t, 0.5, without_pooled))


@pytest.mark.parametrize(
    "config", [{}, {"scaling_factor": 0.4, "latents_mean": [0.1, -0.2, 0.3, 0.0], "latents_std": [0.5, 1.0, 2.0, 3.0]}]
)
def test_latents_are_scaled_as_the_pipeline_does(tmp_path: Path, config: dict[str, Any]) -> None:
    """Both ways, through the pipelines' own code."""
    folder = save_tiny_sdxl(tmp_path / "tiny", vae=config)
    prior = SDXLPrior.load(folder)
    with torch.no_grad():  # the image-to-image pipeline samples from the posterior, which is a point here
        prior.pipe.vae.quant_conv.weight[4:] = 0
        prior.pipe.vae.quant_conv.bias[4:] = -30
    image = make_channels(("shaded",), 2, 32)["shaded"]
    onto = pipeline_of(prior, folder, "StableDiffusionXLImg2ImgPipeline")
    with torch.no_grad():
        theirs = onto.prepare_latents(
            onto.image_processor.preprocess(image.permute(0, 3, 1, 2)),
            None, 2, 1, torch.float32, "cpu", torch.Generator().manual_seed(0), add_noise=False,
        )  # fmt: skip
    torch.testing.assert_close(prior.encode_image({"shaded": image}), theirs, atol=1e-5, rtol=1e-5)

    last: list[torch.Tensor] = []
    pictures = pipeline_of(prior, folder)(
        "a cow",
        num_inference_steps=1,
        generator=torch.Generator().manual_seed(0),
        output_type="pt",
        callback_on_step_end=lambda _, i, t, tensors: last.append(tensors["latents"]) or {},
    )
    shown = prior.decode_image(last[0])["shaded"]
    torch.testing.assert_close(shown, pictures.images.permute(0, 2, 3, 1), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("size", [32, 20])
def test_gradient_through_the_encoder_matches_finite_differences(checkpoints: dict[str, Path], size: int) -> None:
    check_gradient(SDXLPrior.load(checkpoints["epsilon"], Loading(dtype="float64")), size)


def test_a_perfect_model_has_no_gradient(prior: SDXLPrior, monkeypatch: pytest.MonkeyPatch) -> None:
    """A network that knows the noise, in its own terms, leaves the picture as it is."""
    from diffusers import DDPMScheduler

    x, noise = torch.randn(2, 2, 4, 16, 16, generator=torch.Generator().manual_seed(0)).unbind()
    text = prior.encode_text(["a", "b"])
    scheduler = DDPMScheduler(beta_start=0.00085, beta_end=0.012, beta_schedule="scaled_linear")

    def perfect(x_t: torch.Tensor, timestep: int, text: torch.Tensor, geometry: None) -> torch.Tensor:
        if prior.spec.prediction_type == "epsilon":
            return noise.repeat(2, 1, 1, 1)
        return scheduler.get_velocity(x, noise, torch.full((2,), timestep)).repeat(2, 1, 1, 1)

    monkeypatch.setattr(prior, "_denoise", perfect)
    for t in (0.02, 0.5, 0.98):
        gradient, record = sds_gradient(prior, x, text, text[:1], t, noise, 101.0)
        assert gradient.abs().max() < 1e-5
        assert record.weight > 0


def test_chunks_change_nothing(prior: SDXLPrior) -> None:
    x_t = torch.randn(3, 4, 16, 16, generator=torch.Generator().manual_seed(0))
    text = prior.encode_text(["a", "b", "c"])
    whole = prior.predict_noise(x_t, 0.4, text)
    prior.chunk = 2
    torch.testing.assert_close(prior.predict_noise(x_t, 0.4, text), whole, atol=1e-5, rtol=1e-4)
    with pytest.raises(ValueError, match="sees no geometry"):
        prior.predict_noise(x_t, 0.4, text, x_t)


@pytest.mark.parametrize("dtype", ["bfloat16", "float16"])
def test_low_precision_is_near(checkpoints: dict[str, Path], dtype: str) -> None:
    exact, coarse = (SDXLPrior.load(checkpoints["epsilon"], Loading(dtype=kind)) for kind in ("float32", dtype))
    assert coarse.pipe.vae.dtype == (torch.float32 if dtype == "float16" else torch.bfloat16)
    channels = make_channels(("shaded",), 1, 32)
    x = exact.encode_image(channels)
    assert coarse.encode_image(channels).dtype == torch.float32
    a, b = (p.predict_noise(x, 0.5, p.encode_text(["a cow"])) for p in (exact, coarse))
    assert b.dtype == torch.float32
    assert not torch.equal(a, b)
    for wanted, got in ((x, coarse.encode_image(channels)), (a, b)):
        assert (got - wanted).square().mean() < 1e-3 * wanted.square().mean()


def test_inpainting_network_and_refiner_are_refused(checkpoints: dict[str, Path], tmp_path: Path) -> None:
    from diffusers import UNet2DConditionModel

    for change, told in (({"in_channels": 9}, "takes 9 channels"), ({"addition_time_embed_dim": 7}, "is not told")):
        folder = Path(shutil.copytree(checkpoints["epsilon"], tmp_path / told.replace(" ", "-")))
        config = UNet2DConditionModel.load_config(folder / "unet") | change
        UNet2DConditionModel.from_config(config).save_pretrained(folder / "unet")
        with pytest.raises(PriorError, match=told) as caught:
            SDXLPrior.load(folder)
        assert caught.value.code == "prior.kind"
        assert "base" in caught.value.hint
