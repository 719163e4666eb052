"""The DeepFloyd IF adapter on small random weights of the real classes, held to the diffusers pipeline on the same."""

from __future__ import annotations

import logging
import math
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest
import torch
from tests.guidance.contract import check_gradient, check_prior, make_channels
from tests.guidance.pipeline_step import guided_noise, pipeline_steps
from tests.guidance.tiny import save_tiny_if

from paintit.errors import PriorError
from paintit.guidance.deepfloyd import DeepFloydPrior
from paintit.guidance.load import load_prior
from paintit.guidance.loading import Loading
from paintit.guidance.sds import sds_gradient

pytest.importorskip("diffusers")
pytest.importorskip("sentencepiece")


@pytest.fixture(scope="session")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_tiny_if(tmp_path_factory.mktemp("if") / "tiny")


@pytest.fixture
def prior(checkpoint: Path) -> DeepFloydPrior:
    return DeepFloydPrior.load(checkpoint)


def pipeline_of(prior: DeepFloydPrior, folder: Path, kind: str = "IFPipeline") -> Any:
    """The diffusers pipeline of the same components."""
    import diffusers

    scheduler = diffusers.DDPMScheduler.from_pretrained(folder / "scheduler")
    return getattr(diffusers, kind)(
        prior.pipe.tokenizer,
        prior.pipe.text_encoder,
        prior.unet,
        scheduler,
        None,
        None,
        None,
        requires_safety_checker=False,
    )


def test_contract(prior: DeepFloydPrior) -> None:
    check_prior(prior)


def test_spec_comes_from_the_checkpoint(prior: DeepFloydPrior) -> None:
    assert prior.spec.family == "deepfloyd-if"
    assert prior.spec.resolution == 16, "its own pixels: there is no autoencoder"
    assert prior.spec.prediction_type == "epsilon"
    assert len(prior.spec.revision) == 64
    assert prior.encode_image(make_channels(("shaded",), 3, 20)).shape == (3, 3, 16, 16)


def test_a_folder_is_recognised(checkpoint: Path) -> None:
    assert isinstance(load_prior(str(checkpoint)), DeepFloydPrior)


def test_noise_levels_are_those_of_the_published_curve(prior: DeepFloydPrior) -> None:
    """alphabar follows the squared cosine of Nichol 2021, eq. 17."""
    for t in (0.02, 0.3, 0.7):
        step = (prior.timestep(t) + 1) / 1000
        wanted = (math.cos((step + 0.008) / 1.008 * math.pi / 2) / math.cos(0.008 / 1.008 * math.pi / 2)) ** 2
        assert 1 - prior.weight(t) == pytest.approx(wanted, rel=1e-4)


def test_text_is_that_of_the_pipeline(prior: DeepFloydPrior, checkpoint: Path) -> None:
    words, no_words = pipeline_of(prior, checkpoint).encode_prompt(["A red Cow ", "blue"])
    assert words.shape == (2, 77, 16)
    torch.testing.assert_close(prior.encode_text(["A red Cow ", "blue"]), words)
    torch.testing.assert_close(prior.encode_text(["", ""]), no_words)


