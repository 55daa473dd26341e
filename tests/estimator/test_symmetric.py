"""Packed symmetric matrices against NumPy's own routines."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.scene import FloatArray
from estimator.symmetric import inverse, packed, product, row_sums, unpacked


@pytest.fixture
def matrices() -> FloatArray:
    """Twenty positive ones."""
    factors = np.random.default_rng(3).normal(size=(20, 3, 3))
    return np.asarray(factors @ factors.transpose(0, 2, 1) + 0.1 * np.eye(3))


def test_packing_is_undone(matrices: FloatArray) -> None:
    assert np.array_equal(unpacked(packed(matrices)), matrices)


def test_inverse_and_determinant(matrices: FloatArray) -> None:
    found, log_det = inverse(packed(matrices))
    assert unpacked(found) == pytest.approx(np.linalg.inv(matrices))
    assert log_det == pytest.approx(np.linalg.slogdet(matrices)[1])


def test_products(matrices: FloatArray) -> None:
    vectors = np.random.default_rng(4).normal(size=(3, 5, 20))
    expected = np.einsum("mij,jkm->ikm", matrices, vectors)
    assert product(packed(matrices), vectors) == pytest.approx(expected)
    assert row_sums(packed(matrices)) == pytest.approx(matrices.sum(axis=2).T)
