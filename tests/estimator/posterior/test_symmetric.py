"""Packed symmetric matrices against NumPy's own routines."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.posterior.symmetric_matrices import dot, inverse, pack, product, row_sums, total
from metric_base.arrays import FloatArray


def unpacked(six: FloatArray) -> FloatArray:
    """(m, 3, 3) of packed matrices (6, m)."""
    return six[(0, 1, 2, 1, 3, 4, 2, 4, 5), :].T.reshape(-1, 3, 3)


@pytest.fixture
def matrices() -> FloatArray:
    """Twenty positive ones."""
    factors = np.random.default_rng(3).normal(size=(20, 3, 3))
    return np.asarray(factors @ factors.transpose(0, 2, 1) + 0.1 * np.eye(3))


def test_packing_is_undone(matrices: FloatArray) -> None:
    assert np.array_equal(unpacked(pack(matrices)), matrices)


def test_inverse_and_determinant(matrices: FloatArray) -> None:
    found, log_det = inverse(pack(matrices))
    assert unpacked(np.array(found)) == pytest.approx(np.linalg.inv(matrices))
    assert log_det == pytest.approx(np.linalg.slogdet(matrices)[1])


def test_products(matrices: FloatArray) -> None:
    vectors = np.random.default_rng(4).normal(size=(3, 5, 20))
    expected = np.einsum("mij,jkm->ikm", matrices, vectors)
    assert np.array(product(pack(matrices), vectors)) == pytest.approx(expected)
    assert np.array(row_sums(pack(matrices))) == pytest.approx(matrices.sum(axis=2).T)
    assert total(vectors) == pytest.approx(vectors.sum(axis=0))
    assert dot(vectors, vectors) == pytest.approx((vectors**2).sum(axis=0))
