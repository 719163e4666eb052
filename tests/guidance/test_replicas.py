"""Copies of a prior on several devices give what one gives; here the devices are the CPU, twice or three times."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from tests.guidance.contract import check_prior, make_channels
from tests.guidance.tiny import save_tiny
from torch import Tensor

from paintit.config import POCKET
from paintit.device import choose_device
from paintit.errors import PriorError, UsageError
from paintit.guidance.economy import Economy
from paintit.guidance.exact import ExactPrior
from paintit.guidance.load import load_prior
from paintit.guidance.loading import Loading
from paintit.guidance.prior import Decoder, Paced, Prior, Reader, TextReleasing
from paintit.guidance.replicas import Replicas
from paintit.mesh.read import read_mesh
from paintit.paint.make import make_painter
from paintit.settings import merge


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("diffusers")
    return save_tiny(tmp_path_factory.mktemp("replicas") / "sd")


@pytest.fixture(params=["pocket", "tiny"])
def name(request: pytest.FixtureRequest) -> str:
    return "pocket" if request.param == "pocket" else str(request.getfixturevalue("tiny"))


def copies(name: str, count: int) -> Prior:
    config = replace(POCKET, device=",".join(["cpu"] * count), dtype="float32")
    return load_prior(name, Loading.of(config, choose_device(config.device)[0]))


def test_contract(name: str) -> None:
    prior = copies(name, 2)
    assert isinstance(prior, Replicas)
    check_prior(prior)


@pytest.mark.parametrize(("devices", "views"), [(2, 4), (3, 4), (3, 2), (2, 1)])
def test_they_give_what_one_gives(name: str, devices: int, views: int) -> None:
    one, many = copies(name, 1), copies(name, devices)
    results = []
    for prior in (one, many):
        channels = {k: v.requires_grad_() for k, v in make_channels(prior.reads, views, 40).items()}
        x = prior.encode_image(channels)
        slope = torch.randn(x.shape, generator=torch.Generator().manual_seed(3))
        gradients = torch.autograd.grad(x, [channels[name] for name in prior.reads], slope)
        text = prior.encode_text([f"a red ball {view}" for view in range(views)])
        geometry = prior.encode_geometry(make_channels(prior.sees, views, 40, seed=1))
        predicted = prior.predict_noise(prior.add_noise(x.detach(), slope, 0.6), 0.6, text, geometry)
        results.append((x.detach(), predicted, *gradients))
    for expected, found in zip(*results, strict=True):
        torch.testing.assert_close(found, expected, atol=1e-5, rtol=1e-5)


def test_what_the_prior_can_do_besides_is_kept(tiny: Path) -> None:
    pocket, stable = copies("pocket", 2), copies(str(tiny), 2)
    assert isinstance(pocket, Decoder)
    assert isinstance(pocket, Reader)
    assert isinstance(stable, Decoder)
    assert not isinstance(stable, Reader)
    assert pocket.bound == 1.0
    single = load_prior("pocket")
    assert isinstance(single, Reader)
    assert (
        pocket.readings("a polished gold ocelot") == single.readings("a polished gold ocelot") == {"ocelot": "leopard"}
    )


class Meeting(ExactPrior):
    """Goes on only where another copy is at work at the same moment."""

    def __init__(self, barrier: threading.Barrier) -> None:
        super().__init__()
        self.barrier = barrier
        self.gradients: list[bool] = []

    def encode_image(self, channels: Mapping[str, Tensor]) -> Tensor:
        self.barrier.wait(10)
        self.gradients.append(torch.is_grad_enabled())
        return super().encode_image(channels)

    def predict_noise(self, x_t: Tensor, t: float, text: Tensor, geometry: Tensor | None = None) -> Tensor:
        self.barrier.wait(10)
        return super().predict_noise(x_t, t, text, geometry)


def test_they_work_at_the_same_time_and_as_the_caller_wants_gradients() -> None:
    barrier = threading.Barrier(3)
    priors = [Meeting(barrier) for _ in range(3)]
    many = Replicas(priors, ["cpu"] * 3)
    channels = make_channels(many.reads, 3, 8)
    with torch.no_grad():
        many.encode_image(channels)
    x = many.encode_image(channels)
    many.predict_noise(x, 0.5, many.encode_text([""] * 3), torch.zeros_like(x))
    assert [prior.gradients for prior in priors] == [[False, True]] * 3


def test_a_failure_of_one_is_the_callers() -> None:
    class Broken(ExactPrior):
        def encode_image(self, channels: Mapping[str, Tensor]) -> Tensor:
            raise ValueError("no")

    many = Replicas([ExactPrior(), Broken()], ["cpu", "cpu"])
    with pytest.raises(ValueError, match="no"):
        many.encode_image(make_channels(many.reads, 2, 8))


@pytest.mark.parametrize("method", ["distillation", "projection"])
def test_a_paint_comes_out_alike(method: str, assets: Path) -> None:
    settings = {
        "texture.size": 32, "texture.widths": [4, 4], "texture.skip_widths": [2, 2], "texture.input_channels": 2,
        "views.count": 3, "views.size": 24, "optim.steps": 2, "dtype": "float32", "method": method,
        "projection.views": 2, "projection.steps": 2,
    }  # fmt: skip
    mesh = read_mesh(assets / "meshes" / "spot" / "spot.obj")
    maps, reasons = [], []
    for device in ("cpu", "cpu,cpu", "cpu,cpu"):
        painter = make_painter(mesh, "red brick", merge(POCKET, {**settings, "device": device}))
        assert len(list(painter)) == 2
        maps.append(painter.maps().packed())
        reasons.append(painter.device_reason)
    torch.testing.assert_close(maps[1], maps[0], atol=1e-4, rtol=0)
    assert torch.equal(maps[2], maps[1]), "the same devices, the same bytes"
    assert reasons == ["asked for", *["asked for; the prior works on cpu and cpu at once"] * 2]


@pytest.mark.parametrize(
    ("devices", "words"),
    [
        ("cuda:0,cpu", "not of one kind"),
        ("auto,cpu", "not of one kind"),
        ("cuda,cuda:0", "name one twice"),
        ("mps,mps", "name one twice"),
        ("cpu,cpu:x", "there is no device 'cpu:x'"),
        ("cuda:998,cuda:999", "'cuda:998' was asked for, but"),
    ],
)
def test_devices_that_do_not_go_together(devices: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        choose_device(devices)


def test_copies_are_compiled_without_cuda_graphs() -> None:
    settings = {"compute.compile": "on"}
    assert Economy.of(merge(POCKET, {**settings, "device": "cuda:0"}), "cuda:0").graphs
    assert not Economy.of(merge(POCKET, {**settings, "device": "cuda:0,cuda:1"}), "cuda:0").graphs


def test_what_one_is_told_all_are_told(tiny: Path) -> None:
    stable = copies(str(tiny), 2)
    assert isinstance(stable, Replicas)
    assert isinstance(stable, Paced)
    assert isinstance(stable, TextReleasing)
    assert not isinstance(copies("pocket", 2), TextReleasing)
    known = stable.encode_text(["a red ball"])
    stable.release_texts()
    assert torch.equal(stable.encode_text(["a red ball"]), known)
    for prior in stable.priors:
        with pytest.raises(PriorError):
            prior.encode_text(["another"])
