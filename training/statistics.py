"""Statistics of benchmark tables: pure functions of arrays, each with its interval or test.

Rates carry Wilson intervals (Wilson 1927), means carry bias-corrected and accelerated bootstrap intervals (Efron 1987),
summaries over tasks use the interquartile mean and performance profiles with a stratified bootstrap (Agarwal et al.
2021), and two policies on the same seeds are compared by a sign-flip permutation test of the mean difference, success
rates by McNemar's (1947) exact one, with Holm's (1979) correction.
Every resampling is seeded: the same numbers give the same interval.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from osl_env.errors import InputError
from osl_env.parameters import FloatArray
from training.resampling import RESAMPLES, bca_interval, sign_flip_p, stratified_draws

CONFIDENCE = 0.95
STRATIFIED_RESAMPLES = 2000  # over a leaderboard's scenarios together each is as large as a table


class Estimate(NamedTuple):
    """A value with its confidence interval; NaN where there is nothing to estimate from."""

    value: float
    low: float
    high: float


NOTHING = Estimate(math.nan, math.nan, math.nan)


class Comparison(NamedTuple):
    """Paired difference a - b of means, its interval, and the p value of "no difference" (NaN below two pairs)."""

    difference: Estimate
    p_value: float
    pairs: int


def wilson(successes: int, trials: int, confidence: float = CONFIDENCE) -> Estimate:
    """Proportion successes / trials with Wilson's score interval."""
    if trials == 0:
        return NOTHING
    interval = stats.binomtest(successes, trials).proportion_ci(confidence_level=confidence, method="wilson")
    # at 0 and at n of n the bound is the proportion itself, which rounding misses by 1e-17
    low = 0.0 if successes == 0 else float(interval.low)
    high = 1.0 if successes == trials else float(interval.high)
    return Estimate(successes / trials, low, high)


def capped(times: ArrayLike, successes: ArrayLike, limit: float) -> FloatArray:
    """(n,) `times` with those of failures, and those over it, replaced by `limit`: the terms of the capped mean."""
    return np.where(np.asarray(successes, dtype=bool), np.minimum(np.asarray(times, dtype=np.float64), limit), limit)


def bootstrap_mean(values: ArrayLike, *, seed: int = 0, confidence: float = CONFIDENCE) -> Estimate:
    """Mean of `values` (n,), NaN left out, with its BCa bootstrap interval."""
    sample = np.asarray(values, dtype=np.float64)
    sample = sample[~np.isnan(sample)]
    if sample.size == 0:
        return NOTHING
    mean = float(sample.mean())
    if sample.size == 1:
        return Estimate(mean, math.nan, math.nan)
    if np.ptp(sample) == 0.0:
        return Estimate(mean, mean, mean)
    return Estimate(mean, *bca_interval(sample, seed=seed, confidence=confidence))


def stratified_mean(samples: Sequence[FloatArray], *, seed: int = 0, confidence: float = CONFIDENCE) -> Estimate:
    """Mean of the means of `samples` (n_k,), with a percentile interval from resampling inside each sample."""
    strata = [sample for sample in samples if sample.size]
    if not strata:
        return NOTHING
    rng = np.random.default_rng(seed)
    draws = np.mean([rng.choice(sample, (RESAMPLES, sample.size)).mean(axis=1) for sample in strata], axis=0)
    tail = (1.0 - confidence) / 2.0
    low, high = np.quantile(draws, (tail, 1.0 - tail))
    return Estimate(float(np.mean([sample.mean() for sample in strata])), float(low), float(high))


def interquartile_mean(scores: ArrayLike) -> float:
    """Mean of the middle half of all entries of `scores`."""
    return float(stats.trim_mean(np.asarray(scores, dtype=np.float64).ravel(), 0.25))


def _interquartile_means(samples: FloatArray) -> FloatArray:
    return np.asarray(stats.trim_mean(samples.reshape(len(samples), -1), 0.25, axis=1))


def _means(samples: FloatArray) -> FloatArray:
    return np.asarray(samples.mean(axis=(1, 2)))


def _medians_of_tasks(samples: FloatArray) -> FloatArray:
    return np.asarray(np.median(samples.mean(axis=1), axis=1))


# name -> statistic of (m, runs, tasks), as rliable's aggregates
AGGREGATES: dict[str, Callable[[FloatArray], FloatArray]] = {
    "interquartile_mean": _interquartile_means,
    "mean": _means,
    "median_of_tasks": _medians_of_tasks,
}


def aggregates(
    scores: ArrayLike, *, seed: int = 0, resamples: int = STRATIFIED_RESAMPLES, confidence: float = CONFIDENCE
) -> dict[str, Estimate]:
    """Each of `AGGREGATES` of `scores` (runs, tasks), with a percentile interval from resampling the runs of each task.

    Interquartile mean: of the middle half of all entries; mean: of all; median: of the tasks' means.
    Raises InputError if `scores` is not a matrix with at least one run and one task.
    """
    matrix = np.asarray(scores, dtype=np.float64)
    if matrix.ndim != 2 or 0 in matrix.shape:
        raise InputError(f"scores have shape {matrix.shape}: must be (runs, tasks), at least one of each")
    tail = (1.0 - confidence) / 2.0
    draws = stratified_draws(matrix, list(AGGREGATES.values()), seed=seed, resamples=resamples)
    estimates = {}
    for (name, statistic), drawn in zip(AGGREGATES.items(), draws, strict=True):
        low, high = np.quantile(drawn, (tail, 1.0 - tail))
        estimates[name] = Estimate(float(statistic(matrix[None])[0]), float(low), float(high))
    return estimates


