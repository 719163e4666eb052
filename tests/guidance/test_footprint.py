"""What a prior takes in memory: counted on fake tensors, held to what real ones hold."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from tests.guidance.contract import make_channels
from tests.guidance.tiny import save_tiny, save_tiny_if, save_tiny_sdxl
from tests.guidance.tiny_flow import save_tiny_flux2, save_tiny_sd3, save_tiny_z_image
from torch import Tensor

from paintit.guidance import hub
from paintit.guidance.autoencoder import LatentCodec
from paintit.guidance.economy import Economy, Footprint
from paintit.guidance.families import FAMILIES
from paintit.guidance.footprint import Live
from paintit.guidance.load import prior_class
from paintit.guidance.loading import Loading
from paintit.guidance.stable_diffusion import StableDiffusionPrior

pytest.importorskip("diffusers")
SAVES: dict[str, Callable[[Path], Path]] = {
    "stable-diffusion": save_tiny,
    "sdxl": save_tiny_sdxl,
    "deepfloyd-if": save_tiny_if,
    "sd3": save_tiny_sd3,
    "flux2-klein": save_tiny_flux2,
    "z-image": save_tiny_z_image,
}


@pytest.fixture(scope="session")
def vae() -> Any:
    """A KL autoencoder large enough that activations outweigh odds and ends: 32 pixels, two levels, with attention."""
    from diffusers import AutoencoderKL

    with torch.random.fork_rng():
        torch.manual_seed(0)
        return AutoencoderKL(
            block_out_channels=(32, 64),
            down_block_types=("DownEncoderBlock2D",) * 2,
            up_block_types=("UpDecoderBlock2D",) * 2,
            norm_num_groups=8,
        ).requires_grad_(False)


@pytest.fixture(scope="session")
def checkpoint(vae: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = save_tiny(tmp_path_factory.mktemp("tiny") / "sd")
    vae.save_pretrained(folder / "vae")
    return folder


def test_live_counts_what_is_made_while_it_lives() -> None:
    """Once, however many look at it; and no weights."""
    weight = torch.zeros(10)
    with Live([weight]) as live:
        first = torch.zeros(100)
        view = first.view(10, 10)
        second = weight.view(5, 2) + 1
        assert live.now == 440
        del first
        assert live.now == 440, "a view still looks at it"
        del view
        assert live.now == 40
        third = torch.zeros(20)
        assert (live.now, live.peak) == (120, 440)
    del second, third


def saved_bytes(work: Callable[[], Tensor], weights: list[Tensor]) -> tuple[Tensor, int]:
    """The result, and the bytes that autograd keeps for its backward pass; each storage once, weights not."""
    kept: dict[int, Tensor] = {}

    def pack(tensor: Tensor) -> Tensor:
        kept[tensor.untyped_storage().data_ptr()] = tensor
        return tensor

    with torch.autograd.graph.saved_tensors_hooks(pack, lambda tensor: tensor):
        result = work()
    own = {weight.untyped_storage().data_ptr() for weight in weights}
    return result, sum(t.untyped_storage().nbytes() for at, t in kept.items() if at not in own)


@pytest.fixture(scope="session")
def foreseen(checkpoint: Path) -> Footprint:
    return StableDiffusionPrior.footprint(hub.open_checkpoint(checkpoint, FAMILIES["stable-diffusion"]), Loading())


def test_what_the_encoder_keeps_is_foreseen(checkpoint: Path, foreseen: Footprint) -> None:
    """Within 5 percent of what autograd really saves."""
    prior = StableDiffusionPrior.load(checkpoint)
    shaded = torch.rand(3, prior.spec.resolution, prior.spec.resolution, 3, requires_grad=True)
    _, real = saved_bytes(lambda: prior.encode_image({"shaded": shaded}), list(prior.pipe.vae.parameters()))
    assert 3 * foreseen.encoder.saved == pytest.approx(real, rel=0.05)


def test_what_the_network_holds_is_foreseen(checkpoint: Path, foreseen: Footprint) -> None:
    prior = StableDiffusionPrior.load(checkpoint)
    x_t, text = torch.randn(4, 4, 16, 16), prior.encode_text(["a"] * 4)
    with Live([*prior.unet.parameters(), x_t, text]) as live:
        prior.predict_noise(x_t, 0.5, text)
    assert 4 * foreseen.predict == pytest.approx(live.peak, rel=0.1)


@pytest.mark.parametrize(
    "family", [pytest.param(name, marks=[] if name == "z-image" else pytest.mark.slow) for name in SAVES]
)
def test_weights_are_counted_without_being_read(family: str, tmp_path: Path) -> None:
    folder = SAVES[family](tmp_path / family)
    cls: Any = prior_class(FAMILIES[family])
    real = cls.load(folder)
    for file in folder.glob("*/*.safetensors"):
        file.write_bytes(b"no weights")
    foreseen = cls.footprint(hub.open_checkpoint(folder, FAMILIES[family]), Loading())

    def size(*names: str) -> int:
        parts = [real.pipe.components.get(name) for name in names]
        tensors = [t for part in parts if part is not None for t in (*part.parameters(), *part.buffers())]
        return sum(tensor.nbytes for tensor in tensors)

    assert foreseen.network == size(next(iter(FAMILIES[family].weights)))
    assert foreseen.encoder.weights == size("vae")
    assert foreseen.texts == size("text_encoder", "text_encoder_2", "text_encoder_3")
    assert 0 < foreseen.layer <= foreseen.network
    assert 0 < foreseen.encoder.forward <= foreseen.encoder.backward
    assert 0 < foreseen.encoder.saved <= foreseen.encoder.backward
    assert foreseen.predict > 0


class TestRecomputing:
    def encode(self, vae: Any, size: int) -> tuple[Tensor, Callable[[], Tensor]]:
        shaded = make_channels(("shaded",), 4, 32)["shaded"].requires_grad_()
        return shaded, lambda: LatentCodec(vae, size).encode(shaded, 32)

    def test_gradients_are_the_same(self, vae: Any) -> None:
        """To the last digits: in float32 sums already differ with the size of a batch."""
        gradients = []
        for size in (0, 1, 3):
            shaded, encode = self.encode(copy.deepcopy(vae).double(), size)
            x = encode()
            x.backward(torch.randn(x.shape, generator=torch.Generator().manual_seed(0)).to(x))
            assert shaded.grad is not None
            gradients.append(shaded.grad)
        for gradient in gradients[1:]:
            assert (gradient - gradients[0]).norm() < 1e-12 * gradients[0].norm()

    def test_nothing_but_pictures_is_kept(self, vae: Any) -> None:
        weights = list(vae.parameters())
        kept = {size: saved_bytes(self.encode(vae, size)[1], weights)[1] for size in (0, 1)}
        assert kept[1] < 0.02 * kept[0]

    def test_only_one_chunk_lives_at_a_time(self, vae: Any) -> None:
        peaks = {}
        for size in (0, 2, 1):
            _, encode = self.encode(vae, size)
            with Live(vae.parameters()) as live:
                x = encode()
                x.backward(torch.ones_like(x))
            peaks[size] = live.peak
        assert peaks[2] < 0.6 * peaks[0]
        assert peaks[1] < 0.35 * peaks[0]

    def test_a_prior_is_told(self, checkpoint: Path, tmp_path: Path) -> None:
        for prior in (
            StableDiffusionPrior.load(checkpoint, Loading(economy=Economy(recompute=1))),
            prior_class(FAMILIES["flux2-klein"]).load(  # type: ignore[attr-defined]
                save_tiny_flux2(tmp_path / "flux"), Loading(economy=Economy(recompute=1))
            ),
        ):
            shaded = make_channels(("shaded",), 2, 32)["shaded"].requires_grad_()
            _, kept = saved_bytes(lambda: prior.encode_image({"shaded": shaded}), list(prior.pipe.vae.parameters()))  # noqa: B023
            assert kept < 5 * shaded.nbytes
