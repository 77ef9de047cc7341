"""The exact reductions of eq 24 against the naive expectation, which forms every posterior."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from baselines.belief.information import LANES, expected_reductions, poisson_entropy
from baselines.belief.likelihood import HitModel, hit_model
from osl_env.plumes.hit_rate import HitRatePlume
from osl_env.sensors import PoissonCounter

WIND = np.array([0.4, -0.9, 0.0])


def _model(strength: float = 2.5, **sensor: float) -> HitModel:
    return hit_model(HitRatePlume(source_strength=strength), PoissonCounter(**sensor), WIND)


def _cloud(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    weights = rng.gamma(0.7, size=count)
    return rng.uniform(0.0, 1.0, (3, count)) * [[12.0], [10.0], [6.0]], weights / weights.sum()


def _reductions(points, weights, candidates, times, model, cumulative):
    information, distance = np.empty(len(candidates)), np.empty(len(candidates))
    expected_reductions(*points, weights, candidates, times, model, cumulative, information, distance)
    return information, distance


def _mean_hits(points: np.ndarray, candidate: np.ndarray, time: float, model: HitModel) -> np.ndarray:
    offset = candidate[:, None] - points
    r = np.maximum(np.linalg.norm(offset, axis=0), model.clamp_distance)
    drift = offset[0] * model.drift_x + offset[1] * model.drift_y
    rate = model.strength / r * np.exp(drift - r * model.inverse_lambda)
    return (rate * model.detection_probability + model.background) * time


def _naive(points, weights, candidate, time, model, most: int = 500) -> tuple[float, float]:
    """H - E[H'] and E[D'] with the posterior of every outcome written out (eqs 21, 22 and 24)."""
    means = _mean_hits(points, candidate, time, model)
    entropy, distance = 0.0, 0.0
    for d in range(most):
        joint = weights * stats.poisson.pmf(d, means)
        p = joint.sum()
        if p < 1e-300:
            continue
        posterior = joint / p
        kept = posterior[posterior > 0.0]
        entropy -= p * np.sum(kept * np.log(kept))
        distance += p * np.linalg.norm(candidate - points @ posterior)
    return -np.sum(weights * np.log(weights)) - entropy, distance


@pytest.mark.parametrize("strength", [0.1, 2.5, 40.0])
def test_reductions_equal_the_naive_expectation(strength: float) -> None:
    model = _model(strength, false_positive_rate=0.05, miss_probability=0.1)
    points, weights = _cloud(60, 3)
    rng = np.random.default_rng(4)
    candidates = rng.uniform(0.0, 8.0, (LANES + 5, 3))  # more than one block, and a block that is not full
    times = rng.choice([1.0, 3.0], len(candidates))
    information, distance = _reductions(points, weights, candidates, times, model, 1.0 - 1e-13)
    for k in range(0, len(candidates), 4):
        gain, expected_distance = _naive(points, weights, candidates[k], times[k], model)
        assert information[k] == pytest.approx(gain, rel=1e-8, abs=1e-10)
        assert distance[k] == pytest.approx(expected_distance, rel=1e-9)


def test_information_is_the_pages_form_with_the_poisson_entropy() -> None:
    model, (points, weights) = _model(), _cloud(80, 5)
    candidate = np.array([[5.0, 2.0, 3.0]])
    information, _ = _reductions(points, weights, candidate, np.ones(1), model, 1.0 - 1e-13)
    means = _mean_hits(points, candidate[0], 1.0, model)
    predictive = stats.poisson.pmf(np.arange(120)[:, None], means) @ weights
    entropy = -np.sum(predictive[predictive > 0] * np.log(predictive[predictive > 0]))
    assert information[0] == pytest.approx(entropy - weights @ poisson_entropy(means), rel=1e-8)


def test_a_smaller_cumulative_probability_leaves_little_out() -> None:
    """The outcomes left out have probability < 0.001 and can at most tell which particle it is."""
    model, (points, weights) = _model(), _cloud(100, 6)
    candidates = np.random.default_rng(7).uniform(0.0, 8.0, (26, 3))
    exact = _reductions(points, weights, candidates, np.ones(26), model, 1.0 - 1e-13)
    rough = _reductions(points, weights, candidates, np.ones(26), model, 0.999)
    surprise = -0.001 * math.log(weights.min())
    assert np.all(rough[0] <= exact[0] + 1e-12)
    assert np.all(rough[0] >= exact[0] - surprise)
    np.testing.assert_allclose(rough[1], exact[1], atol=0.001 * 16.0)  # m, the cloud's diameter
    assert np.any(rough[0] < exact[0])


def test_a_certain_belief_has_nothing_to_learn() -> None:
    points = np.array([[3.0], [4.0], [5.0]])
    information, distance = _reductions(points, np.ones(1), np.array([[3.0, 4.0, 1.0]]), np.ones(1), _model(), 0.999)
    assert information[0] == pytest.approx(0.0, abs=1e-12)
    assert distance[0] == pytest.approx(4.0)


def test_poisson_entropy() -> None:
    means = np.array([0.0, 1e-3, 0.4, 3.0, 40.0, 300.0])
    expected = [0.0, *(stats.poisson(m).entropy() for m in means[1:])]
    np.testing.assert_allclose(poisson_entropy(means), expected, rtol=1e-6)
