"""The resampling under `training.statistics`: bootstraps of means, and sign flips of paired differences.

Written as products with matrices of drawn counts or bits: a leaderboard has thousands of intervals, and scipy's general
routines take a second each at 1000 episodes. Seeded: the same numbers give the same result.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from osl_env.parameters import FloatArray

RESAMPLES = 9999
SIGN_FLIPS = 49_999  # so many that p < .001 survives Holm's correction over a table
_EXACT_PAIRS = 15  # up to here all 2^n sign flips are fewer than SIGN_FLIPS
_BATCH = 2000  # resamples held in memory at once
_CACHED = 2000  # entries of a sample up to which its drawn counts are kept for the next sample of the size
_ENTRIES = 4_000_000  # of a stratified resample held in memory at once
_TIE = 1e-6  # relative: single precision makes equal sums differ by less


def bca_interval(sample: FloatArray, *, seed: int, confidence: float) -> tuple[float, float]:
    """Bias-corrected and accelerated bootstrap interval of the mean of `sample` (n,) with a spread (Efron 1987).

    For the mean, the jackknife's acceleration is the sum of cubes over the 3/2 power of the sum of squares, by six.
    """
    centred = sample - sample.mean()
    scale = float(np.abs(centred).max())
    centred /= scale
    draws = _resampled_means(centred, seed)
    below = np.count_nonzero(draws < -_TIE) + 0.5 * np.count_nonzero(np.abs(draws) <= _TIE)
    bias = stats.norm.ppf(np.clip(below / draws.size, 1 / draws.size, 1 - 1 / draws.size))
    acceleration = np.sum(centred**3) / (6.0 * np.sum(centred**2) ** 1.5)
    tails = bias + stats.norm.ppf([(1.0 - confidence) / 2.0, (1.0 + confidence) / 2.0])
    levels = stats.norm.cdf(bias + tails / (1.0 - acceleration * tails))
    low, high = np.quantile(draws, levels) * scale + sample.mean()
    return float(low), float(high)


def _resampled_means(centred: FloatArray, seed: int) -> FloatArray:
    """(RESAMPLES,) means of resamples of `centred` (n,)."""
    n = centred.size
    values = centred.astype(np.float32)
    if n <= _CACHED:
        return np.asarray(_kept_counts(n, seed) @ values, dtype=np.float64) / n
    return np.concatenate([np.asarray(counts @ values, dtype=np.float64) for counts in _drawn_counts(n, seed)]) / n


@functools.lru_cache(maxsize=4)
def _kept_counts(n: int, seed: int) -> NDArray[np.float32]:
    return np.concatenate(list(_drawn_counts(n, seed)))


def _drawn_counts(n: int, seed: int) -> Iterator[NDArray[np.float32]]:
    """How often each of n values comes in each of RESAMPLES resamples, in batches (m, n)."""
    rng = np.random.default_rng(seed)
    step = max(1, min(_BATCH, _ENTRIES // n))
    for start in range(0, RESAMPLES, step):
        size = min(step, RESAMPLES - start)
        drawn = rng.integers(0, n, (size, n)) + np.arange(size)[:, None] * n
        yield np.bincount(drawn.ravel(), minlength=size * n).reshape(size, n).astype(np.float32)


def sign_flip_p(differences: FloatArray, *, seed: int) -> float:
    """Two-sided p value of "the signs of `differences` (n,) are random", by the sum; not all of them are zero.

    Exact up to 15 pairs, over 49,999 random flips above (p >= 2e-5).
    """
    values = (differences / np.abs(differences).max()).astype(np.float32)
    total = float(values.sum(dtype=np.float64))
    limit = abs(total) - _TIE * float(np.abs(values).sum(dtype=np.float64))
    extreme, flips = 0, 0
    for bits in _flips(values.size, seed):
        sums = 2.0 * (bits @ values).astype(np.float64) - total
        extreme += int(np.count_nonzero(np.abs(sums) >= limit))
        flips += sums.size
    if values.size <= _EXACT_PAIRS:
        return extreme / flips
    return (extreme + 1) / (flips + 1)


def _flips(n: int, seed: int) -> Iterator[NDArray[np.float32]]:
    """Rows of n bits: all of them for few pairs, else SIGN_FLIPS random ones, in batches."""
    if n <= _EXACT_PAIRS:
        yield (np.arange(2**n)[:, None] >> np.arange(n) & 1).astype(np.float32)
        return
    rng = np.random.default_rng(seed)
    step = max(1, min(_BATCH, _ENTRIES // n))
    for start in range(0, SIGN_FLIPS, step):
        size = min(step, SIGN_FLIPS - start)
        octets = np.frombuffer(rng.bytes(size * math.ceil(n / 8)), dtype=np.uint8).reshape(size, -1)
        yield np.unpackbits(octets, axis=1, count=n).astype(np.float32)


def stratified_draws(
    scores: FloatArray,
    statistics: Sequence[Callable[[FloatArray], FloatArray]],
    *,
    seed: int,
    resamples: int,
) -> list[FloatArray]:
    """(resamples,) values of each of `statistics` when the runs of `scores` (runs, tasks) are drawn anew in each task.

    A statistic maps (m, runs, tasks) to (m,).
    """
    runs, tasks = scores.shape
    rng = np.random.default_rng(seed)
    step = max(1, _ENTRIES // scores.size)
    draws: list[list[Any]] = [[] for _ in statistics]
    for start in range(0, resamples, step):
        rows = rng.integers(0, runs, (min(step, resamples - start), runs, tasks))
        samples = scores[rows, np.arange(tasks)]
        for kept, statistic in zip(draws, statistics, strict=True):
            kept.append(statistic(samples))
    return [np.concatenate(kept) for kept in draws]
