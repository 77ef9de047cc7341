"""Metropolis-Hastings over the seven parameters of a source term's shape, on the unit cube of their uniform prior.

Several walkers take turns. A proposal is, with the probability `redraw`, a new position from the prior, which carries
a walker between separate modes; else a step along differences of states in an archive,

    m' = m + gamma sum_{j=1}^{J} (z_j1 - z_j2) + e   on a random subset of d parameters,   gamma = g 2.38 / sqrt(2 J d)

(differential evolution from past states: ter Braak and Vrugt 2008; random subsets: Vrugt et al. 2009): steps take the
posterior's own scales and correlations, without a covariance to fit. Every tenth step has gamma = 1, a jump between
modes that the archive holds. During the burn-in the archive takes in the walkers' states, g is tuned towards an
acceptance of `TARGET`, and the likelihood is tempered, which frees walkers from modes that the map has left. Then all
of that is fixed, so that every proposal is symmetric and what is kept is a Markov chain in detailed balance. Proposals
out of the cube are refused.

Q is drawn for every kept state from its own conditional distribution: see `baselines.gaslam.source_model`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from baselines.gaslam.source_model import FLAT, SHAPE, Columns, log_marginal, parabola
from osl_env.numerics import exp, normal, uniform
from osl_env.parameters import FloatArray

TARGET = 0.25  # acceptance of the steps
_POSITION = 3  # the first three parameters are the source's position
_OPTIMAL = 2.38  # Roberts, Gelman and Gilks 1997
_WHOLE_STEPS = 0.1  # share of steps with gamma = 1
_MOST_PAIRS = 3
_JITTER = 1e-4  # of the prior's interval: e, without which only combinations of archived differences were reached
_LEAST_SCALE, _LARGEST_SCALE = 0.01, 2.0  # of g
_COOLING = 0.4  # share of the burn-in over which the temperature falls to 1
_REDRAW, _STEP, _JUMP = 0, 1, 2  # kinds of proposals


class Prior(NamedTuple):
    """The intervals of Q, x_s, y_s, z_s, a_y, b_y, a_z, b_z over which the prior is uniform."""

    low: FloatArray  # (8,)
    side: FloatArray  # (8,) >= 0


class Walk(NamedTuple):
    """How the walkers move."""

    burn_in: int  # iterations
    archived_every: int  # iterations of the burn-in
    temperature: float  # at the start of the burn-in
    redraw: float  # probability


@njit(inline="always", error_model="numpy")
def _index(stream: np.uint64, n: int) -> tuple[np.uint64, int]:
    """The stream's new state and a draw from 0 .. n - 1."""
    stream, draw = uniform(stream)
    return stream, min(int(draw * n), n - 1)


@njit(cache=True, error_model="numpy")
def cut_normal(stream: np.uint64, low: float, high: float) -> tuple[np.uint64, float]:
    """The stream's new state and a standard normal draw given that it is in [low, high] (Robert 1995)."""
    sign = 1.0
    if high < 0.0:
        low, high, sign = -high, -low, -1.0
    alpha = 0.5 * (low + math.sqrt(low * low + 4.0))
    while True:
        if low <= 0.0 and high - low > math.sqrt(2.0 * math.pi):
            stream, x = normal(stream)
            if low <= x <= high:
                return stream, sign * x
            continue
        stream, draw = uniform(stream)
        if low <= 0.0:
            x = low + draw * (high - low)
            chance = exp(-0.5 * x * x)
        else:
            x = low - math.log1p(draw * math.expm1(-alpha * (high - low))) / alpha
            chance = exp(-0.5 * (x - alpha) ** 2)
        stream, draw = uniform(stream)
        if draw <= chance:
            return stream, sign * min(x, high)


@njit(cache=True, error_model="numpy")
def _release(stream: np.uint64, a: float, b: float, low: float, high: float) -> tuple[np.uint64, float]:
    """The stream's new state and a draw of Q from exp(b Q - a Q^2 / 2) on [low, high]."""
    root = math.sqrt(a)
    if max(root, abs(b)) * (high - low) < FLAT:
        stream, draw = uniform(stream)
        return stream, low + draw * (high - low)
    stream, x = cut_normal(stream, root * low - b / root, root * high - b / root)
    return stream, min(max((x + b / root) / root, low), high)


@njit(cache=True, error_model="numpy")
def _combine(stream: np.uint64, archive: FloatArray, filled: int, pairs: int, total: FloatArray) -> np.uint64:
    """Write the sum of `pairs` differences between rows of `archive` (m, 7) to `total` (7,); the stream's new state."""
    total[:] = 0.0
    for _ in range(pairs):
        stream, first = _index(stream, filled)
        stream, second = _index(stream, filled)
        for i in range(SHAPE):
            total[i] += archive[first, i] - archive[second, i]
    return stream


