"""Laws of systematic resampling and of the effective sample size."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.belief.resampling import effective_sample_size, systematic_indices


def _counts(weights: np.ndarray, u: float, draws: int) -> np.ndarray:
    chosen = np.empty(draws, np.int64)
    systematic_indices(weights, u, chosen)
    return np.bincount(chosen, minlength=len(weights))


def _weights(count: int, seed: int) -> np.ndarray:
    weights = np.random.default_rng(seed).gamma(0.5, size=count)
    return weights / weights.sum()


@pytest.mark.parametrize(("count", "draws"), [(50, 50), (50, 20), (20, 160), (3, 1)])
def test_every_particle_is_drawn_floor_or_ceil_of_its_share(count: int, draws: int) -> None:
    weights = _weights(count, 1)
    for u in np.linspace(0.0, 1.0, 37, endpoint=False):
        counts = _counts(weights, u, draws)
        assert counts.sum() == draws
        assert np.all(counts >= np.floor(draws * weights - 1e-9))
        assert np.all(counts <= np.ceil(draws * weights + 1e-9))


def test_draws_are_unbiased() -> None:
    """The mean count over a fine comb of u is N w, exact to the comb: counts are step functions of u."""
    weights, comb = _weights(30, 2), 4000
    mean = np.mean([_counts(weights, (i + 0.5) / comb, 30) for i in range(comb)], axis=0)
    np.testing.assert_allclose(mean, 30 * weights, atol=2.0 / comb)


def test_equal_weights_keep_every_particle_once() -> None:
    assert np.array_equal(_counts(np.full(100, 0.01), 0.37, 100), np.ones(100))


def test_all_weight_on_one_particle() -> None:
    weights = np.zeros(5)
    weights[3] = 1.0
    assert np.array_equal(_counts(weights, 0.999, 8), [0, 0, 0, 8, 0])


def test_effective_sample_size_runs_from_one_to_n() -> None:
    assert effective_sample_size(np.full(40, 1 / 40)) == pytest.approx(40)
    assert effective_sample_size(np.array([0.0, 1.0, 0.0])) == pytest.approx(1)
    assert effective_sample_size(np.array([0.5, 0.5, 0.0])) == pytest.approx(2)
