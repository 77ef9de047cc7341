"""Resampling of weighted particles: effective sample size and systematic (low variance) resampling.

Systematic resampling (Kitagawa 1996; "low variance" in Thrun, Burgard and Fox 2005): one uniform u places a comb of m
teeth at (u + i) / m over the cumulative weights. Particle n is drawn floor(m w_n) or ceil(m w_n) times, m w_n times on
average.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from osl_env.parameters import FloatArray


@njit(cache=True, error_model="numpy")
def effective_sample_size(weights: FloatArray) -> float:
    """1 / sum w^2 of normalised `weights` (n,): n where all are equal, 1 where one has all."""
    total = 0.0
    for n in range(weights.shape[0]):
        total += weights[n] * weights[n]
    return 1.0 / total


@njit(cache=True, error_model="numpy")
def systematic_indices(weights: FloatArray, u: float, chosen: NDArray[np.int64]) -> None:
    """Write the indices of the particles drawn with normalised `weights` (n,) and u in [0, 1) to `chosen` (m,)."""
    last = weights.shape[0] - 1
    draws = chosen.shape[0]
    n = 0
    cumulative = weights[0]
    for i in range(draws):
        tooth = (u + i) / draws
        while cumulative <= tooth and n < last:
            n += 1
            cumulative += weights[n]
        chosen[i] = n
