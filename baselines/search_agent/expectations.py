"""What sampling at a place is expected to bring, under a belief given as weighted places. Compiled, single precision.

A reading over t s is sorted into no hit, one hit, more hits. With m_i = R(u | place i) t the mean count and w_i the
weights, sum 1:

    q0_i = e^-m_i,   q1_i = m_i e^-m_i,   q2_i = 1 - q0_i - q1_i,      q = sum_i w_i q_i
    information = H(q) - sum_i w_i H(q_i)                             nats, a lower bound of the full reading's

and the spread sqrt(tr Sigma) after no hit and after a hit follows from the same sums with the places' moments.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from baselines.search_agent.single_precision import exp32, log32

N_TERMS = 8
_LEAST = np.float32(1e-20)
_ONE, _ZERO = np.float32(1.0), np.float32(0.0)


@njit(inline="always", error_model="numpy")
def sum32(row: Any) -> float:
    """The sum of the entries of `row`, a multiple of eight: eight running sums, which vectorise."""
    a, b, c, d, e, f, g, h = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
    for i in range(0, row.size, 8):
        a += row[i]
        b += row[i + 1]
        c += row[i + 2]
        d += row[i + 3]
        e += row[i + 4]
        f += row[i + 5]
        g += row[i + 6]
        h += row[i + 7]
    return float((a + b) + (c + d)) + float((e + f) + (g + h))


@njit(error_model="numpy")
def mean_counts(x: Any, y: Any, z: Any, u: Any, seconds: float, model: Any, out: Any) -> None:
    """Mean hits in `seconds` at `u` (3,), m, for a source at each of (x, y, z) (P,): out (P,). `model` (6,)."""
    drift_x, drift_y, inverse_lambda = np.float32(model[0]), np.float32(model[1]), np.float32(model[2])
    scale, clamp, noise = np.float32(model[3] * seconds), np.float32(model[4]), np.float32(model[5] * seconds)
    ux, uy, uz = np.float32(u[0]), np.float32(u[1]), np.float32(u[2])
    for i in range(out.size):
        dx, dy, dz = ux - x[i], uy - y[i], uz - z[i]
        distance = max(np.float32(math.sqrt(dx * dx + dy * dy + dz * dz)), clamp)
        out[i] = scale / distance * exp32(dx * drift_x + dy * drift_y - distance * inverse_lambda) + noise


@njit(error_model="numpy")
def discount(weight: Any, counts: Any) -> None:
    """Condition `weight` (P,), in place and not normalised, on no hit where `counts` (P,) are the mean hits."""
    for i in range(weight.size):
        weight[i] *= exp32(-counts[i])


@njit(inline="always", error_model="numpy")
def _entropy(p: float) -> float:
    return -p * math.log(p) if p > 1e-12 else 0.0


@njit(error_model="numpy")
def information(counts: Any, weight: Any, terms: Any) -> tuple[float, float]:
    """(probability of a hit, expected information in nats) for mean `counts` (P,) under `weight` (P,), sum 1.

    `terms` (N_TERMS, P) is room to work in; its row 0 holds w q0 afterwards.
    """
    for i in range(counts.size):
        m, w = max(counts[i], _LEAST), weight[i]
        none = exp32(-m)
        one = m * none
        more = max(_ONE - none - one, _LEAST)
        terms[0, i] = w * none
        terms[1, i] = w * one
        terms[2, i] = w * (m * none - one * (log32(m) - m) - more * log32(more))  # w H(q_i); -q0 ln q0 = m q0
    p_none, p_one = sum32(terms[0]), sum32(terms[1])
    p_more = max(1.0 - p_none - p_one, 0.0)
    gained = _entropy(p_none) + _entropy(p_one) + _entropy(p_more) - sum32(terms[2])
    return max(1.0 - p_none, 0.0), max(gained, 0.0)


@njit(inline="always", error_model="numpy")
def _spread(mass: float, x: float, y: float, z: float, squared: float) -> float:
    if mass < 1e-9:
        return 0.0
    return math.sqrt(max(squared / mass - (x * x + y * y + z * z) / (mass * mass), 0.0))


@njit(error_model="numpy")
def expected_spread(x: Any, y: Any, z: Any, squared: Any, moments: Any, terms: Any) -> float:
    """Expected sqrt(tr Sigma), m, after a reading whose w q0 is row 0 of `terms` (see `information`).

    x, y, z, squared (P,): the places about their mean, m, and their squared length; `moments` (5,): the sums of w and
    of w times each of these.
    """
    for i in range(x.size):
        w = terms[0, i]
        terms[3, i], terms[4, i], terms[5, i], terms[6, i] = w * x[i], w * y[i], w * z[i], w * squared[i]
    mass, sx, sy, sz, s2 = sum32(terms[0]), sum32(terms[3]), sum32(terms[4]), sum32(terms[5]), sum32(terms[6])
    hit = moments[0] - mass
    without = _spread(mass, sx, sy, sz, s2)
    with_hit = _spread(hit, moments[1] - sx, moments[2] - sy, moments[3] - sz, moments[4] - s2)
    return float(mass * without + max(hit, 0.0) * with_hit)
