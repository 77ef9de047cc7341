"""The Gaussian fit against numpy, and the divergence against numerical integration and linear algebra."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate, stats

from baselines.belief.gaussian_fit import COVARIANCE_FLOOR, fit_gaussian, kl_divergence, triangular_root


def _gaussian(mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    return np.concatenate([mean, np.asarray(covariance, dtype=np.float64).ravel()])


def _random_gaussian(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3)) * 3.0
    return _gaussian(rng.normal(size=3) * 5.0, root @ root.T + np.eye(3))


def test_fit_is_the_weighted_mean_and_covariance() -> None:
    rng = np.random.default_rng(0)
    points, weights = rng.normal(size=(3, 200)) * [[9.0], [2.0], [1.0]], rng.random(200)
    weights /= weights.sum()
    gaussian = np.empty(12)
    fit_gaussian(*points, weights, gaussian)
    np.testing.assert_allclose(gaussian[:3], points @ weights, rtol=1e-12)
    expected = np.cov(points, aweights=weights, bias=True)
    np.testing.assert_allclose(gaussian[3:].reshape(3, 3), expected, rtol=1e-10, atol=1e-12)


def test_root_times_its_transpose_is_the_covariance() -> None:
    gaussian, root = _random_gaussian(1), np.empty((3, 3))
    triangular_root(gaussian, 1e-12, root)
    np.testing.assert_allclose(root @ root.T, gaussian[3:].reshape(3, 3), rtol=1e-9)


def test_divergence_is_the_integral_of_the_log_ratio() -> None:
    """For axis-parallel Gaussians the divergence is a sum of one-dimensional integrals."""
    means, variances = np.array([[0.0, 1.0, -2.0], [1.0, 0.5, 0.0]]), np.array([[4.0, 1.0, 9.0], [2.0, 3.0, 5.0]])
    total = 0.0
    for axis in range(3):
        sigma = np.sqrt(variances[:, axis] + COVARIANCE_FLOOR)
        p, q = (stats.norm(means[i, axis], sigma[i]) for i in range(2))
        low, high = means[0, axis] - 12 * sigma[0], means[0, axis] + 12 * sigma[0]
        total += integrate.quad(lambda x, p=p, q=q: p.pdf(x) * (p.logpdf(x) - q.logpdf(x)), low, high, limit=200)[0]
    p, q = (_gaussian(means[i], np.diag(variances[i])) for i in range(2))
    assert kl_divergence(p, q) == pytest.approx(total, rel=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_divergence_equals_the_closed_form(seed: int) -> None:
    p, q = _random_gaussian(2 * seed), _random_gaussian(2 * seed + 1)
    floor = COVARIANCE_FLOOR * np.eye(3)
    s_p, s_q, shift = p[3:].reshape(3, 3) + floor, q[3:].reshape(3, 3) + floor, q[:3] - p[:3]
    inverse = np.linalg.inv(s_q)
    log_ratio = math.log(np.linalg.det(s_q) / np.linalg.det(s_p))
    expected = 0.5 * (np.trace(inverse @ s_p) + shift @ inverse @ shift - 3.0 + log_ratio)
    assert kl_divergence(p, q) == pytest.approx(expected, rel=1e-9)


def test_divergence_of_equals_is_zero_and_of_others_is_not_symmetric() -> None:
    p, q = _random_gaussian(20), _random_gaussian(21)
    assert kl_divergence(p, p) == pytest.approx(0.0, abs=1e-12)
    assert kl_divergence(p, q) > 0.0
    assert kl_divergence(p, q) != pytest.approx(kl_divergence(q, p), rel=1e-3)


@pytest.mark.parametrize("covariance", [np.zeros((3, 3)), np.diag([4.0, 0.0, 0.0]), np.ones((3, 3)), -1e-3 * np.eye(3)])
def test_divergence_survives_singular_and_rounded_covariances(covariance: np.ndarray) -> None:
    collapsed, wide = _gaussian(np.array([1.0, 2.0, 3.0]), covariance), _random_gaussian(3)
    for p, q in ((collapsed, wide), (wide, collapsed), (collapsed, collapsed)):
        divergence = kl_divergence(p, q)
        assert math.isfinite(divergence)
        assert divergence >= 0.0
