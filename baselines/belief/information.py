"""What a sample at another place is expected to bring: entropy reduction, and distance to the posterior mean.

For a belief of particles o_n with weights w_n, a candidate position u' and the predictive p_d = sum_n w_n p(d | n),
the two expectations of MUC-OSL eq 24 reduce exactly to sums without any posterior being formed:

    H - E[H'] = sum_d ( sum_n w_n p(d|n) ln p(d|n) - p_d ln p_d )
    E[D']     = sum_d | sum_n w_n p(d|n) (o_n - u') |

The first is the paper page's H(w) - E[H'] = H(p_d) - sum_n w_n h(m_n) with the Poisson entropy h written out over d,
so that both sides stop at the same d: every term is >= 0 and what is left out is too. With m_n the mean number of
hits, ln p(d|n) = d ln m_n - m_n - ln d! and m_n p(d|n) = (d + 1) p(d + 1 | n), so that term d needs only p_d, p_(d+1)
and sum_n w_n p(d|n) ln m_n, and p(d + 1 | n) follows from p(d | n) by one multiplication. The sums over d end where
the predictive's cumulative probability reaches `cumulative` for all candidates; the rest counts as one more outcome
for E[D'].

Candidates are worked on in blocks of `LANES`, side by side in memory: the inner loops run over candidates, so that they
vectorise without reordering any sum, and results do not depend on the processor's vector length.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from baselines.belief.likelihood import LEAST_MEAN, HitModel, hits_per_second, log
from osl_env.numerics import exp
from osl_env.parameters import FloatArray

LANES = 32  # candidates worked on together
MOST_HITS = 2000  # sums over d never go beyond
_LN2 = math.log(2.0)


def poisson_entropy(mean: FloatArray) -> FloatArray:
    """Entropy, nats, of Poisson laws with `mean` >= 0 of any shape, by summation."""
    means = np.asarray(mean, dtype=np.float64)
    most = int(np.max(means, initial=0.0) + 12.0 * math.sqrt(np.max(means, initial=0.0) + 1.0) + 20.0)
    log_mean = np.log(np.maximum(means, LEAST_MEAN))
    entropy = np.zeros(means.shape)
    for d in range(most + 1):
        log_probability = d * log_mean - means - math.lgamma(d + 1.0)
        entropy -= np.exp(log_probability) * log_probability
    return np.where(means > 0.0, entropy, 0.0)


@njit(cache=True, error_model="numpy")
def _prepare(
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    weights: FloatArray,
    lanes: FloatArray,
    work: FloatArray,
    sums: FloatArray,
    model: HitModel,
) -> None:
    """Fill `work` (n, 3 LANES) with mean hits, their logarithm and w p(0|n), and `sums` with p_0.

    `lanes` (4 LANES) holds the candidates' x, y, z (m) and sampling times (s).
    """
    for k in range(LANES):
        sums[k] = 0.0
    for n in range(x.shape[0]):
        px, py, pz, weight = x[n], y[n], z[n], weights[n]
        row = work[n]
        for k in range(LANES):
            rate = hits_per_second(lanes[k] - px, lanes[LANES + k] - py, lanes[2 * LANES + k] - pz, model)
            row[k] = max(rate * lanes[3 * LANES + k], LEAST_MEAN)
        for k in range(LANES):
            row[LANES + k] = log(row[k])
            row[2 * LANES + k] = weight * exp(-row[k])
        for k in range(LANES):
            sums[k] += row[2 * LANES + k]


@njit(cache=True, error_model="numpy")
def _advance(x: FloatArray, y: FloatArray, z: FloatArray, work: FloatArray, sums: FloatArray, d: int) -> None:
    """Sum w p(d|n) ln m, w p(d|n) o and w p(d+1|n) over particles into `sums`, and put w p(d+1|n) into `work`."""
    share = 1.0 / (d + 1.0)
    for k in range(LANES, 6 * LANES):
        sums[k] = 0.0
    for n in range(x.shape[0]):
        px, py, pz = x[n], y[n], z[n]
        row = work[n]
        for k in range(LANES):
            joint = row[2 * LANES + k]
            after = joint * row[k] * share
            row[2 * LANES + k] = after
            sums[LANES + k] += joint * row[LANES + k]
            sums[2 * LANES + k] += joint * px
            sums[3 * LANES + k] += joint * py
            sums[4 * LANES + k] += joint * pz
            sums[5 * LANES + k] += after


@njit(cache=True, error_model="numpy")
def _add_outcome(lanes: FloatArray, sums: FloatArray, totals: FloatArray, d: int, log_factorial: float) -> None:
    """Add outcome d to `totals`: information, distance, probability, moments (3); p_(d+1) takes p_d's place."""
    for k in range(LANES):
        p = sums[k]
        after = sums[5 * LANES + k]
        surprise = p * (log_factorial + log(max(p, LEAST_MEAN)))
        totals[k] += d * sums[LANES + k] - (d + 1.0) * after - surprise
        mx = sums[2 * LANES + k] - p * lanes[k]
        my = sums[3 * LANES + k] - p * lanes[LANES + k]
        mz = sums[4 * LANES + k] - p * lanes[2 * LANES + k]
        totals[LANES + k] += math.sqrt(mx * mx + my * my + mz * mz)
        totals[2 * LANES + k] += p
        totals[3 * LANES + k] += mx
        totals[4 * LANES + k] += my
        totals[5 * LANES + k] += mz
        sums[k] = after


