"""The particle belief: likelihood, Bayes against brute force on a grid, resampling, roughening, determinism."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numba import njit
from scipy import stats

from baselines.belief.likelihood import AdvertisedPlume, add_log_likelihood, hit_model, log
from baselines.belief.particle_filter import ParticleBelief, fill_normal
from osl_env.errors import InputError
from osl_env.plumes.hit_rate import HitRatePlume
from osl_env.sensors import PoissonCounter

AREA = np.array([24.0, 20.0, 10.0])
WIND = np.array([0.0, -1.0, 0.0])
MODEL = hit_model(HitRatePlume(), PoissonCounter(), WIND)
READINGS = np.array(  # x, y, z, hits, sampling time, time
    [[4.0, 3.0, 5.0, 0.0, 1.0, 0.0], [14.0, 4.0, 5.0, 2.0, 1.0, 3.0], [20.0, 9.0, 2.0, 0.0, 2.0, 6.0]]
)


@njit
def _logs(values: np.ndarray, out: np.ndarray) -> None:
    for i in range(values.shape[0]):
        out[i] = log(values[i])


def test_log_is_the_logarithm() -> None:
    values = np.exp(np.random.default_rng(0).uniform(-700.0, 700.0, 5000))
    out = np.empty_like(values)
    _logs(values, out)
    np.testing.assert_allclose(out, np.log(values), rtol=4e-16)


@pytest.mark.parametrize("hits", [0, 1, 7])
def test_likelihood_is_poisson_with_the_sensors_mean(hits: int) -> None:
    plume = HitRatePlume(source_strength=4.0)
    model = hit_model(plume, PoissonCounter(false_positive_rate=0.2, miss_probability=0.25), WIND)
    points = np.random.default_rng(1).uniform(0.0, 10.0, (3, 40))
    position, time, power = np.array([5.0, 2.0, 5.0]), 3.0, 0.4
    log_weight = np.zeros(40)
    add_log_likelihood(*points, log_weight, np.array([*position, hits, time, 0.0]), power, model)
    rates = np.array([plume.field(position[None], point[None], np.ones(1), WIND)[0] for point in points.T])
    expected = power * stats.poisson.logpmf(hits, (0.75 * rates + 0.2) * time)
    np.testing.assert_allclose(log_weight - log_weight[0], expected - expected[0], rtol=1e-10, atol=1e-10)


def test_nothing_sampled_says_nothing() -> None:
    log_weight = np.zeros(3)
    add_log_likelihood(*np.ones((3, 3)), log_weight, np.array([0.0, 0.0, 0.0, 5.0, 0.0, 0.0]), 1.0, MODEL)
    assert np.all(log_weight == 0.0)


def _grid_posterior(cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of the posterior of READINGS on a grid of `cell` m: brute force."""
    axes = [np.arange(cell / 2, side, cell) for side in AREA]
    points = np.stack(np.meshgrid(*axes, indexing="ij")).reshape(3, -1)
    log_posterior = np.zeros(points.shape[1])
    plume = HitRatePlume()
    drift = np.linalg.norm(WIND) / (2.0 * plume.diffusivity)
    for x, y, z, hits, time, _ in READINGS:
        offset = np.array([[x], [y], [z]]) - points
        r = np.maximum(np.linalg.norm(offset, axis=0), plume.clamp_distance)
        rate = plume.source_strength / r * np.exp(-offset[1] * drift - r * plume.inverse_lambda(1.0))
        log_posterior += stats.poisson.logpmf(hits, rate * time)
    weights = np.exp(log_posterior - log_posterior.max())
    weights /= weights.sum()
    return points @ weights, np.cov(points, aweights=weights, bias=True)


def test_posterior_equals_brute_force_bayes_on_a_grid() -> None:
    """Importance sampling: the tolerance is five standard errors of each moment, from the weights themselves."""
    mean, covariance = _grid_posterior(0.25)
    belief = ParticleBelief(40_000, AREA, seed=5)
    prior_spread = belief.spread
    for reading in READINGS:  # one after the other: the weights must accumulate
        belief.update(reading[None], MODEL, resample_below=0.0)
    assert belief.spread < 0.8 * prior_spread  # the readings do say something
    weights, points = belief.weights, belief.cloud[:3]
    shift = points - belief.mean[:, None]
    standard_error = np.sqrt((weights**2) @ (shift**2).T)
    np.testing.assert_array_less(np.abs(belief.mean - mean), 5.0 * standard_error + 0.01)
    for i in range(3):
        for j in range(3):
            product = shift[i] * shift[j]
            error = np.sqrt(np.sum(weights**2 * (product - belief.covariance[i, j]) ** 2))
            assert abs(belief.covariance[i, j] - covariance[i, j]) < 5.0 * error + 0.02


