"""The kernels' mathematics: the exponential, and random numbers with the distributions that they claim."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit
from scipy import stats

from osl_env.numerics import POISSON_INVERSION_LIMIT, exp, mix, normal, poisson, uniform
from osl_env.parameters import FloatArray
from osl_env.streams import Purpose, derive

N = 200_000
SIGMAS = 5.0  # a mean may be off by 5 standard errors: one false alarm in 1.7 million
LEAST_P = 1e-4  # of the chi-square and Kolmogorov-Smirnov tests; seeds are fixed


@njit
def exps(x: FloatArray) -> FloatArray:
    out = np.empty_like(x)
    for k in range(x.size):
        out[k] = exp(x[k])
    return out


@njit
def uniforms(state: Any, n: int) -> FloatArray:
    out = np.empty(n)
    for k in range(n):
        state, out[k] = uniform(state)
    return out


@njit
def normals(state: Any, n: int) -> FloatArray:
    out = np.empty(n)
    for k in range(n):
        state, out[k] = normal(state)
    return out


@njit
def poissons(state: Any, mean: float, n: int) -> FloatArray:
    out = np.empty(n)
    for k in range(n):
        state, out[k] = poisson(state, mean)
    return out


def stream(seed: int) -> Any:
    return np.uint64(derive(seed, Purpose.SENSOR, 0))  # compiled functions hand Python an int: say its type again


def test_exp_agrees_with_numpy_to_two_units_in_the_last_place() -> None:
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.uniform(-708, 709, 200_000), rng.uniform(-1, 1, 50_000), rng.uniform(-1e-8, 1e-8, 1000)])
    expected = np.exp(x)
    assert np.max(np.abs(exps(x) - expected) / np.spacing(expected)) <= 2.0


def test_exp_is_exact_at_zero_and_clamped_outside_its_range() -> None:
    low, high = exps(np.array([-708.0, 709.0]))
    values = exps(np.array([0.0, -0.0, -709.0, -1e300, -np.inf, 710.0, 1e300, np.inf]))
    assert values.tolist() == [1.0, 1.0, low, low, low, high, high, high]
    assert 0.0 < low < 1e-307
    assert np.isfinite(high)


def test_exp_does_not_depend_on_its_place_in_an_array() -> None:
    x = np.random.default_rng(1).uniform(-50, 5, 1003)
    together = exps(x)
    assert all(exps(x[k : k + 1])[0] == together[k] for k in range(0, x.size, 17))
    assert np.array_equal(exps(x[3:]), together[3:])


def test_uniform_draws_are_uniform_and_below_one() -> None:
    draws = uniforms(stream(1), N)
    assert draws.min() >= 0.0
    assert draws.max() < 1.0
    assert abs(draws.mean() - 0.5) < SIGMAS * np.sqrt(1 / 12 / N)
    counts, _ = np.histogram(draws, bins=100, range=(0, 1))
    assert stats.chisquare(counts).pvalue > LEAST_P


def test_uniform_draws_of_a_stream_are_uncorrelated() -> None:
    draws = uniforms(stream(2), N)
    for lag in (1, 2, 7):
        assert abs(np.corrcoef(draws[:-lag], draws[lag:])[0, 1]) < SIGMAS / np.sqrt(N)


def test_mix_is_injective_on_neighbouring_words() -> None:
    assert len({int(mix(np.uint64(k))) for k in range(20_000)}) == 20_000


def test_normal_draws_have_the_moments_and_shape_of_a_normal() -> None:
    draws = normals(stream(3), N)
    assert abs(draws.mean()) < SIGMAS / np.sqrt(N)
    assert abs(draws.var() - 1.0) < SIGMAS * np.sqrt(2.0 / N)
    assert abs((draws**3).mean()) < SIGMAS * np.sqrt(15.0 / N)
    assert stats.kstest(draws, "norm").pvalue > LEAST_P


MEANS = [0.003, 0.4, 1.0, 4.0, 9.999, 10.0, 10.001, 25.0, 120.0, 3000.0]


@pytest.mark.parametrize("mean", MEANS)
def test_poisson_moments(mean: float) -> None:
    draws = poissons(stream(4), mean, N)
    assert np.all(draws == np.floor(draws))
    assert draws.min() >= 0
    assert abs(draws.mean() - mean) < SIGMAS * np.sqrt(mean / N)
    # variance of the sample variance of a Poisson variable: (mu_4 - mu_2^2) / n with mu_4 = mean + 3 mean^2
    assert abs(draws.var() - mean) < SIGMAS * np.sqrt((mean + 2 * mean**2) / N)


@pytest.mark.parametrize("mean", MEANS)
def test_poisson_distribution(mean: float) -> None:
    draws = poissons(stream(5), mean, N)
    law = stats.poisson(mean)
    low, high = int(law.ppf(20 / N)), int(law.ppf(1 - 20 / N))  # bins that expect at least some ten draws
    bins = np.arange(low, high + 1)
    observed = np.array([np.sum(draws <= low), *[np.sum(draws == k) for k in bins[1:-1]], np.sum(draws >= high)])
    expected = N * np.array([law.cdf(low), *law.pmf(bins[1:-1]), law.sf(high - 1)])
    assert stats.chisquare(observed, expected * observed.sum() / expected.sum()).pvalue > LEAST_P


def test_poisson_of_zero_is_zero_and_uses_one_draw() -> None:
    state, count = poisson(stream(6), 0.0)
    assert count == 0
    assert state == uniform(stream(6))[0]


def test_poisson_methods_switch_where_the_tests_look() -> None:
    assert min(abs(mean - POISSON_INVERSION_LIMIT) for mean in MEANS) == 0.0
