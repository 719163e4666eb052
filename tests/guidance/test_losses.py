"""Every loss against its formula on Gaussian data, where all that a prior can say is known in closed form.

All pictures of the prior are mu + w for the word w, a number: e(w) = epsilon + (alpha / sigma) (x - mu - w), and each
loss comes down to a line of arithmetic; at t = 1/2 alpha and sigma are equal, and m is 1/2.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import pytest
import torch
from tests.guidance.contract import make_channels
from torch import Tensor

from paintit.config import GuidanceConfig, OptimConfig, PaintConfig, TextureConfig, ViewConfig, preset
from paintit.errors import PriorError, UsageError
from paintit.guidance import losses
from paintit.guidance.exact import ExactPrior
from paintit.guidance.load import load_prior
from paintit.guidance.losses import LOSSES, Words, distil, perpendicular, rescaled
from paintit.guidance.prompt import Prompts
from paintit.guidance.schedule import choose_t
from paintit.guidance.sds import SdsRecord, sds_gradient
from paintit.mesh.read import read_mesh
from paintit.paint import checkpoint
from paintit.paint.painter import Painter
from paintit.render.light import load_environment, prefilter
from paintit.run.plan import plan
from paintit.run.request import Request
from paintit.settings import merge

SHAPE = (2, 5, 3, 3)
#: What the words mean: the prompt, the negative one, the empty one, the source.
TEXT, NEGATIVE, EMPTY, SOURCE = 0.5, -0.25, 0.125, 0.75


class WordedPrior(ExactPrior):
    """Exact, with a word that adds itself to the mean of all pixels; ``flow``: on the straight path."""

    def __init__(self, flow: bool = False) -> None:
        super().__init__()
        self.flow = flow
        self.batches: list[tuple[int, float]] = []

    def encode_text(self, prompts: Sequence[str]) -> Tensor:
        return torch.tensor([[sum(map(ord, prompt)) % 64 / 64] for prompt in prompts])

    def alpha_sigma(self, t: float) -> tuple[float, float]:
        return (1 - t, t) if self.flow else super().alpha_sigma(t)

    def predict_noise(self, x_t: Tensor, t: float, text: Tensor, geometry: Tensor | None = None) -> Tensor:
        assert geometry is not None
        self.batches.append((len(x_t), t))
        return super().predict_noise(x_t, t, text, geometry + text[:, :, None, None])


def draw(seed: int) -> Tensor:
    return torch.randn(SHAPE, generator=torch.Generator().manual_seed(seed))


MU, NOISE = draw(1), draw(2)[:1]


def ask(
    loss: str,
    *,
    away: float | Tensor = 0.0,
    t: float = 0.5,
    scale: float = 3.0,
    progress: float = 0.9,
    words: tuple[float, ...] = (TEXT, NEGATIVE, EMPTY, SOURCE),
    prior: WordedPrior | None = None,
    rescale: float = 0.0,
    perp_neg: bool = False,
) -> tuple[Tensor, SdsRecord, WordedPrior]:
    """The loss on an image that is ``away`` from mu."""
    prior = prior or WordedPrior(flow=loss == "rfds")
    guidance = GuidanceConfig(loss=loss, rescale=rescale, perp_neg=perp_neg)  # type: ignore[arg-type]
    texts = Words(*(torch.full((SHAPE[0], 1), word) for word in words))
    gradient, record = distil(guidance, prior, MU + away, texts, t, NOISE, scale, progress, MU)
    return gradient, record, prior


@pytest.mark.parametrize(
    ("loss", "t", "expected"),
    [
        # away 1; m alpha / sigma = 1/2; the guided mean -1/4 + 3 * 3/4 = 2
        ("sds", 0.5, 0.5 * (1 - 2)),
        # 1/2 * 3 * (-1/4 - 1/2): the image itself does not matter
        ("csd", 0.5, 0.5 * 3 * -0.75),
        # d = mu(negative) - mu(empty) = -3/8, and 3 * (1/8 - 1/2) = -9/8
        ("nfsd", 0.5, 0.5 * (-0.375 - 1.125)),
        # 3 * (3/4 - 1/2)
        ("bridge", 0.5, 0.5 * 3 * 0.25),
        # v - (epsilon - x) = (away - guided mean) / t
        ("rfds", 0.5, (1 - 2) / 0.5),
        ("rfds", 0.8, (1 - 2) / 0.8),
    ],
)
def test_each_loss_is_its_formula(loss: str, t: float, expected: float) -> None:
    gradient, record, _ = ask(loss, away=1.0, t=t)
    torch.testing.assert_close(gradient, torch.full(SHAPE, expected), atol=1e-5, rtol=1e-5)
    assert record.gradient_norm == pytest.approx(abs(expected) * math.sqrt(MU.numel()), rel=1e-5)
    assert record.weight == pytest.approx(1.0 if loss == "rfds" else 0.5)
    assert record.nonfinite == 0


def test_asd_takes_away_the_prediction_of_a_higher_level() -> None:
    # t' = 0.5 + 0.1 * 0.48 = 0.548; e_s - e' = (1 - 2) cot(pi t / 2) - (1 - 1/2) cot(pi t' / 2)
    gradient, _, prior = ask("asd", away=1.0)
    expected = 0.5 * (-1.0 - 0.5 / math.tan(math.pi / 2 * 0.548))
    torch.testing.assert_close(gradient, torch.full(SHAPE, expected), atol=1e-5, rtol=1e-5)
    assert [t for _, t in prior.batches] == [0.5, pytest.approx(0.548)]
    assert ask("asd", t=1.0)[2].batches[-1][1] == 1.0, "there is no level above the highest"
    assert ask("asd", t=0.01)[2].batches[-1][1] == 0.01, "nor a shift below the lowest"


def test_nfsd_drops_the_negative_prompt_where_there_is_little_noise() -> None:
    # m (epsilon + (alpha / sigma) (away - mu(empty) + 3 * (mu(empty) - mu(text)))) below t = 0.2
    alpha, sigma = math.cos(math.pi / 2 * 0.1), math.sin(math.pi / 2 * 0.1)
    gradient, _, prior = ask("nfsd", away=1.0, t=0.1)
    expected = sigma**2 * (NOISE + alpha / sigma * (1 - 0.125 - 1.125)).expand(SHAPE)
    torch.testing.assert_close(gradient, expected, atol=1e-5, rtol=1e-5)
    assert prior.batches == [(4, 0.1)]
    assert ask("nfsd", t=0.2)[2].batches == [(6, 0.2)]


def test_the_bridge_is_sds_in_the_first_half() -> None:
    assert torch.equal(ask("bridge", away=1.0, progress=0.49)[0], ask("sds", away=1.0, progress=0.49)[0])
    assert not torch.equal(ask("bridge", away=1.0, progress=0.5)[0], ask("sds", away=1.0, progress=0.5)[0])


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("t", [0.25, 0.5, 0.9])
def test_nothing_is_left_to_do_at_the_optimum_when_words_do_not_matter(loss: str, t: float) -> None:
    """The image is mu + w, and every text means w: each loss has done its work."""
    gradient, _, _ = ask(loss, away=0.5, t=t, words=(0.5,) * 4)
    torch.testing.assert_close(gradient, torch.zeros(SHAPE), atol=2e-5, rtol=0)


@pytest.mark.parametrize("loss", ["csd", "nfsd", "bridge"])
def test_without_words_these_say_nothing_wherever_the_image_is(loss: str) -> None:
    gradient, record, _ = ask(loss, away=draw(3), words=(0.5,) * 4)
    torch.testing.assert_close(gradient, torch.zeros(SHAPE), atol=1e-5, rtol=0)
    assert record.text_norm == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize(
    ("loss", "batches"),
    [("sds", [4]), ("csd", [4]), ("nfsd", [6]), ("bridge", [4]), ("asd", [4, 2]), ("rfds", [4])],
)
def test_calls_of_the_model_are_as_documented(loss: str, batches: list[int]) -> None:
    assert [count for count, _ in ask(loss)[2].batches] == batches
    if loss in ("sds", "csd", "asd", "rfds"):
        assert [count for count, _ in ask(loss, perp_neg=True)[2].batches] == [6, *batches[1:]]


def test_a_scale_of_one_needs_the_text_alone_but_for_perpendicular_negatives() -> None:
    assert ask("sds", scale=1.0)[2].batches == [(2, 0.5)]
    assert ask("csd", scale=1.0)[2].batches == [(4, 0.5)]
    assert ask("sds", scale=1.0, perp_neg=True)[2].batches == [(6, 0.5)]


def test_sds_is_the_readable_one_bit_for_bit() -> None:
    prior = load_prior("pocket")
    x = torch.randn(2, 8, 32, 32, generator=torch.Generator().manual_seed(8))
    geometry = prior.encode_geometry(make_channels(prior.sees, 2, 32))
    noise = torch.randn(1, 8, 32, 32, generator=torch.Generator().manual_seed(3))
    text, negative = prior.encode_text(["red plastic", "gold"]), prior.encode_text(["rust"] * 2)
    for scale in (1.0, 7.5):
        plain = sds_gradient(prior, x, text, negative, 0.7, noise, scale, geometry)
        ours = distil(GuidanceConfig(), prior, x, Words(text, negative), 0.7, noise, scale, 0.3, geometry)
        assert torch.equal(ours[0], plain[0])
        assert ours[1] == plain[1]


def test_what_is_not_finite_is_left_out_and_counted() -> None:
    away = torch.zeros(SHAPE)
    away[0, 0, 0, 0], away[1, 2, 1, 1] = math.nan, math.inf
    gradient, record, _ = ask("sds", away=away)
    assert record.nonfinite == 2
    assert gradient[0, 0, 0, 0] == gradient[1, 2, 1, 1] == 0
    assert gradient.isfinite().all()


def test_rfds_needs_the_straight_path_and_has_an_end_at_pure_noise() -> None:
    losses.require(WordedPrior(flow=True), "rfds")
    for loss in set(LOSSES) - {"rfds"}:
        losses.require(WordedPrior(), loss)
    with pytest.raises(PriorError) as caught:
        losses.require(ExactPrior(), "rfds")
    assert str(caught.value) == (
        "the loss 'rfds' is for flow models, and the prior 'exact' is none; choose --guidance.loss sds, or a flow model"
    )
    assert ask("rfds", away=1.0, t=1.0)[0].abs().max() < 1e-2


def test_perpendicular_takes_away_exactly_the_parallel_part() -> None:
    a, b = draw(4), draw(5)
    left = perpendicular(a, b)
    assert (left * b).flatten(1).sum(1).abs().max() < 1e-5
    taken = a - left
    torch.testing.assert_close((taken * b).flatten(1).sum(1) ** 2,
                               (taken.square().flatten(1).sum(1) * b.square().flatten(1).sum(1)))  # fmt: skip
    torch.testing.assert_close(perpendicular(3 * b, b), torch.zeros(SHAPE), atol=1e-5, rtol=0)
    assert torch.equal(perpendicular(a, torch.zeros(SHAPE)), a)
    # (3, 4) without its part along (1, 0)
    assert perpendicular(torch.tensor([[3.0, 4.0]]), torch.tensor([[2.0, 0.0]])).tolist() == [[0.0, 4.0]]


def test_a_negative_prompt_that_says_what_the_prompt_says_is_ignored_by_perp_neg() -> None:
    # All words move all pixels alike, so every negative one is parallel: what stays is guidance from the empty prompt,
    # mean 1/8 + 3 * 3/8 = 5/4; plain SDS has 2.
    gradient, record, _ = ask("sds", away=1.0, perp_neg=True)
    torch.testing.assert_close(gradient, torch.full(SHAPE, 0.5 * (1 - 1.25)), atol=1e-5, rtol=1e-5)
    assert record.text_norm == pytest.approx(0.375 * math.sqrt(MU.numel()), rel=1e-4)


def test_perp_neg_keeps_the_perpendicular_part() -> None:
    class Halves(WordedPrior):
        """The negative word moves the left column alone, by as much as a word of ``TEXT`` moves all."""

        def predict_noise(self, x_t: Tensor, t: float, text: Tensor, geometry: Tensor | None = None) -> Tensor:
            assert geometry is not None
            where = torch.ones(1, 1, 1, 3).repeat(len(text), 1, 1, 1)
            where[text[:, 0] == NEGATIVE] = torch.tensor([-2.0, 0, 0])
            return ExactPrior.predict_noise(self, x_t, t, text, geometry + text[:, :, None, None] * where)

    # p = -(1/2) everywhere, q = -(1/2, 0, 0); q's part along p is -1/6 everywhere: d = p - (-1/3, 1/6, 1/6)
    gradient, _, _ = ask("csd", words=(0.5, NEGATIVE, 0.0, 0.0), prior=Halves(), perp_neg=True, scale=1.0)
    expected = 0.5 * torch.tensor([-1 / 2 + 1 / 3, -1 / 2 - 1 / 6, -1 / 2 - 1 / 6])
    torch.testing.assert_close(gradient, expected.expand(SHAPE), atol=1e-5, rtol=1e-5)


def test_rescale_keeps_the_spread_of_the_unguided_prediction() -> None:
    guided, with_text = 4 * draw(6) + 1, 0.5 * draw(7)
    spread = with_text.std((1, 2, 3))
    torch.testing.assert_close(rescaled(guided, with_text, 1.0).std((1, 2, 3)), spread)
    half = rescaled(guided, with_text, 0.5).std((1, 2, 3))
    torch.testing.assert_close(half, (guided.std((1, 2, 3)) + spread) / 2)
    assert rescaled(guided, with_text, 0.0) is guided
    assert rescaled(torch.zeros(SHAPE), with_text, 1.0).abs().max() == 0


def test_rescale_reaches_the_gradient() -> None:
    # e(text) = noise + away - 1/2 and e_s = noise + away - 2 (alpha = sigma), the latter scaled to the former's spread
    away = draw(8)
    text, guided = NOISE + away - 0.5, NOISE + away - 2
    gradient, _, _ = ask("sds", away=away, rescale=1.0)
    ratio = text.std((1, 2, 3), keepdim=True) / guided.std((1, 2, 3), keepdim=True)
    torch.testing.assert_close(gradient, 0.5 * (guided * ratio - NOISE), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("schedule", ["paper", "official"])
def test_non_increasing_timesteps_never_rise_and_cover_the_range(schedule: str) -> None:
    guidance = GuidanceConfig(timesteps="non-increasing", schedule=schedule)  # type: ignore[arg-type]
    generator = torch.Generator().manual_seed(0)
    before = generator.get_state()
    levels = [choose_t(guidance, step / 99, generator) for step in range(100)]
    assert levels == sorted(levels, reverse=True)
    assert len(set(levels)) == 100
    assert (levels[0], levels[-1]) == (0.98, 0.3)
    assert torch.equal(generator.get_state(), before)
    middle = 0.98 - 0.68 * (math.sqrt(33 / 99) if schedule == "official" else 33 / 99)
    assert levels[33] == pytest.approx(middle)


def test_random_timesteps_are_drawn_from_the_narrowing_range() -> None:
    generator = torch.Generator().manual_seed(0)
    levels = [choose_t(GuidanceConfig(), 1.0, generator) for _ in range(200)]
    assert min(levels) >= 0.3
    assert max(levels) <= 0.5
    assert len(set(levels)) == 200


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"guidance.loss": "vsd"}, "'guidance.loss' is 'vsd'; did you mean 'sds'?"),
        ({"guidance.rescale": 1.5}, "guidance.rescale is 1.5; it must be from 0 to 1"),
        (
            {"guidance.loss": "csd", "guidance.rescale": 0.7},
            "guidance.rescale is 0.7; it must be 0 with csd, which forms no guided prediction",
        ),
        (
            {"guidance.loss": "nfsd", "guidance.perp_neg": True},
            "guidance.perp_neg is true; it must be false with nfsd, which has its own use of negative words",
        ),
        (
            {"guidance.loss": "nfsd"},
            'prompt.negative is ""; nfsd needs words to move away from: \'unrealistic, blurry, low quality, out of '
            "focus, ugly, low contrast, dull, dark, low-resolution, gloomy'",
        ),
        ({"guidance.loss": "bridge", "prompt.source": " "}, 'prompt.source is " "; bridge needs words for how'),
        (
            {"guidance.timesteps": "non-increasing", "guidance.t_start": [0.1, 0.2], "guidance.t_end": [0.3, 0.4]},
            "guidance.t_end is [0.3, 0.4]; with non-increasing timesteps its lowest must not be above 0.2",
        ),
    ],
)
def test_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(UsageError) as caught:
        merge(preset("pocket"), changes)
    assert str(caught.value).startswith(message)


def with_loss(loss: str, **changes: object) -> PaintConfig:
    base = dataclasses.replace(
        preset("pocket"),
        texture=TextureConfig(kind="pixels", size=32),
        views=ViewConfig(size=16, count=2),
        optim=OptimConfig(steps=4, lr=0.1),
    )
    guidance = {"guidance.loss": loss, "guidance.t_start": [0.15, 0.9], "guidance.t_end": [0.15, 0.9]}
    return merge(base, {"prompt.negative": "dull", **guidance, **changes})


#: Every loss, and what may be combined with one.
SETTINGS = {
    **{loss: with_loss(loss) for loss in LOSSES},
    "rescale": with_loss("sds", **{"guidance.rescale": 0.7}),
    "perp-neg": with_loss("sds", **{"guidance.perp_neg": True}),
    "non-increasing": with_loss("sds", **{"guidance.timesteps": "non-increasing"}),
}


def test_the_texts_of_a_loss_are_sent_and_no_others() -> None:
    base = {"dull", "gold"}
    assert set(Prompts.of("gold", SETTINGS["sds"]).distinct()) == base
    for name in ("nfsd", "perp-neg"):
        assert set(Prompts.of("gold", SETTINGS[name]).distinct()) == {*base, ""}
    source = f"gold, {SETTINGS['bridge'].prompt.source}"
    assert set(Prompts.of("gold", SETTINGS["bridge"]).distinct()) == {*base, source}
    projects = dataclasses.replace(SETTINGS["bridge"], method="projection")
    assert set(Prompts.of("gold", projects).distinct()) == base


@pytest.fixture(scope="module")
def spot(assets):
    return read_mesh(assets / "meshes/spot/spot.obj")


@pytest.fixture(scope="module")
def light():
    return prefilter(load_environment("default", 0.7), torch.device("cpu"))


@pytest.mark.parametrize("name", SETTINGS)
def test_each_paints_and_resumes_bit_for_bit(spot, light, tmp_path, name):
    config = SETTINGS[name]
    prior = WordedPrior(flow=name == "rfds")
    whole, first, second = (Painter(spot, "gold", config, prior, light) for _ in range(3))
    start = whole.maps().packed()
    steps = list(whole)
    assert all(math.isfinite(step.gradient_norm) and step.guidance_norm > 0 for step in steps)
    assert not torch.equal(whole.maps().packed(), start)
    for step in first:
        if step.index == 2:
            break
    checkpoint.save(tmp_path / "last.safetensors", first)
    checkpoint.load(tmp_path / "last.safetensors", second)
    list(second)
    assert torch.equal(second.maps().packed(), whole.maps().packed())


def test_a_prior_that_cannot_serve_the_loss_is_refused_before_the_first_step(spot, light):
    with pytest.raises(PriorError, match="the loss 'rfds' is for flow models, and the prior 'exact' is none"):
        Painter(spot, "gold", SETTINGS["rfds"], ExactPrior(), light)


def test_the_plan_tells_the_texts_of_the_loss(assets, tmp_path):
    mesh, output = assets / "meshes/spot/spot.obj", str(tmp_path / "out.glb")
    request = Request(mesh=mesh, prompt="gold", output=output, config=SETTINGS["bridge"])
    assert f"gold, {SETTINGS['bridge'].prompt.source}" in plan(request)["prompts"]
