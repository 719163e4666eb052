"""The pocket prior: the contract, its arithmetic against hand-worked numbers, and what the shipped weights know."""

from __future__ import annotations

import json
import math
import zlib
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from tests.guidance.contract import check_prior, make_channels
from torch import Tensor

from paintit.color import decode_srgb
from paintit.errors import PriorError
from paintit.guidance.pocket import PocketPrior, weights_path
from paintit.guidance.pocket_net import PocketConfig, PocketNet, hash_word, split_words
from paintit.guidance.prior import Prior
from paintit.guidance.sds import sds_gradient

TINY = PocketConfig(
    width=16, deep=48, deep_blocks=1, shallow_blocks=1, text_width=48, table_width=16, words=64, grams=64,
    condition=32, pixel=16, filters=4,
)  # fmt: skip


@pytest.fixture(scope="module")
def prior() -> PocketPrior:
    return PocketPrior(dtype=torch.float32)


def save_tiny(path: Path, v: float | None = None) -> Path:
    """Random tiny weights; with ``v`` the network answers that constant whatever it is shown."""
    torch.manual_seed(0)
    net = PocketNet(TINY)
    state = {k: torch.randn_like(t) * 0.1 if t.ndim > 1 else t for k, t in net.state_dict().items()}
    if v is not None:
        state["head.leave.weight"] = torch.zeros_like(state["head.leave.weight"])
        state["head.leave.bias"] = torch.full_like(state["head.leave.bias"], v)
    save_file({k: t.contiguous() for k, t in state.items()}, str(path), {"config": json.dumps(asdict(TINY))})
    return path


def sphere(count: int, size: int = 64) -> dict[str, Tensor]:
    """Normals, places and mask of a ball that fills most of the frame, seen from +Z without perspective."""
    axis = (2 * (torch.arange(size) + 0.5) / size - 1) / 0.85
    x, y = axis[None].expand(size, size), -axis[:, None].expand(size, size)
    inside = x * x + y * y < 1
    normal = torch.stack([x, y, (1 - x * x - y * y).clamp_min(0).sqrt()], -1) * inside[..., None]
    mask = inside[..., None].float()
    shown = {"normal": normal, "mask": mask, "position": normal, "normal_object": normal}
    return {name: value.expand(count, -1, -1, -1) for name, value in shown.items()}


def denoise(prior: PocketPrior, prompts: list[str], scale: float = 3.0, steps: int = 8) -> Tensor:
    """(n, 8) mean over a ball of deterministic (DDIM) samples, in [0, 1]."""
    shown = prior.encode_geometry(sphere(len(prompts)))
    text, none = prior.encode_text(prompts), prior.encode_text([""] * len(prompts))
    x = torch.randn(len(prompts), 8, 32, 32, generator=torch.Generator().manual_seed(4))
    times = torch.linspace(0.99, 0.0, steps + 1).tolist()
    for now, after in pairwise(times):
        without = prior.predict_noise(x, now, none, shown)
        noise = without + scale * (prior.predict_noise(x, now, text, shown) - without)
        alpha, sigma = math.cos(now * math.pi / 2), math.sin(now * math.pi / 2)
        clean = ((x - sigma * noise) / alpha).clamp(-1, 1)
        noise = (x - alpha * clean) / sigma
        x = math.cos(after * math.pi / 2) * clean + math.sin(after * math.pi / 2) * noise
    weight = (shown[:, 3:4] > 0.9).float()
    return (x * 0.5 + 0.5).mul(weight).sum((2, 3)) / weight.sum((2, 3))


def test_it_keeps_the_contract(prior: PocketPrior) -> None:
    assert isinstance(prior, Prior)
    check_prior(prior)


def test_a_tiny_network_keeps_the_contract(tmp_path: Path) -> None:
    check_prior(PocketPrior(save_tiny(tmp_path / "tiny.safetensors")))


def test_what_it_says_of_itself(prior: PocketPrior) -> None:
    assert prior.reads == ("shaded", "base_color", "roughness", "metallic")
    assert prior.sees == ("normal", "mask", "position", "normal_object")
    assert (prior.spec.id, prior.spec.family, prior.spec.resolution) == ("pocket", "pocket", 32)
    assert prior.spec.licence == "Apache-2.0"
    assert len(prior.spec.revision) == 64
    assert weights_path().stat().st_size <= 20e6


def test_loading_draws_no_random_numbers() -> None:
    before = torch.get_rng_state()
    PocketPrior()
    assert torch.equal(before, torch.get_rng_state())


