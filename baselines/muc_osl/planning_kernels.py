"""Compiled decisions: the best of the 26 neighbours, and the length of the leg."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from baselines.belief.information import expected_reductions
from baselines.belief.likelihood import HitModel
from baselines.belief.particle_filter import WEIGHT, X, Y, Z
from osl_env.actions import HOP_DIRECTIONS
from osl_env.numerics import uniform
from osl_env.parameters import FloatArray

STAY = len(HOP_DIRECTIONS)  # the 27th candidate
_OFFSETS = np.vstack([HOP_DIRECTIONS, np.zeros(3)])
_BOUND_SLACK = 1e-9  # m
_TIE = 1e-12  # relative


@njit(cache=True, error_model="numpy")
def is_inside(x: float, y: float, z: float, area: FloatArray) -> bool:
    """Whether (x, y, z), m, lies in [0, `area`] (3,), rounding forgiven."""
    low, high_x, high_y, high_z = -_BOUND_SLACK, area[0] + _BOUND_SLACK, area[1] + _BOUND_SLACK, area[2] + _BOUND_SLACK
    return bool(low <= x <= high_x and low <= y <= high_y and low <= z <= high_z)


@njit(cache=True, error_model="numpy")
def place(position: FloatArray, direction: int, distance: float) -> tuple[float, float, float]:
    """The place, m, that is `distance` (m, times the offset's length) from `position` (3,) in `direction`."""
    offset = _OFFSETS[direction]
    return position[0] + distance * offset[0], position[1] + distance * offset[1], position[2] + distance * offset[2]


@njit(cache=True, error_model="numpy")
def _best_of(scores: FloatArray, random: NDArray[np.uint64]) -> int:
    """The index of the greatest of `scores` (n,); one of them at random where several are."""
    best = scores.max()
    slack = _TIE * (abs(best) + 1.0)
    ties, chosen = 0, 0
    for k in range(scores.shape[0]):
        if scores[k] >= best - slack:
            ties += 1
            random[0], u = uniform(random[0])
            if u * ties < 1.0:
                chosen = k
    return chosen


@njit(cache=True, error_model="numpy")
def best_direction(
    cloud: FloatArray,
    position: FloatArray,
    hop: float,
    hovering: bool,
    sampling_time: float,
    model: HitModel,
    cumulative: float,
    information_weight: float,
    distance_weight: float,
    area: FloatArray,
    random: NDArray[np.uint64],
    reach: NDArray[np.int64],
) -> int:
    """The direction with the greatest information_weight * (H - E[H']) - distance_weight * E[D'], or `STAY`.

    Candidates are `hop` m (times 1, sqrt 2 or sqrt 3) from `position` (3,), m, inside the area, and not behind an
    obstacle (`reach` (27,): hops until there is one); staying is one with `hovering`, or where nothing else is left.
    Ties, as in a cloud that has collapsed, are broken at random.
    """
    candidates, kept = np.empty((STAY + 1, 3)), np.empty(STAY + 1, np.int64)
    count = 0
    for k in range(STAY + 1):
        x, y, z = place(position, k, hop)
        if is_inside(x, y, z, area) and (k < STAY or hovering) and reach[k] > 0:
            candidates[count, 0], candidates[count, 1], candidates[count, 2] = x, y, z
            kept[count] = k
            count += 1
    if count == 0:
        return STAY
    times = np.full(count, sampling_time)
    information, distance = np.empty(count), np.empty(count)
    expected_reductions(
        cloud[X], cloud[Y], cloud[Z], cloud[WEIGHT], candidates[:count], times, model, cumulative, information, distance
    )
    scores = information_weight * information - distance_weight * distance
    return int(kept[_best_of(scores, random)])


@njit(cache=True, error_model="numpy")
def best_length(
    position: FloatArray,
    direction: int,
    hop: float,
    longest: int,
    mean: FloatArray,
    history: FloatArray,
    revisit_weight: float,
    area: FloatArray,
) -> int:
    """The leg's length l in 1 .. `longest` hops with the least R(l) = D(l) + h2 Z(l) (MUC-OSL eqs 27, 28).

    D(l) is the distance, m, from u(l) to `mean` (3,); Z(l) counts the points of `history` (n, 3), m, in the sphere
    whose diameter runs from `position` to u(l) but not in that of l - 1. q = p - u is in it where |q|^2 <= l q . e,
    with e one hop; a point at u itself (q = 0) is the current one and is not counted.
    """
    ex, ey, ez = hop * _OFFSETS[direction, 0], hop * _OFFSETS[direction, 1], hop * _OFFSETS[direction, 2]
    visits = np.zeros(longest + 1)
    for n in range(history.shape[0]):
        qx, qy, qz = history[n, 0] - position[0], history[n, 1] - position[1], history[n, 2] - position[2]
        along = qx * ex + qy * ey + qz * ez
        squared = qx * qx + qy * qy + qz * qz
        if 0.0 < squared <= longest * along:
            visits[min(max(math.ceil(squared / along - 1e-12), 1), longest)] += 1.0
    best, chosen = math.inf, 1
    for length in range(1, longest + 1):
        x, y, z = place(position, direction, length * hop)
        if not is_inside(x, y, z, area):
            break
        dx, dy, dz = x - mean[0], y - mean[1], z - mean[2]
        score = math.sqrt(dx * dx + dy * dy + dz * dz) + revisit_weight * visits[length]
        if score < best:
            best, chosen = score, length
    return chosen


@njit(cache=True, error_model="numpy")
def adaptive_leg(
    cloud: FloatArray,
    gaussian: FloatArray,
    position: FloatArray,
    history: FloatArray,
    hop: float,
    longest: int,
    hovering: bool,
    sampling_time: float,
    model: HitModel,
    cumulative: float,
    spread_weight: float,
    revisit_weight: float,
    area: FloatArray,
    random: NDArray[np.uint64],
    reach: NDArray[np.int64],
) -> tuple[int, int]:
    """Direction and length of an Adap-PP leg (eqs 21 to 28), with h1 = `spread_weight` * sqrt(tr Sigma).

    `reach` (27,): how many hops there are in each direction until an obstacle is in the way.
    """
    spread = math.sqrt(max(gaussian[3] + gaussian[7] + gaussian[11], 0.0))
    h1 = spread_weight * spread
    direction = best_direction(
        cloud, position, hop, hovering, sampling_time, model, cumulative, h1, 1.0, area, random, reach
    )
    if direction == STAY:
        return direction, 0
    mean, longest = gaussian[:3], min(longest, reach[direction])
    return direction, best_length(position, direction, hop, longest, mean, history, revisit_weight, area)
