"""The flow families on small random weights of the real diffusers and transformers classes, against their pipelines."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from tests.guidance.contract import check_gradient, check_prior, make_channels
from tests.guidance.tiny_flow import save_tiny_flux2, save_tiny_sd3, save_tiny_z_image
from torch import Tensor

from paintit.guidance.flow import FlowPrior
from paintit.guidance.flow_flux2 import Flux2KleinPrior
from paintit.guidance.load import load_prior
from paintit.guidance.loading import Loading
from paintit.guidance.sds import sds_gradient

pytest.importorskip("diffusers")
FAMILIES = ("sd3", "flux2-klein", "z-image")
#: What is saved: the families as they are published, then without T5, shifted by resolution or fixed, distilled.
SAVED: dict[str, Callable[[Path], Path]] = {
    "sd3": save_tiny_sd3,
    "flux2-klein": save_tiny_flux2,
    "z-image": save_tiny_z_image,
    "sd3-without-t5": lambda folder: save_tiny_sd3(folder, t5=False),
    "sd3-dynamic": lambda folder: save_tiny_sd3(folder, use_dynamic_shifting=True),
    "flux2-klein-linear": lambda folder: save_tiny_flux2(folder, time_shift_type="linear"),
    "flux2-klein-distilled": lambda folder: save_tiny_flux2(folder, distilled=True),
    "z-image-dynamic": lambda folder: save_tiny_z_image(folder, use_dynamic_shifting=True, max_shift=1.3),
    "z-image-turbo": save_tiny_z_image,
}
PROMPTS = ["a red ball", "blue"]


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Folder of a checkpoint; saved when first asked for."""
    root = tmp_path_factory.mktemp("flow")
    return lambda name: root / name if (root / name).is_dir() else SAVED[name](root / name)


@pytest.fixture(scope="session")
def load(folder: Callable[[str], Path]) -> Callable[[str], FlowPrior]:
    """A prior as users load it; loaded once."""
    loaded: dict[str, FlowPrior] = {}

    def prior(name: str) -> FlowPrior:
        if name not in loaded:
            made = load_prior(str(folder(name)))
            assert isinstance(made, FlowPrior)
            loaded[name] = made
        return loaded[name]

    return prior


@pytest.fixture(params=FAMILIES)
def prior(request: pytest.FixtureRequest, load: Callable[[str], FlowPrior]) -> FlowPrior:
    return load(request.param)


def load_pipeline(folder: Path) -> Any:
    """The family's own pipeline with the same weights, loaded by diffusers alone."""
    import diffusers

    parts = dict.fromkeys(("text_encoder_3", "tokenizer_3")) if "without-t5" in folder.name else {}
    pipeline: Any = diffusers.DiffusionPipeline.from_pretrained(folder, local_files_only=True, **parts)
    pipeline.set_progress_bar_config(disable=True)
    return pipeline


def as_picture(latents: Tensor) -> Tensor:
    """Latents as the prior lays them out; FLUX.2's pipeline has them as tokens (n, h w, c)."""
    if latents.ndim == 4:
        return latents
    side = round(latents.shape[1] ** 0.5)
    return latents.transpose(1, 2).unflatten(2, (side, side))


def level(prior: FlowPrior, s: float) -> float:
    """The t with this share of noise, by bisection."""
    low, high = 1e-6, 1.0
    for _ in range(60):
        t = (low + high) / 2
        low, high = (t, high) if prior.noise_share(t) < s else (low, t)
    return high


def test_contract(prior: FlowPrior) -> None:
    check_prior(prior)


def test_spec(prior: FlowPrior) -> None:
    assert prior.spec.resolution == 32
    assert prior.spec.prediction_type == "flow"
    assert len(prior.spec.revision) == 64
    latents = prior.encode_image(make_channels(("shaded",), 3, 20))
    assert latents.shape == ((3, 16, 8, 8) if isinstance(prior, Flux2KleinPrior) else (3, 4, 16, 16))
    with pytest.raises(ValueError, match="sees no geometry"):
        prior.predict_noise(latents, 0.5, prior.encode_text(["a"] * 3), latents)


