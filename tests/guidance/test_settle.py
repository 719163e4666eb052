"""The parts of a pipeline where and as they are to work: on the host, channels last, compiled, let go."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from tests.guidance.contract import check_prior, make_channels
from tests.guidance.tiny import save_tiny, save_tiny_if, save_tiny_sdxl
from tests.guidance.tiny_flow import save_tiny_flux2, save_tiny_sd3, save_tiny_z_image
from torch import Tensor
from torch.overrides import TorchFunctionMode

from paintit.errors import PriorError
from paintit.guidance.economy import Economy
from paintit.guidance.load import load_prior
from paintit.guidance.loading import Loading
from paintit.guidance.stable_diffusion import StableDiffusionPrior

pytest.importorskip("diffusers")


@pytest.fixture(scope="session")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_tiny(tmp_path_factory.mktemp("tiny") / "sd")


@pytest.fixture(scope="session")
def plain(checkpoint: Path) -> StableDiffusionPrior:
    return StableDiffusionPrior.load(checkpoint)


def prediction(prior: Any) -> Tensor:
    x_t = torch.randn(3, 4, 16, 16, generator=torch.Generator().manual_seed(0))
    return prior.predict_noise(x_t, 0.4, prior.encode_text(["a cow", "a pig", "a dog"]))


def economical(checkpoint: Path, **economy: Any) -> StableDiffusionPrior:
    return StableDiffusionPrior.load(checkpoint, Loading(economy=Economy(**economy)))


def test_channels_last(checkpoint: Path, plain: StableDiffusionPrior) -> None:
    prior = economical(checkpoint, channels_last=True)
    for part in (prior.unet, prior.pipe.vae):
        wide = [p for p in part.parameters() if p.ndim == 4 and p.shape[2] > 1]
        assert all(p.is_contiguous(memory_format=torch.channels_last) for p in wide)
    torch.testing.assert_close(prediction(prior), prediction(plain), atol=1e-5, rtol=1e-4)
    check_prior(prior)


def test_layers_are_fetched_for_their_turn(
    checkpoint: Path, plain: StableDiffusionPrior, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each layer once for each prediction; here from the host to the host."""
    from diffusers.hooks import group_offloading

    fetched: list[Any] = []
    fetch = group_offloading.ModuleGroup.onload_
    monkeypatch.setattr(group_offloading.ModuleGroup, "onload_", lambda group: (fetched.append(group), fetch(group)))
    prior = economical(checkpoint, offload=True, host_texts=True)
    assert torch.equal(prediction(prior), prediction(plain))
    layers = [m for m in prior.unet.modules() if isinstance(m, (torch.nn.Conv2d, torch.nn.Linear))]
    assert len({id(group) for group in fetched}) >= len(layers)
    once = len(fetched)
    prediction(prior)
    assert len(fetched) == 2 * once
    check_prior(prior)


def test_attention_is_fused(tmp_path: Path, checkpoint: Path) -> None:
    """Every attention of network and encoder goes through torch's own, and none is written out; but IF, once, pools
    the rows of its text."""

    class Count(TorchFunctionMode):
        fused = written = 0

        def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
            self.fused += func is torch.nn.functional.scaled_dot_product_attention
            self.written += func in (torch.softmax, torch.Tensor.softmax, torch.nn.functional.softmax, torch.baddbmm)
            return func(*args, **(kwargs or {}))

    for folder in (
        checkpoint, save_tiny_sdxl(tmp_path / "sdxl"), save_tiny_if(tmp_path / "if"), save_tiny_sd3(tmp_path / "sd3"),
        save_tiny_flux2(tmp_path / "flux2"), save_tiny_z_image(tmp_path / "z"),
    ):  # fmt: skip
        prior = load_prior(str(folder))
        text = prior.encode_text(["a"])
        for work in (
            lambda: prior.encode_image(make_channels(("shaded",), 1, 32)),  # noqa: B023
            lambda: prior.predict_noise(prior.encode_image(make_channels(("shaded",), 1, 32)), 0.5, text),  # noqa: B023
        ):
            with Count() as count:
                work()
            assert count.written == (folder.name == "if" and count.fused > 0), folder
        assert count.fused > 0, folder