@njit(cache=True, error_model="numpy")
def _load_lanes(candidates: FloatArray, sampling_times: FloatArray, first: int, used: int, lanes: FloatArray) -> None:
    """Fill `lanes` with `used` candidates from number `first` on; spare lanes repeat the last one."""
    for k in range(LANES):
        source = first + min(k, used - 1)
        for axis in range(3):
            lanes[axis * LANES + k] = candidates[source, axis]
        lanes[3 * LANES + k] = sampling_times[source]


@njit(cache=True, error_model="numpy")
def expected_reductions(
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    weights: FloatArray,
    candidates: FloatArray,
    sampling_times: FloatArray,
    model: HitModel,
    cumulative: float,
    information: FloatArray,
    distance: FloatArray,
) -> None:
    """Expected entropy reduction, nats, and distance to the posterior mean, m, after a sample at each candidate.

    Particles x, y, z (n,), m, with normalised `weights` (n,); `candidates` (K, 3), m; `sampling_times` (K,), s.
    Results go to `information` (K,) and `distance` (K,).
    """
    n = x.shape[0]
    work = np.empty((n, 3 * LANES))
    sums, totals, lanes = np.empty(6 * LANES), np.empty(6 * LANES), np.empty(4 * LANES)
    mx = my = mz = 0.0
    for i in range(n):
        mx += weights[i] * x[i]
        my += weights[i] * y[i]
        mz += weights[i] * z[i]
    for first in range(0, candidates.shape[0], LANES):
        used = min(LANES, candidates.shape[0] - first)
        _load_lanes(candidates, sampling_times, first, used, lanes)
        totals[:] = 0.0
        _prepare(x, y, z, weights, lanes, work, sums, model)
        log_factorial = 0.0
        for d in range(MOST_HITS):
            _advance(x, y, z, work, sums, d)
            _add_outcome(lanes, sums, totals, d, log_factorial)
            if totals[2 * LANES : 3 * LANES].min() >= cumulative:
                break
            log_factorial += math.log(d + 1.0)
        for k in range(used):
            information[first + k] = max(totals[k], 0.0)
            rx = mx - lanes[k] - totals[3 * LANES + k]  # what the outcomes left out hold of the mean
            ry = my - lanes[LANES + k] - totals[4 * LANES + k]
            rz = mz - lanes[2 * LANES + k] - totals[5 * LANES + k]
            distance[first + k] = totals[LANES + k] + math.sqrt(rx * rx + ry * ry + rz * rz)