def test_the_image_is_averaged_over_areas(prior: PocketPrior) -> None:
    channels = make_channels(prior.reads, 1, 64)
    roughness = channels["roughness"].requires_grad_()
    x = prior.encode_image(channels)
    assert x.shape == (1, 8, 32, 32)
    expected = roughness[0, 10:12, 20:22, 0].mean() * 2 - 1
    torch.testing.assert_close(x[0, 6, 5, 10], expected)
    x[0, 6, 5, 10].backward()
    assert roughness.grad is not None
    assert roughness.grad[0, 10, 21, 0] == pytest.approx(2 / 4)  # range 2 over 4 pixels
    assert roughness.grad.abs().sum() == pytest.approx(2.0)


def test_order_of_the_stack_and_a_size_that_does_not_divide(prior: PocketPrior) -> None:
    values = {"shaded": 0.1, "base_color": 0.3, "roughness": 0.6, "metallic": 0.9}
    channels = {k: torch.full((1, 50, 50, 3 if k in ("shaded", "base_color") else 1), v) for k, v in values.items()}
    got = prior.encode_image(channels).mean((0, 2, 3)) * 0.5 + 0.5
    torch.testing.assert_close(got, torch.tensor([0.1, 0.1, 0.1, 0.3, 0.3, 0.3, 0.6, 0.9]))


def test_normals_off_the_mask_are_not_seen(prior: PocketPrior) -> None:
    shown = sphere(1)
    dirty = shown["normal"] + (1 - shown["mask"])
    assert torch.equal(prior.encode_geometry(shown), prior.encode_geometry({**shown, "normal": dirty}))


def test_epsilon_from_v_by_hand(tmp_path: Path) -> None:
    """With v = 0.5 and x_t = 0.2 at t = 1/3: alpha = sqrt(3)/2, sigma = 1/2, x0 = -0.0768, epsilon = 0.533."""
    prior = PocketPrior(save_tiny(tmp_path / "tiny.safetensors", v=0.5))
    text = prior.encode_text(["anything"])
    alpha, sigma = math.sqrt(3) / 2, 0.5
    got = prior.predict_noise(torch.full((1, 8, 32, 32), 0.2), 1 / 3, text)
    x0 = alpha * 0.2 - sigma * 0.5
    torch.testing.assert_close(got, torch.full_like(got, (0.2 - alpha * x0) / sigma), atol=1e-5, rtol=0)
    assert got[0, 0, 0, 0] == pytest.approx(sigma * 0.2 + alpha * 0.5, abs=1e-5)  # the same, from the definition of v


def test_the_clean_image_is_clipped(tmp_path: Path) -> None:
    prior = PocketPrior(save_tiny(tmp_path / "tiny.safetensors", v=-4.0))
    alpha, sigma = math.sqrt(3) / 2, 0.5
    got = prior.predict_noise(torch.full((1, 8, 32, 32), 0.2), 1 / 3, prior.encode_text(["anything"]))
    assert got[0, 0, 0, 0] == pytest.approx((0.2 - alpha * 1.0) / sigma, abs=1e-5)


def test_words_and_hashes() -> None:
    assert split_words("A Hand-carved, 1930s toy_cow!", 24) == ["a", "hand", "carved", "1930s", "toy", "cow"]
    assert len(split_words("word " * 40, 24)) == 24
    word, grams = hash_word("ox", TINY)
    assert word == zlib.crc32(b"ox") % 64
    assert grams == sorted(zlib.crc32(b"#" + g) % 64 for g in (b"<ox", b"ox>", b"<ox>"))


def test_word_order_and_unknown_words_matter(prior: PocketPrior) -> None:
    text = prior.encode_text(["red cow blue", "blue cow red", "", "qxzzt", "wvvkj"])
    assert (text[0, 0] - text[1, 0]).abs().max() > 1e-2, "in the summary too"
    assert (text[3] - text[4]).abs().max() > 1e-3
    assert text[2, 1:].abs().max() == 0


def test_bfloat16_points_the_same_way(prior: PocketPrior) -> None:
    half = PocketPrior.load(dtype="bfloat16")
    x = torch.randn(2, 8, 32, 32, generator=torch.Generator().manual_seed(1))
    shown, text = prior.encode_geometry(sphere(2)), prior.encode_text(["polished gold", "red plastic"])
    a, b = (p.predict_noise(x, 0.6, text, shown) for p in (prior, half))
    assert torch.nn.functional.cosine_similarity(a.flatten(), b.flatten(), dim=0) > 0.999


@pytest.mark.parametrize("content", [b"", b"garbage", b"\x08\0\0\0\0\0\0\0{}      "])
def test_a_bad_weights_file_is_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "bad.safetensors"
    path.write_bytes(content)
    with pytest.raises(PriorError, match=r"bad\.safetensors") as caught:
        PocketPrior(path)
    assert caught.value.code == "prior.weights"


