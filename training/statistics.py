"""Statistics of benchmark tables: pure functions of arrays, each with its interval or test.

Rates carry Wilson intervals (Wilson 1927), means carry bias-corrected and accelerated bootstrap intervals (Efron 1987),
summaries over tasks use the interquartile mean with a stratified bootstrap (Agarwal et al. 2021), and two policies
on the same seeds are compared by a sign-flip permutation test of the mean difference with Holm's (1979) correction.
Every resampling is seeded: the same numbers give the same interval.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from osl_env.errors import InputError
from osl_env.parameters import FloatArray

CONFIDENCE = 0.95
RESAMPLES = 9999
SIGN_FLIPS = 49_999  # so many that p < .001 survives Holm's correction over a table
_BATCH = 2000  # resamples held in memory at once


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
    """Mean of `values` (n,), NaN left out, with its BCa bootstrap interval (percentile where BCa is undefined)."""
    sample = np.asarray(values, dtype=np.float64)
    sample = sample[~np.isnan(sample)]
    if sample.size == 0:
        return NOTHING
    mean = float(sample.mean())
    if sample.size == 1:
        return Estimate(mean, math.nan, math.nan)
    if np.ptp(sample) == 0.0:
        return Estimate(mean, mean, mean)
    for method in ("BCa", "percentile"):
        result = stats.bootstrap(
            (sample,),
            np.mean,
            method=method,
            n_resamples=RESAMPLES,
            confidence_level=confidence,
            rng=np.random.default_rng(seed),
        )
        interval = result.confidence_interval
        if math.isfinite(interval.low) and math.isfinite(interval.high):
            break
    return Estimate(mean, float(interval.low), float(interval.high))


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


def stratified_interquartile_mean(
    scores: ArrayLike, *, seed: int = 0, resamples: int = 2000, confidence: float = CONFIDENCE
) -> Estimate:
    """Interquartile mean of `scores` (runs, tasks) with a percentile interval from resampling the runs of each task.

    Raises InputError if `scores` is not a matrix with at least one run and one task.
    """
    matrix = np.asarray(scores, dtype=np.float64)
    if matrix.ndim != 2 or 0 in matrix.shape:
        raise InputError(f"scores have shape {matrix.shape}: must be (runs, tasks), at least one of each")
    runs, tasks = matrix.shape
    rows = np.random.default_rng(seed).integers(0, runs, (resamples, runs, tasks))
    samples = matrix[rows, np.arange(tasks)].reshape(resamples, -1)
    draws = stats.trim_mean(samples, 0.25, axis=1)
    tail = (1.0 - confidence) / 2.0
    low, high = np.quantile(draws, (tail, 1.0 - tail))
    return Estimate(interquartile_mean(matrix), float(low), float(high))


def compare_paired(first: ArrayLike, second: ArrayLike, *, seed: int = 0) -> Comparison:
    """Mean difference first - second over pairs (n,), with a bootstrap interval and a sign-flip permutation p value.

    The test is exact up to 15 pairs and random above (49,999 flips: p >= 4e-5). Raises InputError for unequal sizes.
    """
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    if a.shape != b.shape or a.ndim != 1:
        raise InputError(f"paired samples have shapes {a.shape} and {b.shape}: must be (n,) and (n,)")
    difference = bootstrap_mean(a - b, seed=seed)
    if a.size < 2:
        return Comparison(difference, math.nan, a.size)
    if not np.any(a - b):
        return Comparison(difference, 1.0, a.size)
    test = stats.permutation_test(
        (a - b,),
        np.mean,
        permutation_type="samples",
        vectorized=True,
        n_resamples=SIGN_FLIPS,
        batch=_BATCH,
        rng=np.random.default_rng(seed),
    )
    return Comparison(difference, float(test.pvalue), a.size)


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