def test_a_prompt_that_is_cut_is_reported(prior: DeepFloydPrior, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        assert prior.encode_text(["cow " * 30]).shape[1] == 77
    assert "reads 77" in caplog.text


def test_guided_prediction_is_the_pipelines(prior: DeepFloydPrior, checkpoint: Path) -> None:
    """Two steps of the pipeline, at timesteps 500 and 0: the same x_t and texts give the same guidance."""
    pipeline = pipeline_of(prior, checkpoint)
    steps = pipeline_steps(
        pipeline,
        lambda: pipeline(
            ["a red cow", "blue"],
            negative_prompt=["ugly", "ugly"],
            num_inference_steps=2,
            guidance_scale=7.0,
            generator=torch.Generator().manual_seed(0),
            output_type="pt",
            clean_caption=False,
        ),
    )
    assert [step.timestep for step in steps] == [500, 0]
    text, uncond = prior.encode_text(["a red cow", "blue"]), prior.encode_text(["ugly"])
    for step in steps:
        assert step.guided.shape[1] == 6, "noise and variance"
        ours = guided_noise(prior, step.x_t, step.timestep / 1000, text, uncond, 7.0)
        torch.testing.assert_close(ours, step.guided[:, :3], atol=1e-4, rtol=0)


def test_pictures_are_scaled_as_the_pipeline_does(prior: DeepFloydPrior, checkpoint: Path) -> None:
    """In through the image-to-image pipeline's own code, out as the pipeline shows its result."""
    from diffusers.utils import numpy_to_pil

    image = (make_channels(("shaded",), 1, 16)["shaded"] * 255).round() / 255
    onto = pipeline_of(prior, checkpoint, "IFImg2ImgPipeline")
    theirs = onto.preprocess_image(numpy_to_pil(image.numpy())[0])
    torch.testing.assert_close(prior.encode_image({"shaded": image}), theirs)

    shown: list[Any] = []
    pipeline = pipeline_of(prior, checkpoint)
    pipeline.set_progress_bar_config(disable=True)
    for kind in ("pt", "np"):
        generator = torch.Generator().manual_seed(0)
        options = {"num_inference_steps": 1, "generator": generator, "clean_caption": False}
        shown.append(pipeline("a cow", output_type=kind, **options).images)
    torch.testing.assert_close(prior.decode_image(shown[0])["shaded"], torch.from_numpy(shown[1]))


@pytest.mark.parametrize("size", [16, 12, 40])
def test_gradient_through_the_encoder_matches_finite_differences(checkpoint: Path, size: int) -> None:
    check_gradient(DeepFloydPrior.load(checkpoint, Loading(dtype="float64")), size)


def test_a_perfect_model_has_no_gradient(prior: DeepFloydPrior, monkeypatch: pytest.MonkeyPatch) -> None:
    """The real network's variance stays; in place of its noise stands the true one."""
    x, noise = torch.randn(2, 2, 3, 16, 16, generator=torch.Generator().manual_seed(0)).unbind()
    text = prior.encode_text(["a", "b"])
    forward = prior.unet.forward

    def perfect(*args: Any, **options: Any) -> Any:
        output = forward(*args, **options)
        output.sample[:, :3] = noise.repeat(2, 1, 1, 1)
        return output

    monkeypatch.setattr(prior.unet, "forward", perfect)
    for t in (0.02, 0.5, 0.98):
        gradient, record = sds_gradient(prior, x, text, text[:1], t, noise, 21.0)
        assert not gradient.any()
        assert record.weight > 0


@pytest.mark.parametrize("dtype", ["bfloat16", "float16"])
def test_low_precision_is_near(checkpoint: Path, dtype: str) -> None:
    exact, coarse = (DeepFloydPrior.load(checkpoint, Loading(dtype=kind)) for kind in ("float32", dtype))
    x = exact.encode_image(make_channels(("shaded",), 1, 16))
    a, b = (p.predict_noise(x, 0.5, p.encode_text(["a cow"])) for p in (exact, coarse))
    assert b.dtype == torch.float32
    assert not torch.equal(a, b)
    assert (a - b).square().mean() < 1e-3 * a.square().mean()


def test_other_stages_are_refused(checkpoint: Path, tmp_path: Path) -> None:
    from diffusers import UNet2DConditionModel

    folder = Path(shutil.copytree(checkpoint, tmp_path / "copy"))
    config = UNet2DConditionModel.load_config(folder / "unet") | {"in_channels": 6, "class_embed_type": "timestep"}
    UNet2DConditionModel.from_config(config).save_pretrained(folder / "unet")
    with pytest.raises(PriorError, match="from text alone") as caught:
        DeepFloydPrior.load(folder)
    assert caught.value.code == "prior.kind"
    assert "stage I" in caught.value.hint


def test_without_the_tokenizer_library(checkpoint: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sentencepiece", None)
    with pytest.raises(PriorError, match="sentencepiece") as caught:
        DeepFloydPrior.load(checkpoint)
    assert caught.value.code == "prior.extra"