def test_missing_weights_and_channels(tmp_path: Path, prior: PocketPrior) -> None:
    with pytest.raises(PriorError, match="no weights at") as caught:
        PocketPrior(tmp_path / "none.safetensors")
    assert caught.value.code == "prior.missing"
    with pytest.raises(PriorError, match="'metallic' is missing"):
        prior.encode_image(make_channels(("shaded", "base_color", "roughness"), 1, 32))
    with pytest.raises(PriorError, match="no precision 'float8'"):
        PocketPrior.load(dtype="float8")


#: Prompts and their true base colours, linear.
PLAIN = {
    "red plastic": (0.63, 0.01, 0.01), "blue plastic": (0.01, 0.07, 0.58), "green plastic": (0.01, 0.32, 0.04),
    "polished gold": (1.0, 0.71, 0.29), "white porcelain": (0.86, 0.83, 0.79), "black rubber": (0.01, 0.01, 0.01),
}  # fmt: skip


@pytest.fixture(scope="module")
def samples(prior: PocketPrior) -> dict[str, Tensor]:
    """Mean stack (8,) of one sample for each plain prompt and for one that is not what its first word says."""
    prompts = [*PLAIN, "gold coloured plastic"]
    return dict(zip(prompts, denoise(prior, prompts), strict=True))


def test_it_knows_plain_materials(samples: dict[str, Tensor]) -> None:
    """Each nearest to its own colour; gold metallic and smooth, the others not metal."""
    targets = torch.tensor(list(PLAIN.values()))
    found = torch.stack([samples[name] for name in PLAIN])
    nearest = torch.cdist(decode_srgb(found[:, 3:6]), targets).argmin(1)
    assert nearest.tolist() == list(range(6))
    others = [float(samples[name][7]) for name in PLAIN if name != "polished gold"]
    assert float(samples["polished gold"][7]) - max(others) > 0.5
    assert samples["black rubber"][6] - samples["polished gold"][6] > 0.3


def test_metal_is_told_from_its_colour_word(samples: dict[str, Tensor]) -> None:
    gold, paint = samples["polished gold"], samples["gold coloured plastic"]
    assert gold[7] - paint[7] > 0.5
    assert paint[3] > paint[4] > paint[5], "as gold: red over green over blue"


def test_guidance_pulls_a_grey_ball_towards_gold(prior: PocketPrior) -> None:
    """One SDS gradient, averaged over noise levels, on a half metallic grey: metalness and red up, blue below red."""
    shown = sphere(1)
    grey = {"shaded": 0.5, "base_color": 0.5, "roughness": 0.5, "metallic": 0.5}
    channels = {k: torch.full((1, 64, 64, 3 if k in ("shaded", "base_color") else 1), v) for k, v in grey.items()}
    x, geometry = prior.encode_image(channels), prior.encode_geometry(shown)
    text, none = prior.encode_text(["polished gold"]), prior.encode_text([""])
    generator = torch.Generator().manual_seed(3)
    total = torch.zeros_like(x)
    for t in (0.5, 0.6, 0.7, 0.8, 0.9):
        noise = torch.randn(x.shape, generator=generator)
        total += sds_gradient(prior, x, text, none, t, noise, 7.5, geometry)[0]
    inside = geometry[:, 3:4] > 0.9
    push = -(total * inside).sum((0, 2, 3)) / inside.sum()  # descent direction
    assert push[7] > 0, "more metallic"
    assert push[6] < 0, "smoother"
    assert push[3] > push[5] + 0.05, "more red than blue"


def test_a_word_that_no_caption_held_is_read_as_one_that_did(prior: PocketPrior) -> None:
    assert prior.readings("a polished gold ocelot") == {"ocelot": "leopard"}
    assert prior.readings("a polished gold leopard") == {}
    unknown, known = prior.encode_text(["ocelot fur", "leopard fur"])
    assert torch.equal(unknown, known)


def test_patterns_lie_where_they_were_taught(prior: PocketPrior) -> None:
    """At the greatest noise only text and place are left: stripes of a zebra follow the place, not the picture."""
    shown = prior.encode_geometry(sphere(1))
    x = torch.randn(2, 8, 32, 32, generator=torch.Generator().manual_seed(5))
    text = prior.encode_text(["a zebra"])
    clean = []
    for noise in x.split(1):
        epsilon = prior.predict_noise(noise, 0.98, text, shown)
        alpha, sigma = math.cos(0.98 * math.pi / 2), math.sin(0.98 * math.pi / 2)
        clean.append(((noise - sigma * epsilon) / alpha)[:, 3:6].mean(1)[shown[:, 3] > 0.9])
    assert torch.corrcoef(torch.stack(clean))[0, 1] > 0.8
    assert clean[0].std() > 0.4, "black and white, not grey"