def test_distilled_models_are_not_guided_further(load: Callable[[str], FlowPrior]) -> None:
    scales = {name: load(name).spec.guidance_scale for name in SAVED}
    assert {name for name, scale in scales.items() if scale == 1} == {"flux2-klein-distilled", "z-image-turbo"}
    assert set(scales.values()) == {1, 100}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", [name for name in SAVED if name not in ("flux2-klein-linear", "z-image-turbo")])
def test_guided_prediction_is_the_pipelines_own(
    name: str, load: Callable[[str], FlowPrior], folder: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    prior, pipeline = load(name), load_pipeline(folder(name))
    steps: list[tuple[Tensor, float, Tensor]] = []
    step = pipeline.scheduler.step

    def listen(velocity: Tensor, time: Tensor, sample: Tensor, **options: Any) -> Any:
        steps.append((as_picture(velocity), time.item() / 1000, as_picture(sample)))
        return step(velocity, time, sample, **options)

    monkeypatch.setattr(pipeline.scheduler, "step", listen)
    size = prior.spec.resolution
    words = {} if name.startswith("flux2") else {"negative_prompt": ["bad", "bad"]}
    pipeline(
        prompt=list(PROMPTS), height=size, width=size, num_inference_steps=3, guidance_scale=4.0, output_type="latent",
        generator=torch.Generator().manual_seed(0), **words,
    )  # fmt: skip
    # Z-Image's pipeline counts its scale from the conditional half: cond + 4 (cond - uncond).
    scale = {"z-image": 5.0, "z-image-dynamic": 5.0, "flux2-klein-distilled": 1.0}.get(name, 4.0)
    text, uncond = prior.encode_text(PROMPTS), prior.encode_text(["bad" if words else ""])
    assert [s for _, s, _ in steps[1:] if 0 < s < 1], "at s = 1 any velocity will do"
    for velocity, s, sample in steps:
        t = level(prior, s)
        # x = 0 makes of the noise the very sample.
        noise = sample / prior.noise_share(t)
        gradient, record = sds_gradient(prior, torch.zeros_like(sample), text, uncond, t, noise, scale)
        guided = gradient / record.weight + noise
        torch.testing.assert_close(guided, sample + (1 - s) * velocity, atol=1e-4, rtol=1e-4)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    "name", ["sd3", "sd3-dynamic", "flux2-klein", "flux2-klein-linear", "z-image", "z-image-dynamic"]
)
def test_schedule_is_the_pipelines_own(
    name: str, load: Callable[[str], FlowPrior], folder: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    prior, pipeline = load(name), load_pipeline(folder(name))

    class Stop(Exception):
        pass

    def stop(*_: Any, **__: Any) -> None:
        raise Stop

    monkeypatch.setattr(pipeline.scheduler, "step", stop)
    with pytest.raises(Stop):
        pipeline(prompt="a", height=32, width=32, num_inference_steps=200, sigmas=[1 - i / 200 for i in range(200)])
    got = torch.tensor([1000 * prior.noise_share(1 - i / 200) for i in range(200)])
    torch.testing.assert_close(got, pipeline.scheduler.timesteps, atol=2e-3, rtol=0)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", FAMILIES)
def test_latents_are_scaled_as_in_the_pipeline(
    name: str, load: Callable[[str], FlowPrior], folder: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    prior, pipeline = load(name), load_pipeline(folder(name))
    latents: list[Tensor] = []

    def keep(_: Any, __: int, ___: Any, state: dict[str, Tensor]) -> dict[str, Tensor]:
        latents.append(as_picture(state["latents"]))
        return state

    image = pipeline(
        prompt="a", height=32, width=32, num_inference_steps=1, output_type="pt", callback_on_step_end=keep
    ).images
    shaded = prior.decode_image(latents[-1])["shaded"]
    assert shaded.shape == (1, 32, 32, 3)
    torch.testing.assert_close(shaded, image.movedim(1, -1), atol=1e-5, rtol=1e-4)

    # And encoding is the inverse of that: what the autoencoder gets back is the mean that it gave.
    given: list[Tensor] = []
    decode = prior.pipe.vae.decode
    monkeypatch.setattr(prior.pipe.vae, "decode", lambda z, **options: given.append(z) or decode(z, **options))
    picture = torch.rand(1, 32, 32, 3, generator=torch.Generator().manual_seed(0))
    prior.decode_image(prior.encode_image({"shaded": picture}))
    mean = prior.pipe.vae.encode(2 * picture.movedim(-1, 1) - 1).latent_dist.mean
    torch.testing.assert_close(given[0], mean, atol=1e-5, rtol=1e-4)


def test_latents_of_flux2_are_those_that_its_pipeline_encodes(load: Callable[[str], FlowPrior]) -> None:
    prior = load("flux2-klein")
    picture = torch.rand(2, 32, 32, 3, generator=torch.Generator().manual_seed(0))
    wanted = prior.pipe._encode_vae_image(2 * picture.movedim(-1, 1) - 1, generator=None)
    torch.testing.assert_close(prior.encode_image({"shaded": picture}), wanted)


def test_a_perfect_model_gives_no_gradient(prior: FlowPrior, monkeypatch: pytest.MonkeyPatch) -> None:
    x = prior.encode_image(make_channels(("shaded",), 2, 32)).detach()
    noise = torch.randn(x.shape, generator=torch.Generator().manual_seed(0))
    monkeypatch.setattr(prior, "velocity", lambda x_s, s, text: noise - x)
    text = prior.encode_text(PROMPTS)
    for t in (0.02, 0.5, 1.0):
        gradient, _ = sds_gradient(prior, x, text, text, t, noise, 1.0)
        assert gradient.abs().max() < 1e-5


def test_a_denoiser_gives_the_gradient_of_the_same_denoiser_on_a_diffusion_path(
    prior: FlowPrior, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the weight: (1 - alphabar) (alpha / sigma) (x - x-hat), alpha and sigma of equal signal-to-noise ratio."""
    x, guess, noise = torch.randn(3, 2, 4, 8, 8, generator=torch.Generator().manual_seed(0)).unbind()
    monkeypatch.setattr(prior, "velocity", lambda x_s, s, text: (x_s - guess) / s)
    for t in (0.1, 0.5, 0.9):
        s = prior.noise_share(t)
        alphabar = (1 - s) ** 2 / ((1 - s) ** 2 + s**2)
        wanted = (1 - alphabar) * (alphabar / (1 - alphabar)) ** 0.5 * (x - guess)
        gradient, _ = sds_gradient(prior, x, noise, noise, t, noise, 1.0)
        torch.testing.assert_close(gradient, wanted, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("name", FAMILIES)
def test_gradient_through_the_autoencoder_matches_finite_differences(name: str, folder: Callable[[str], Path]) -> None:
    check_gradient(load_prior(str(folder(name)), Loading(dtype="float64")), 20)


def test_chunks_change_nothing(prior: FlowPrior, monkeypatch: pytest.MonkeyPatch) -> None:
    x_t = prior.encode_image(make_channels(("shaded",), 3, 32)).detach()
    text = prior.encode_text(["a", "b", "a long one"])
    whole = prior.predict_noise(x_t, 0.4, text)
    monkeypatch.setattr(prior, "chunk", 2)
    torch.testing.assert_close(prior.predict_noise(x_t, 0.4, text), whole, atol=1e-5, rtol=1e-4)


def test_low_precision_is_near(prior: FlowPrior) -> None:
    coarse = load_prior(prior.spec.id, Loading(dtype="bfloat16"))
    x = prior.encode_image(make_channels(("shaded",), 1, 32)).detach()
    exact, rounded = (p.predict_noise(x, 0.5, p.encode_text(["a cow"])) for p in (prior, coarse))
    assert rounded.dtype == torch.float32
    assert not torch.equal(exact, rounded)
    assert (exact - rounded).square().mean() < 1e-3 * exact.square().mean()


def test_noise_grows_with_t(prior: FlowPrior) -> None:
    shares = [prior.noise_share(t) for t in (0.001, 0.02, 0.3, 0.7, 0.98, 1.0)]
    assert all(low < high for low, high in itertools.pairwise(shares))
    assert shares[-1] == 1
