"""What a reading is expected to tell an exact grid belief: compiled loops.

The information that a reading d at u carries about the source is, exactly,

    I(u) = H(w) - E[H'] = H(p_d) - sum_n w_n h(lambda_n),    p_d = sum_n w_n Poisson(d; lambda_n)

with h the entropy of a Poisson law. It depends on the belief only through the distribution of lambda under w. So
one pass over the cells sorts their mass into bins of log lambda (shared linearly between the two nearest), and
every outcome d and every sampling time is then a sum over a few hundred bins with a table of Poisson probabilities,
instead of one over all cells. The same sums with w ln w and with w times the distance in place of w give the
entropy and the mean distance after each outcome, which space-aware infotaxis needs. What the bins blur is a
variance of log lambda below `BIN_WIDTH`^2 / 4.

The belief comes in as points: cells, or blocks of 2 x 2 x 2 cells where these hold little mass (`compress`). Blocks
that together hold no more than `negligible` are dropped. With delta the dropped mass and K cells, the information
I' of the rest, renormalised, bounds the whole belief's: 0 <= I - (1 - delta) I' <= delta ln K + h2(delta), h2 the
binary entropy.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import gammaln

from baselines.belief.likelihood import log
from osl_env.numerics import exp
from osl_env.parameters import FloatArray

BIN_WIDTH = 0.0625  # in log rate
BIN_LOWEST = -14.0  # log of the smallest rate told apart, 1/s: 8e-7
N_BINS = 304  # up to e**5 = 148 hits/s
MAX_MEAN = 60.0  # larger mean counts are taken as this: a reading says all that it can long before
N_OUTCOMES = 110  # counts 0 .. 109: P(d > 109 | 60) < 1e-8
OUTCOME_TAIL = 1e-9  # outcomes beyond this tail of each Poisson law are left out


class PoissonTables(NamedTuple):
    """Poisson laws over the bins of log rate, one set for each sampling time: see `poisson_tables`."""

    probability: FloatArray  # (K, N_BINS, N_OUTCOMES)
    entropy: FloatArray  # (K, N_BINS) nats
    n_outcomes: NDArray[np.int64]  # (K, N_BINS) outcomes 0 .. n - 1 hold all but OUTCOME_TAIL


@functools.lru_cache(maxsize=16)
def poisson_tables(sampling_times: tuple[float, ...]) -> PoissonTables:
    """The tables for readings taken over each of `sampling_times`, s. Cached."""
    rate = np.exp(BIN_LOWEST + BIN_WIDTH * np.arange(N_BINS))
    mean = np.minimum(np.array(sampling_times)[:, None] * rate, MAX_MEAN)[:, :, None]
    count = np.arange(float(N_OUTCOMES))
    log_probability = count * np.log(mean) - mean - gammaln(count + 1.0)
    probability = np.exp(log_probability)
    entropy = -np.sum(probability * log_probability, axis=2)
    tail = 1.0 - np.cumsum(probability, axis=2)
    n_outcomes = np.minimum((tail > OUTCOME_TAIL).sum(axis=2) + 1, N_OUTCOMES)
    return PoissonTables(probability, entropy, n_outcomes.astype(np.int64))


@njit(error_model="numpy")
def _sum_blocks(
    probability: FloatArray,
    log_posterior: FloatArray,
    xs: FloatArray,
    ys: FloatArray,
    zs: FloatArray,
    by: int,
    bz: int,
    block: FloatArray,
) -> None:
    """Mass, mass times x, y, z, and sum p ln p of the blocks of 2 x 2 x 2 cells in row (by, bz): `block` (n_blocks,
    5).
    """
    n_x = xs.size
    block[:] = 0.0
    for iz in range(2 * bz, min(2 * bz + 2, zs.size)):
        for iy in range(2 * by, min(2 * by + 2, ys.size)):
            start = (iz * ys.size + iy) * n_x
            for ix in range(n_x):
                p = probability[start + ix]
                entry = block[ix >> 1]
                entry[0] += p
                entry[1] += p * xs[ix]
                entry[2] += p * ys[iy]
                entry[3] += p * zs[iz]
                entry[4] += p * log_posterior[start + ix]


@njit(error_model="numpy")
def _write_cells(
    probability: FloatArray,
    log_posterior: FloatArray,
    xs: FloatArray,
    ys: FloatArray,
    zs: FloatArray,
    bx: int,
    by: int,
    bz: int,
    points: FloatArray,
    n: int,
) -> int:
    """Write the cells of block (bx, by, bz) to `points` from column `n` on; the number of points then."""
    for iz in range(2 * bz, min(2 * bz + 2, zs.size)):
        for iy in range(2 * by, min(2 * by + 2, ys.size)):
            for ix in range(2 * bx, min(2 * bx + 2, xs.size)):
                cell = (iz * ys.size + iy) * xs.size + ix
                p = probability[cell]
                points[0, n] = p
                points[1, n], points[2, n], points[3, n] = xs[ix], ys[iy], zs[iz]
                points[4, n] = p * log_posterior[cell]
                n += 1
    return n


@njit(cache=True, error_model="numpy")
def compress(
    probability: FloatArray,
    log_posterior: FloatArray,
    xs: FloatArray,
    ys: FloatArray,
    zs: FloatArray,
    heavy: float,
    negligible: float,
    points: FloatArray,
) -> int:
    """Write the belief's points to `points` (5, capacity) and give their number.

    Rows of `points`: mass w, x, y, z (m), and sum p ln p over the point's cells. A block of 2 x 2 x 2 cells with a mass
    under `heavy` becomes one point at its mean; a heavier one gives its cells, so `heavy = 0` keeps every cell. Blocks
    that together hold no more than `negligible` are dropped, and the rest is renormalised.
    """
    half_x, half_y, half_z = (xs.size + 1) // 2, (ys.size + 1) // 2, (zs.size + 1) // 2
    floor = negligible / (half_x * half_y * half_z)
    n = 0
    total = 0.0
    block = np.zeros((half_x, 5))
    for bz in range(half_z):
        for by in range(half_y):
            _sum_blocks(probability, log_posterior, xs, ys, zs, by, bz, block)
            for bx in range(half_x):
                mass = block[bx, 0]
                if mass <= floor:
                    continue
                total += mass
                if mass >= heavy:
                    n = _write_cells(probability, log_posterior, xs, ys, zs, bx, by, bz, points, n)
                    continue
                points[0, n], points[4, n] = mass, block[bx, 4]
                for axis in range(1, 4):
                    points[axis, n] = block[bx, axis] / mass
                n += 1
    for k in range(n):  # sum p ln p of the renormalised masses
        points[4, k] = (points[4, k] - points[0, k] * math.log(total)) / total
        points[0, k] /= total
    return n


@njit(cache=True, error_model="numpy")
def rate_bins(points: FloatArray, u: FloatArray, model: FloatArray, where: FloatArray) -> None:
    """Where among the bins the log mean rate at `u` lies for each of `points` (5, n): `where` (n,)."""
    drift_x, drift_y, inverse_lambda = model[0], model[1], model[2]
    log_strength, squared_clamp, background = math.log(model[3]), model[4] * model[4], model[5]
    x, y, z = points[1], points[2], points[3]
    for i in range(where.size):
        dx, dy, dz = u[0] - x[i], u[1] - y[i], u[2] - z[i]
        squared = max(dx * dx + dy * dy + dz * dz, squared_clamp)
        exponent = dx * drift_x + dy * drift_y - math.sqrt(squared) * inverse_lambda
        where[i] = log_strength - 0.5 * log(squared) + exponent
    if background > 0.0:
        for i in range(where.size):
            where[i] = log(exp(where[i]) + background)
    for i in range(where.size):
        where[i] = min(max((where[i] - BIN_LOWEST) * (1.0 / BIN_WIDTH), 0.0), N_BINS - 1.0001)


@njit(cache=True, error_model="numpy")
def expected_information(
    points: FloatArray,
    candidates: FloatArray,
    model: FloatArray,
    probability: FloatArray,
    entropy: FloatArray,
    n_outcomes: NDArray[np.int64],
    out: FloatArray,
) -> None:
    """Expected information, nats, of one reading at each of `candidates` (C, 3), m, for each sampling time: out (C, K).

    `points` (5, n) from `compress`; `model` (6,) as in `grid_kernels.update`; the rest are `PoissonTables`.
    """
    where = np.empty(points.shape[1])
    mass = np.empty(N_BINS)
    mixture = np.empty(N_OUTCOMES)
    weight = points[0]
    for c in range(candidates.shape[0]):
        rate_bins(points, candidates[c], model, where)
        mass[:] = 0.0
        for i in range(where.size):
            b = int(where[i])
            upper = weight[i] * (where[i] - b)
            mass[b] += weight[i] - upper
            mass[b + 1] += upper
        for k in range(out.shape[1]):
            used = 1
            known = 0.0
            mixture[:] = 0.0
            for b in range(N_BINS):
                if mass[b] > 0.0:
                    n = n_outcomes[k, b]
                    used = max(used, n)
                    known += mass[b] * entropy[k, b]
                    for d in range(n):
                        mixture[d] += mass[b] * probability[k, b, d]
            information = -known
            for d in range(used):
                if mixture[d] > 0.0:
                    information -= mixture[d] * math.log(mixture[d])
            out[c, k] = max(information, 0.0)


@njit(cache=True, error_model="numpy")
def expected_log_search_time(
    points: FloatArray,
    candidates: FloatArray,
    model: FloatArray,
    probability: FloatArray,
    n_outcomes: NDArray[np.int64],
    step: float,
    out: FloatArray,
) -> None:
    """E[J] of space-aware infotaxis (Loisy and Eloy 2022) over the outcomes of a reading at each candidate: out (C,).

    J = log2( D / step + 2^(H - 1) - 1/2 ), H in bits the entropy and D the mean Euclidean distance to the source, m,
    after the reading. Only the tables of the first sampling time are used; arguments as in `expected_information`.
    """
    where = np.empty(points.shape[1])
    bins = np.empty((N_BINS, 3))  # sums of w, of p ln p, and of w times the distance
    outcome = np.empty((N_OUTCOMES, 4))  # p_d, sums of P p ln p, of w P ln P, and of w P times the distance
    for c in range(candidates.shape[0]):
        rate_bins(points, candidates[c], model, where)
        bins[:] = 0.0
        for i in range(where.size):
            b = int(where[i])
            share = where[i] - b
            dx, dy = candidates[c, 0] - points[1, i], candidates[c, 1] - points[2, i]
            dz = candidates[c, 2] - points[3, i]
            weighted = points[0, i] * math.sqrt(dx * dx + dy * dy + dz * dz)
            for j, part in ((b, 1.0 - share), (b + 1, share)):
                bins[j, 0] += part * points[0, i]
                bins[j, 1] += part * points[4, i]
                bins[j, 2] += part * weighted
        outcome[:] = 0.0
        used = 1
        for b in range(N_BINS):
            if bins[b, 0] > 0.0:
                n = n_outcomes[0, b]
                used = max(used, n)
                for d in range(n):
                    p = probability[0, b, d]
                    outcome[d, 0] += p * bins[b, 0]
                    outcome[d, 1] += p * bins[b, 1]
                    outcome[d, 2] += bins[b, 0] * p * math.log(max(p, 1e-300))
                    outcome[d, 3] += p * bins[b, 2]
        out[c] = 0.0
        for d in range(used):
            p = outcome[d, 0]
            if p > 0.0:
                nats = max(math.log(p) - (outcome[d, 1] + outcome[d, 2]) / p, 0.0)
                remaining = outcome[d, 3] / (p * step) + 2.0 ** (nats / math.log(2.0) - 1.0) - 0.5
                out[c] += p * math.log2(max(remaining, 1e-12))


@njit(cache=True, error_model="numpy")
def discount(points: FloatArray, places: FloatArray, sampling_time: float, model: FloatArray) -> None:
    """Condition `points` (5, n), in place, on no hit in `sampling_time` s of sampling at each of `places` (M, 3), m.

    What others are about to learn is left out of what a reading here would tell. Only w changes (row 0).
    """
    drift_x, drift_y, inverse_lambda, strength, clamp = model[0], model[1], model[2], model[3], model[4]
    weight, x, y, z = points[0], points[1], points[2], points[3]
    scale = strength * sampling_time
    for m in range(places.shape[0]):
        for i in range(weight.size):
            dx, dy, dz = places[m, 0] - x[i], places[m, 1] - y[i], places[m, 2] - z[i]
            distance = max(math.sqrt(dx * dx + dy * dy + dz * dz), clamp)
            mean = scale / distance * exp(dx * drift_x + dy * drift_y - distance * inverse_lambda)
            weight[i] *= exp(-mean)
    total = 0.0
    for i in range(weight.size):
        total += weight[i]
    if total > 0.0:
        for i in range(weight.size):
            weight[i] /= total


@njit(cache=True, error_model="numpy")
def expected_distance(points: FloatArray, candidates: FloatArray, out: FloatArray) -> None:
    """Mean distance, m, from each of `candidates` (C, 3), m, to the source under `points` (5, n): out (C,)."""
    weight, x, y, z = points[0], points[1], points[2], points[3]
    each = np.empty(weight.size)
    for c in range(candidates.shape[0]):
        for i in range(weight.size):
            dx, dy, dz = candidates[c, 0] - x[i], candidates[c, 1] - y[i], candidates[c, 2] - z[i]
            each[i] = weight[i] * math.sqrt(dx * dx + dy * dy + dz * dz)
        out[c] = each.sum()