@njit(cache=True, error_model="numpy")
def _propose(
    stream: np.uint64,
    here: FloatArray,
    archive: FloatArray,
    filled: int,
    scale: float,
    redraw: float,
    there: FloatArray,
    moved: FloatArray,
) -> tuple[np.uint64, int]:
    """Write a proposal from `here` (7,) to `there`; the stream's new state and the kind. `moved` (7,) is scratch."""
    stream, draw = uniform(stream)
    if draw < redraw:
        there[:] = here
        for i in range(_POSITION):
            stream, there[i] = uniform(stream)
        return stream, _REDRAW
    stream, draw = uniform(stream)
    kind = _JUMP if draw < _WHOLE_STEPS else _STEP
    stream, pairs = _index(stream, _MOST_PAIRS)
    stream = _combine(stream, archive, filled, pairs + 1, there)
    stream, share = uniform(stream)
    stream, always = _index(stream, SHAPE)
    d = 0.0
    for i in range(SHAPE):
        stream, draw = uniform(stream)
        moved[i] = 1.0 if draw < share or i == always else 0.0
        d += moved[i]
    gamma = 1.0 if kind == _JUMP else scale * _OPTIMAL / math.sqrt(2.0 * (pairs + 1) * d)
    for i in range(SHAPE):
        stream, draw = uniform(stream)
        there[i] = here[i] + moved[i] * (gamma * there[i] + _JITTER * (draw - 0.5))
    return stream, kind


@njit(cache=True, error_model="numpy")
def _evaluate(unit: FloatArray, prior: Prior, columns: Columns, scratch: FloatArray, state: FloatArray) -> None:
    """Write log posterior density of `unit` (7,) and a, b of its parabola to `state` (3,); -inf out of the cube.

    `scratch` is (5, at least c and 7).
    """
    shape = scratch[4, :SHAPE]
    for i in range(SHAPE):
        if not 0.0 <= unit[i] <= 1.0:
            state[0] = -np.inf
            return
        shape[i] = prior.low[1 + i] + prior.side[1 + i] * unit[i]
    state[1], state[2] = parabola(shape, columns, scratch)
    state[0] = log_marginal(state[1], state[2], prior.low[0], prior.low[0] + prior.side[0])


@njit(cache=True, error_model="numpy")
def log_densities(units: FloatArray, prior: Prior, columns: Columns, out: FloatArray) -> None:
    """Write the log posterior density, up to a constant, of each of `units` (k, 7) to `out` (k,)."""
    scratch, state = np.empty((5, max(columns.downwind.size, SHAPE))), np.empty(3)
    for k in range(out.size):
        _evaluate(units[k], prior, columns, scratch, state)
        out[k] = state[0]


@njit(cache=True, error_model="numpy")
def _keep(
    stream: np.uint64, unit: FloatArray, state: FloatArray, prior: Prior, row: FloatArray
) -> tuple[np.uint64, float]:
    """Write the source term of a walker at `unit` (7,), with a draw of Q, to `row` (8,).

    Returns the stream's new state and the log likelihood, up to a constant.
    """
    stream, release = _release(stream, state[1], state[2], prior.low[0], prior.low[0] + prior.side[0])
    row[0] = release
    for i in range(SHAPE):
        row[1 + i] = prior.low[1 + i] + prior.side[1 + i] * unit[i]
    return stream, release * (state[2] - 0.5 * release * state[1])


@njit(cache=True, error_model="numpy")
def _tuned(scale: float, took: float, steps: int) -> float:
    """g after the step number `steps`, accepted with the probability `took` (Robbins and Monro)."""
    rate = 2.0 / max(steps, 30) ** 0.6
    return min(max(scale * exp((took - TARGET) * rate), _LEAST_SCALE), _LARGEST_SCALE)


@njit(cache=True, error_model="numpy")
def walk(
    stream: np.uint64,
    walkers: FloatArray,
    archive: FloatArray,
    filled: int,
    scale: float,
    prior: Prior,
    columns: Columns,
    how: Walk,
    chain: FloatArray,
    log_likelihood: FloatArray,
    tally: FloatArray,
) -> float:
    """Burn in, then fill `chain` (k, 8), walker after walker, and `log_likelihood` (k,), up to a constant.

    `walkers` (w, 7) and `archive` (m, 7), of which the first `filled` rows hold states, are on the unit cube and are
    changed in place; `scale` is g, and its last value is returned. `tally` (3, 2) gets the proposals and acceptances,
    after the burn-in, of redraws, steps and jumps.
    """
    scratch = np.empty((5, max(columns.downwind.size, SHAPE)))
    states, new, there, moved = np.empty((len(walkers), 3)), np.empty(3), np.empty(SHAPE), np.empty(SHAPE)
    for w in range(len(walkers)):
        _evaluate(walkers[w], prior, columns, scratch, states[w])
    put = steps = 0
    for n in range(how.burn_in + len(chain)):
        w, k = n % len(walkers), n - how.burn_in
        temperature = max(how.temperature ** (1.0 - n / (_COOLING * how.burn_in)), 1.0) if k < 0 else 1.0
        stream, kind = _propose(stream, walkers[w], archive, filled, scale, how.redraw, there, moved)
        _evaluate(there, prior, columns, scratch, new)
        took = exp(min(new[0] - states[w, 0], 0.0) / temperature) if new[0] > -np.inf else 0.0
        stream, draw = uniform(stream)
        if draw < took:
            walkers[w] = there
            states[w] = new
        if k >= 0:
            tally[kind, 0] += 1.0
            tally[kind, 1] += 1.0 if draw < took else 0.0
            stream, log_likelihood[k] = _keep(stream, walkers[w], states[w], prior, chain[k])
            continue
        if kind == _STEP:
            steps += 1
            scale = _tuned(scale, took, steps)
        if n % how.archived_every == 0:
            archive[put % len(archive)] = walkers[w]
            put += 1
            filled = max(filled, min(put, len(archive)))
    return scale
