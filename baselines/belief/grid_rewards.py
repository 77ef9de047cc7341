"""What a reading is expected to be worth to a searcher other than its information: compiled loops.

With w_n the belief's masses, P(d | lambda_n) the Poisson law of the reading d at a candidate position and p_d = sum_n
w_n P(d | lambda_n) its predictive distribution:

    predictive entropy      H(p) = - sum_d p_d ln p_d
    Renyi, order alpha      E[D_alpha] = sum_d p_d / (alpha - 1) * ln sum_n w_n (P(d | lambda_n) / p_d)^alpha

D_alpha is the divergence of the posterior, w_n P(d | lambda_n) / p_d, from the prior w_n, so that no posterior need be
formed. It is >= 0, does not fall with alpha, and tends to Kullback and Leibler's for alpha -> 1, whose expectation is
the information (`grid_information`); from there on that is computed by `GridBelief.information`. D_1/2 is twice the
Bhattacharyya distance -ln sum_n sqrt(posterior_n prior_n) (van Erven and Harremoes 2014, IEEE Trans. Inf. Theory 60).

As in `grid_information`, one pass over the belief sorts its mass into bins of log rate. The binned belief's expectation
is then exact up to the outcomes left out, which hold less than `OUTCOME_TAIL` of every bin's law. Unlike there, every
bin keeps all outcomes that any bin has: for alpha < 1 the tail of a bin's law counts, as P^alpha.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from baselines.belief.grid_information import N_BINS, N_OUTCOMES, poisson_tables, rate_bins
from osl_env.parameters import FloatArray

LEAST_ORDER, GREATEST_ORDER = 0.01, 20.0  # of alpha: below, the logarithms cancel; above, powers of P underflow
LEAST_OUTCOME = 1e-12  # outcomes less likely than this are left out of the divergence
NEAR_ONE = 1e-6  # |alpha - 1| below which the divergence is taken at its limit


@functools.lru_cache(maxsize=16)
def poisson_powers(sampling_time: float, order: float) -> FloatArray:
    """P(d | lambda)^order over the bins of log rate for readings over `sampling_time`, s: (N_BINS, N_OUTCOMES).

    Cached. Raises ValueError for an order outside LEAST_ORDER .. GREATEST_ORDER.
    """
    if not LEAST_ORDER <= order <= GREATEST_ORDER:
        raise ValueError(f"order = {order:g}: must be {LEAST_ORDER:g} to {GREATEST_ORDER:g}")
    return np.asarray(poisson_tables((sampling_time,)).probability[0] ** order)


@njit(cache=True, error_model="numpy")
def _binned_mass(points: FloatArray, u: FloatArray, model: FloatArray, where: FloatArray, mass: FloatArray) -> None:
    """Sort the masses of `points` into the bins of log rate at `u`: `mass` (N_BINS,). `where` (n,) is room to work."""
    rate_bins(points, u, model, where)
    weight = points[0]
    mass[:] = 0.0
    for i in range(where.size):
        b = int(where[i])
        upper = weight[i] * (where[i] - b)
        mass[b] += weight[i] - upper
        mass[b + 1] += upper


@njit(cache=True, error_model="numpy")
def _mixture(mass: FloatArray, table: FloatArray, used: int, out: FloatArray) -> None:
    """Sum over bins of `mass` (N_BINS,) times their row of `table` (N_BINS, N_OUTCOMES), for outcomes below `used`."""
    out[:used] = 0.0
    for b in range(N_BINS):
        if mass[b] > 0.0:
            share, row = mass[b], table[b]
            for d in range(used):
                out[d] += share * row[d]


@njit(cache=True, error_model="numpy")
def _n_used(mass: FloatArray, n_outcomes: NDArray[np.int64]) -> int:
    """Outcomes that hold all but OUTCOME_TAIL of every law with mass."""
    used = 1
    for b in range(N_BINS):
        if mass[b] > 0.0:
            used = max(used, n_outcomes[b])
    return used


@njit(cache=True, error_model="numpy")
def _predictive_entropy(
    points: FloatArray,
    candidates: FloatArray,
    model: FloatArray,
    probability: FloatArray,
    n_outcomes: NDArray[np.int64],
    out: FloatArray,
) -> None:
    where, mass, mixture = np.empty(points.shape[1]), np.empty(N_BINS), np.empty(N_OUTCOMES)
    for c in range(candidates.shape[0]):
        _binned_mass(points, candidates[c], model, where, mass)
        used = _n_used(mass, n_outcomes)
        _mixture(mass, probability, used, mixture)
        entropy = 0.0
        for d in range(used):
            if mixture[d] > 0.0:
                entropy -= mixture[d] * math.log(mixture[d])
        out[c] = max(entropy, 0.0)


@njit(cache=True, error_model="numpy")
def _renyi_divergence(
    points: FloatArray,
    candidates: FloatArray,
    model: FloatArray,
    probability: FloatArray,
    powers: FloatArray,
    n_outcomes: NDArray[np.int64],
    order: float,
    out: FloatArray,
) -> None:
    where, mass = np.empty(points.shape[1]), np.empty(N_BINS)
    mixture, mixed_powers = np.empty(N_OUTCOMES), np.empty(N_OUTCOMES)
    for c in range(candidates.shape[0]):
        _binned_mass(points, candidates[c], model, where, mass)
        used = _n_used(mass, n_outcomes)
        _mixture(mass, probability, used, mixture)
        _mixture(mass, powers, used, mixed_powers)
        expectation = 0.0
        for d in range(used):
            if mixture[d] > LEAST_OUTCOME:
                logarithm = math.log(mixed_powers[d]) - order * math.log(mixture[d])
                expectation += mixture[d] * max(logarithm / (order - 1.0), 0.0)
        out[c] = expectation


def predictive_entropy(
    points: FloatArray, candidates: FloatArray, model: FloatArray, sampling_time: float
) -> FloatArray:
    """Entropy, nats, of the distribution of the next reading at each of `candidates` (C, 3), m: (C,).

    `points` (5, n) from `GridBelief.compressed`; `model` (7,), a row of `GridBelief.models`; `sampling_time`, s.
    """
    tables = poisson_tables((sampling_time,))
    out = np.empty(len(candidates))
    _predictive_entropy(points, candidates, model, tables.probability[0], tables.n_outcomes[0], out)
    return out


def renyi_divergence(
    points: FloatArray, candidates: FloatArray, model: FloatArray, sampling_time: float, order: float
) -> FloatArray:
    """Expected Renyi divergence, nats, of the posterior from the prior, for a reading at each candidate: (C,).

    `order` is alpha, LEAST_ORDER .. GREATEST_ORDER without 1; the rest as in `predictive_entropy`. Raises ValueError
    for another order.
    """
    if abs(order - 1.0) < NEAR_ONE:
        raise ValueError(
            f"order = {order:g}: at its limit 1 the divergence is the information (GridBelief.information)"
        )
    tables, powers = poisson_tables((sampling_time,)), poisson_powers(sampling_time, order)
    out = np.empty(len(candidates))
    laws = tables.probability[0], powers, tables.n_outcomes[0]
    _renyi_divergence(points, candidates, model, *laws, order, out)
    return out
