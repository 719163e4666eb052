"""FID and KID against other implementations of their formulas, and what their authors promise of them."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
import torch
from torch import Tensor

from paintit.errors import PaintitError
from paintit.evaluate.distances import cmmd, fid, kid
from paintit.evaluate.features import load_network


@pytest.fixture(scope="module")
def features() -> tuple[Tensor, Tensor]:
    """Features (180, 128) of two kinds of picture: coloured noise that is fine, and that is coarse."""
    generator = torch.Generator().manual_seed(0)
    network = load_network("pocket")

    def read(cells: int) -> Tensor:
        noise = torch.rand(180, 3, cells, cells, generator=generator)
        images = torch.nn.functional.interpolate(noise, (64, 64), mode="nearest")
        return network.features((images * 255).to(torch.uint8))

    return read(64), read(16)


def by_square_root(real: Tensor, made: Tensor) -> float:
    """The formula as it is printed, with scipy's matrix square root.

    A feature that never changes in one of the sets adds nothing to the root, and would make it singular.
    """
    a, b = real.double().numpy(), made.double().numpy()
    of_a, of_b = np.cov(a, rowvar=False), np.cov(b, rowvar=False)
    moves = np.ix_(*[np.minimum(of_a.diagonal(), of_b.diagonal()) > 1e-9] * 2)
    root = scipy.linalg.sqrtm(of_a[moves] @ of_b[moves])
    return float(((a.mean(0) - b.mean(0)) ** 2).sum() + np.trace(of_a) + np.trace(of_b) - 2 * np.trace(root.real))


def by_sums(real: Tensor, made: Tensor) -> float:
    """KID's formula, pair by pair, without the pairs of a picture with itself."""
    a, b = real.double().numpy(), made.double().numpy()
    kernel = lambda x, y: float(x @ y / len(x) + 1) ** 3  # noqa: E731
    within = [np.mean([kernel(x[i], x[j]) for i in range(len(x)) for j in range(len(x)) if i != j]) for x in (a, b)]
    return float(sum(within) - 2 * np.mean([kernel(x, y) for x in a for y in b]))


def test_a_set_is_at_no_distance_from_itself(features: tuple[Tensor, Tensor]) -> None:
    one, other = features
    assert abs(fid(one, one)) < 1e-6 * fid(one, other)
    assert abs(cmmd(one, one)) < 1e-9


def test_fid_is_the_printed_formula(features: tuple[Tensor, Tensor]) -> None:
    assert fid(*features) == pytest.approx(by_square_root(*features), rel=1e-4, abs=1e-4)
    assert fid(*features) == pytest.approx(fid(*reversed(features)), rel=1e-6)


def test_fid_of_gaussians_is_known() -> None:
    generator = torch.Generator().manual_seed(1)
    x = torch.randn(200_000, 3, generator=generator, dtype=torch.float64)
    # Deviations 1 and (1, 2, 3), means apart by (3, 0, 4): 25 + 0 + 1 + 4.
    moved = x * torch.tensor([1.0, 2.0, 3.0]) + torch.tensor([3.0, 0.0, 4.0])
    assert fid(x, moved) == pytest.approx(30, rel=0.01)


def test_kid_is_the_printed_formula(features: tuple[Tensor, Tensor]) -> None:
    one, other = (x[:40] for x in features)
    assert kid(one, other) == pytest.approx(by_sums(one, other), rel=1e-9)


def test_kid_of_two_halves_is_zero_on_average_and_fid_is_not(features: tuple[Tensor, Tensor]) -> None:
    generator = torch.Generator().manual_seed(2)
    halves = [features[0][torch.randperm(180, generator=generator)].chunk(2) for _ in range(60)]
    kids = np.array([kid(*pair) for pair in halves])
    assert abs(kids.mean()) < 3 * kids.std() / len(kids) ** 0.5
    assert kids.min() < 0 < kids.max()
    quarters = [(one[:45], other[:45]) for one, other in halves[:5]]
    assert np.mean([fid(*pair) for pair in quarters]) > 1.3 * np.mean([fid(*pair) for pair in halves[:5]]) > 0


def test_subsets_are_drawn_alike_every_time_and_from_no_shared_generator(features: tuple[Tensor, Tensor]) -> None:
    one, other = features[0], features[1][:100]
    before = torch.get_rng_state()
    assert kid(one, other) == kid(one, other)
    assert torch.equal(torch.get_rng_state(), before)


def test_cmmd_of_two_points_is_known() -> None:
    one, other = torch.tensor([[1.0, 0.0]] * 2), torch.tensor([[0.0, 3.0]] * 2)
    # Unit vectors at right angles: squared distance 2, kernel exp(-2 / 200).
    assert cmmd(one, other) == pytest.approx(1000 * (2 - 2 * np.exp(-0.01)))


def test_what_cannot_be_compared_is_refused() -> None:
    with pytest.raises(PaintitError, match=r"\(1, 4\) and \(5, 4\) cannot be compared; give at least two"):
        fid(torch.zeros(1, 4), torch.zeros(5, 4))
    with pytest.raises(PaintitError, match="same network"):
        kid(torch.zeros(5, 4), torch.zeros(5, 3))