def test_a_float16_network_beside_a_float32_autoencoder(checkpoint: Path, plain: StableDiffusionPrior) -> None:
    """Pictures, latents and predictions are float32 on both sides of the network; so is the gradient."""
    prior = StableDiffusionPrior.load(checkpoint, Loading(dtype="float16"))
    assert prior.unet.dtype == torch.float16
    assert prior.pipe.vae.dtype == torch.float32
    shaded = make_channels(("shaded",), 2, 48)["shaded"].requires_grad_()
    x = prior.encode_image({"shaded": shaded})
    assert torch.equal(x, plain.encode_image({"shaded": shaded}))
    x.backward(torch.ones_like(x))
    assert shaded.grad is not None
    assert shaded.grad.dtype == torch.float32
    found = prediction(prior)
    assert found.dtype == torch.float32
    torch.testing.assert_close(found, prediction(plain), atol=0.02, rtol=0.02)


class TestTexts:
    def test_encoders_are_let_go_and_texts_stay(self, checkpoint: Path, plain: StableDiffusionPrior) -> None:
        prior = StableDiffusionPrior.load(checkpoint)
        before = prior.encode_text(["a cow"])
        encoder = weakref.ref(prior.pipe.text_encoder)
        prior.release_texts()
        assert encoder() is None
        assert torch.equal(prior.encode_text(["a cow"]), before)
        with pytest.raises(PriorError, match="were let go before 'a pig' was asked") as caught:
            prior.encode_text(["a cow", "a pig"])
        assert caught.value.code == "prior.text"
        x_t = torch.zeros(1, 4, 16, 16)
        assert torch.equal(prior.predict_noise(x_t, 0.4, before), plain.predict_noise(x_t, 0.4, before))

    @pytest.mark.parametrize("save", [save_tiny_sdxl, save_tiny_sd3, save_tiny_flux2, save_tiny_z_image, save_tiny_if])
    def test_no_family_needs_them_to_predict(self, save: Any, tmp_path: Path) -> None:
        prior: Any = load_prior(str(save(tmp_path / "it")))
        text = prior.encode_text(["a"])
        x = prior.encode_image(make_channels(("shaded",), 1, 32)).detach()
        before = prior.predict_noise(x, 0.5, text)
        prior.release_texts()
        assert not [name for name, part in prior.pipe.components.items() if name.startswith("text_enc") and part]
        assert torch.equal(prior.predict_noise(x, 0.5, prior.encode_text(["a"])), before)


@pytest.fixture
def fresh_compiler() -> Iterator[None]:
    torch.compiler.reset()
    yield
    torch.compiler.reset()


@pytest.mark.filterwarnings("ignore")  # torch's own, inside its compiler
@pytest.mark.usefixtures("fresh_compiler")
def test_without_a_compiler_one_line_says_so(checkpoint: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from torch._inductor import config

    monkeypatch.setenv("TORCHINDUCTOR_CACHE_DIR", str(tmp_path / "cache"))
    words = "torch.compile does not work here: .*install a C.. compiler"
    with config.patch({"cpp.cxx": (None, "/no/such/compiler")}), pytest.raises(PriorError, match=words) as caught:
        economical(checkpoint, compile=True)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # torch's own, inside its compiler
@pytest.mark.usefixtures("fresh_compiler")
def test_a_compiled_prior_predicts_the_same(checkpoint: Path, plain: StableDiffusionPrior) -> None:
    """One graph for all noise levels; the encoder's passes its gradient."""
    from torch._dynamo.utils import counters

    prior = economical(checkpoint, compile=True, recompute=1)
    torch.testing.assert_close(prediction(prior), prediction(plain), atol=1e-4, rtol=1e-3)
    text = prior.encode_text(["a cow", "a pig", "a dog"])
    graphs = counters["stats"]["unique_graphs"]
    x_t = torch.randn(3, 4, 16, 16, generator=torch.Generator().manual_seed(0))
    for t in (0.1, 0.5, 0.9):
        torch.testing.assert_close(
            prior.predict_noise(x_t, t, text), plain.predict_noise(x_t, t, text), atol=1e-4, rtol=1e-3
        )
    assert counters["stats"]["unique_graphs"] == graphs
    gradients = []
    for one in (prior, plain):
        shaded = make_channels(("shaded",), 1, 32)["shaded"].requires_grad_()
        one.encode_image({"shaded": shaded}).square().sum().backward()
        gradients.append(shaded.grad)
    assert gradients[0] is not None
    torch.testing.assert_close(gradients[0], gradients[1], atol=1e-4, rtol=1e-3)