def stratified_interquartile_mean(
    scores: ArrayLike, *, seed: int = 0, resamples: int = STRATIFIED_RESAMPLES, confidence: float = CONFIDENCE
) -> Estimate:
    """The interquartile mean among `aggregates`."""
    return aggregates(scores, seed=seed, resamples=resamples, confidence=confidence)["interquartile_mean"]


class Profile(NamedTuple):
    """A performance profile: the share of runs below each threshold, with pointwise confidence bands; (m,) each."""

    share: FloatArray
    low: FloatArray
    high: FloatArray


def performance_profile(
    samples: Sequence[ArrayLike],
    thresholds: ArrayLike,
    *,
    seed: int = 0,
    resamples: int = STRATIFIED_RESAMPLES,
    confidence: float = CONFIDENCE,
) -> Profile:
    """Share of the runs strictly below each of `thresholds` (m,), ascending; each of `samples` (n_k,) weighs the same.

    Bands from resampling the runs within each sample: as only the counts between thresholds matter, they are drawn
    from a multinomial law. Raises InputError without samples, for an empty one, or for descending thresholds.
    """
    limits = np.asarray(thresholds, dtype=np.float64)
    strata = [np.asarray(sample, dtype=np.float64) for sample in samples]
    if not strata or any(sample.size == 0 for sample in strata) or np.any(np.diff(limits) < 0):
        raise InputError("a performance profile needs samples, none of them empty, and ascending thresholds")
    rng = np.random.default_rng(seed)
    share, draws = np.zeros(limits.size), np.zeros((resamples, limits.size))
    for sample in strata:
        bins = np.bincount(np.searchsorted(limits, sample, side="right"), minlength=limits.size + 1)
        share += np.cumsum(bins[:-1]) / sample.size
        drawn = rng.multinomial(sample.size, bins / sample.size, size=resamples)
        draws += np.cumsum(drawn[:, :-1], axis=1) / sample.size
    tail = (1.0 - confidence) / 2.0
    low, high = np.quantile(draws / len(strata), (tail, 1.0 - tail), axis=0)
    return Profile(share / len(strata), low, high)


def wins(first: ArrayLike, second: ArrayLike) -> FloatArray:
    """(n,) 1 where `first` is below `second` (n,), 0 where it is above, one half for a tie.

    Its mean over the pairs is the probability of improvement, for lower is better and on the same seeds.
    """
    difference = np.asarray(first, dtype=np.float64) - np.asarray(second, dtype=np.float64)
    return np.asarray(0.5 - 0.5 * np.sign(difference))


def _differences(first: ArrayLike, second: ArrayLike) -> FloatArray:
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    if a.shape != b.shape or a.ndim != 1:
        raise InputError(f"paired samples have shapes {a.shape} and {b.shape}: must be (n,) and (n,)")
    return np.asarray(a - b)


def compare_paired(first: ArrayLike, second: ArrayLike, *, seed: int = 0) -> Comparison:
    """Mean difference first - second over pairs (n,), with a bootstrap interval and a sign-flip permutation p value.

    The test is exact up to 15 pairs and random above (49,999 flips: p >= 2e-5). Raises InputError for unequal sizes.
    """
    differences = _differences(first, second)
    difference = bootstrap_mean(differences, seed=seed)
    if differences.size < 2:
        return Comparison(difference, math.nan, differences.size)
    p_value = sign_flip_p(differences, seed=seed) if np.any(differences) else 1.0
    return Comparison(difference, p_value, differences.size)


def compare_successes(first: ArrayLike, second: ArrayLike, *, seed: int = 0) -> Comparison:
    """Difference first - second of success rates over pairs (n,) of 0 and 1, with McNemar's exact two-sided p value.

    Raises InputError for unequal sizes.
    """
    differences = _differences(first, second)
    difference = bootstrap_mean(differences, seed=seed)
    if differences.size < 2:
        return Comparison(difference, math.nan, differences.size)
    discordant = int(np.count_nonzero(differences))
    p_value = stats.binomtest(int(np.count_nonzero(differences > 0)), discordant).pvalue if discordant else 1.0
    return Comparison(difference, float(p_value), differences.size)


def wilcoxon(first: ArrayLike, second: ArrayLike) -> float:
    """p value of Wilcoxon's signed rank test of paired samples (n,), zero differences split (Pratt); 1 if all are zero.

    Insensitive to a few long searches, unlike the test of means in `compare_paired`.
    """
    difference = np.asarray(first, dtype=np.float64) - np.asarray(second, dtype=np.float64)
    if not np.any(difference):
        return 1.0
    return float(stats.wilcoxon(difference, zero_method="pratt").pvalue)


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's step-down adjusted p values, in the order given; NaN stays NaN and is not counted as a test."""
    adjusted = list(p_values)
    tested = sorted((p, index) for index, p in enumerate(p_values) if not math.isnan(p))
    worst = 0.0
    for rank, (p, index) in enumerate(tested):
        worst = max(worst, min(1.0, (len(tested) - rank) * p))
        adjusted[index] = worst
    return adjusted