def test_resampling_keeps_the_posterior() -> None:
    """Systematic resampling moves the mean by less than the multinomial standard error, sigma / sqrt(N)."""
    kept, drawn = ParticleBelief(20_000, AREA, seed=6), ParticleBelief(20_000, AREA, seed=6)
    kept.update(READINGS, MODEL, resample_below=0.0)
    drawn.update(READINGS, MODEL, resample_below=1.0)
    assert np.allclose(drawn.weights, 1 / 20_000)
    assert drawn.entropy == pytest.approx(np.log(20_000))
    standard_error = np.sqrt(np.diag(kept.covariance) / 20_000)
    np.testing.assert_array_less(np.abs(drawn.mean - kept.mean), 4.0 * standard_error)
    assert set(drawn.x) <= set(kept.x)
    assert len(set(drawn.x)) < 20_000


def test_resampling_waits_for_the_effective_sample_size() -> None:
    weak, strong = READINGS[:1].copy(), READINGS[1:2].copy()
    belief = ParticleBelief(500, AREA, seed=7)
    belief.update(weak, MODEL)
    assert np.ptp(belief.weights) > 0.0
    strong[0, 3] = 9.0
    belief.update(strong, MODEL)
    assert np.ptp(belief.weights) == 0.0


def test_powers_weaken_readings() -> None:
    def weights(readings: np.ndarray, powers: list[float]) -> np.ndarray:
        belief = ParticleBelief(200, AREA, seed=8)
        belief.update(readings, MODEL, powers=np.array(powers), resample_below=0.0)
        return belief.weights

    np.testing.assert_allclose(weights(READINGS[1:2], [2.0]), weights(READINGS[[1, 1]], [1.0, 1.0]), rtol=1e-9)
    np.testing.assert_allclose(weights(READINGS[:2], [1.0, 0.0]), weights(READINGS[:1], [1.0]), rtol=1e-9)


def test_no_hit_is_information() -> None:
    belief = ParticleBelief(5000, AREA, seed=9)
    near = np.linalg.norm(belief.cloud[:3] - READINGS[0, :3, None], axis=0) < 3.0
    before = belief.weights[near].sum()
    belief.update(READINGS[:1], MODEL, resample_below=0.0)
    assert belief.weights[near].sum() < 0.8 * before


def test_roughening_adds_silvermans_variance_and_stays_in_the_area() -> None:
    """Variance grows by the factor 1 + h^2 (the walls are far away here); tolerance 5 standard errors."""
    count, factor = 4000, 2.0
    wide = np.array([400.0, 400.0, 400.0])
    rough, plain = ParticleBelief(count, wide, seed=10), ParticleBelief(count, wide, seed=10)
    noise = np.empty(3 * count)
    fill_normal(noise, np.array([3], dtype=np.uint64))
    for belief in (rough, plain):
        belief.cloud[:3] = 200.0 + noise.reshape(3, count) * [[9.0], [4.0], [1.0]]
    nothing = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    plain.update(nothing, MODEL, resample_below=1.0)
    rough.update(nothing, MODEL, resample_below=1.0, roughening=factor)
    growth = 1.0 + (factor * (4.0 / (5.0 * count)) ** (1.0 / 7.0)) ** 2
    ratio = np.diag(rough.covariance) / np.diag(plain.covariance)
    np.testing.assert_allclose(ratio, growth, atol=5.0 * growth * np.sqrt(2.0 / count))
    cornered = ParticleBelief(count, AREA, seed=11)
    cornered.update(READINGS, MODEL, resample_below=1.0, roughening=20.0)
    assert np.all((cornered.cloud[:3] >= 0.0) & (cornered.cloud[:3] <= AREA[:, None]))


def test_without_roughening_a_collapsed_cloud_stays_collapsed() -> None:
    belief = ParticleBelief(50, AREA, seed=12)
    belief.cloud[:3] = np.array([[3.0], [4.0], [5.0]])
    belief.update(READINGS, MODEL, resample_below=1.0, roughening=0.5)
    assert belief.spread < 1e-3


def test_normal_draws_are_normal() -> None:
    draws = np.empty(20_000)
    fill_normal(draws, np.array([1], dtype=np.uint64))
    assert stats.kstest(draws, "norm").pvalue > 1e-3


def test_same_seed_same_belief_and_another_seed_another() -> None:
    def run(seed: int) -> np.ndarray:
        belief = ParticleBelief(100, AREA, seed=seed)
        for reading in READINGS:
            belief.update(reading[None], MODEL, resample_below=1.0, roughening=0.5)
        return belief.cloud

    assert np.array_equal(run(1), run(1))
    assert not np.array_equal(run(1), run(2))


def _briefing(**fields: Any) -> Any:
    return SimpleNamespace(plume=HitRatePlume(), gas_sensor=PoissonCounter(), **fields)


def test_the_wind_is_the_mean_of_what_was_measured() -> None:
    plume = AdvertisedPlume(_briefing())
    for wind in ([1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.5, 0.4, 0.3]):
        model = plume.measure(np.array(wind))
    expected = hit_model(HitRatePlume(), PoissonCounter(), np.array([0.5, -0.2, 0.0]))
    np.testing.assert_allclose(model, expected, rtol=1e-12)


def test_a_plume_without_hits_is_refused() -> None:
    with pytest.raises(InputError, match="hit_rate"):
        hit_model(SimpleNamespace(measures="concentration"), PoissonCounter(), WIND)
