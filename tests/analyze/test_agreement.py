"""Singular-value ratios of matrices that are made to have known ones."""

from __future__ import annotations

import pytest
import torch

from paintit.analyze.agreement import agreement


def made(singular: list[float], width: int, seed: int = 3) -> torch.Tensor:
    """(n, width) with these singular values: random orthonormal frames on both sides."""
    generator = torch.Generator().manual_seed(seed)
    n = len(singular)
    left, _ = torch.linalg.qr(torch.randn(n, n, generator=generator, dtype=torch.float64))
    right, _ = torch.linalg.qr(torch.randn(width, n, generator=generator, dtype=torch.float64))
    return (left * torch.tensor(singular, dtype=torch.float64)) @ right.T


def test_known_singular_values_come_back() -> None:
    found = agreement(made([8.0, 4.0, 2.0, 1.0, 0.5], 300).float())
    assert found.ratios == pytest.approx((16, 8, 4, 2, 1), rel=1e-4)
    assert found.singular == pytest.approx((8, 4, 2, 1, 0.5), rel=1e-4)
    assert found.rank == 5
    assert found.effective_rank == pytest.approx(85.25**2 / (4096 + 256 + 16 + 1 + 0.0625), rel=1e-4)


def test_the_papers_ratios_come_back() -> None:
    paper = (2.1868, 1.7937, 1.7838, 1.6689, 1.0)
    assert agreement(made(list(paper), 1000).float()).ratios == pytest.approx(paper, rel=1e-4)


def test_orthogonal_rows_of_equal_length() -> None:
    found = agreement(3 * torch.eye(5, 40))
    assert found.ratios == pytest.approx((1,) * 5)
    assert (found.effective_rank, found.cosine) == (pytest.approx(5), pytest.approx(0))


def test_one_row_repeated_has_rank_one_and_no_ratios() -> None:
    row = torch.randn(1, 500, generator=torch.Generator().manual_seed(0))
    found = agreement(row.expand(5, -1))
    assert (found.rank, found.ratios) == (1, ())
    assert (found.effective_rank, found.cosine) == (pytest.approx(1), pytest.approx(1))


def test_rounding_alone_is_no_rank() -> None:
    """A sum of two rows in float32 is in their span but for its last bits."""
    a, b = torch.randn(2, 4000, generator=torch.Generator().manual_seed(1))
    assert agreement(torch.stack([a, b, 0.3 * a + 0.7 * b])).rank == 2


def test_length_does_not_change_cosines() -> None:
    a, b = torch.tensor([1.0, 0.0, 0.0]), torch.tensor([1.0, 1.0, 0.0])
    assert agreement(torch.stack([a, 100 * b])).cosine == pytest.approx(0.5**0.5)


def test_nothing_but_zeros_is_refused() -> None:
    with pytest.raises(ValueError, match="zero"):
        agreement(torch.zeros(3, 4))
