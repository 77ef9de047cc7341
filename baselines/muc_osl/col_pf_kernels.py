"""Compiled steps of Col-PF: powers of neighbours' readings, movement of particles, the whole update in one call."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from baselines.belief.gaussian_fit import fit_gaussian, kl_divergence
from baselines.belief.likelihood import HitModel
from baselines.belief.particle_filter import (
    ROWS,
    WEIGHT,
    X,
    Y,
    Z,
    fill_normal,
    needs_resampling,
    resample,
    weigh,
)
from osl_env.numerics import uniform
from osl_env.parameters import FloatArray

SYMMETRIC_SCALE = 12.0  # the default beta is exp(-(KL_ij + KL_ji) / 12), the paper page's reading
_LEAST_DISTANCE = 1e-3  # m, in f_dist
NO_UPDATE, JITTER, UPWIND, PRINTED = range(4)  # kinds of environment update (eq 16)


class Step(NamedTuple):
    """What one Col-PF update is to do, as plain numbers."""

    resample_below: float  # share of N
    redraw: bool  # draw the particles anew at the end of every iteration
    full_count: float  # N that eq 18 scales, times 1 - f_cue
    least_count: int
    most_count: int
    nearness: bool  # whether f_dist scales it
    printed_beta: bool  # exp(-KL_ij) instead of the symmetric default
    moved_share: float  # N_s / N (eq 15)
    update: int  # kind of environment update
    update_length: float  # m
    upwind_x: float  # unit vector against the wind; zero without wind
    upwind_y: float
    attracted_share: float  # of the moved particles that are drawn to gbest (eq 17); 0 once the UAV has had a detection
    summed_attraction: bool  # gbest not divided by the sum of betas


@njit(cache=True, error_model="numpy")
def sharing_powers(own: FloatArray, neighbours: FloatArray, printed: bool, powers: FloatArray) -> None:
    """Write beta_ij (eq 10) of the Gaussian `own` (12,) with each of `neighbours` (F, 12) to `powers` (F,).

    A frame without a Gaussian (NaN) counts fully: it is a measurement like any other.
    """
    for j in range(neighbours.shape[0]):
        other = neighbours[j]
        if printed:
            power = math.exp(-kl_divergence(own, other))
        else:
            power = math.exp(-(kl_divergence(own, other) + kl_divergence(other, own)) / SYMMETRIC_SCALE)
        powers[j] = power if math.isfinite(power) else 1.0


@njit(cache=True, error_model="numpy")
def attraction_point(
    neighbours: FloatArray, detected: NDArray[np.bool_], powers: FloatArray, summed: bool, point: FloatArray
) -> bool:
    """Write gbest, m, the beta-weighted mean of the means of neighbours that have `detected`, to `point` (3,).

    Returns False if there is none.
    """
    total = 0.0
    point[:] = 0.0
    for j in range(neighbours.shape[0]):
        if detected[j] and math.isfinite(neighbours[j, 0]):
            total += powers[j]
            for axis in range(3):
                point[axis] += powers[j] * neighbours[j, axis]
    if total <= 0.0:
        return False
    if not summed:
        for axis in range(3):
            point[axis] /= total
    return True


@njit(cache=True, error_model="numpy")
def _place(cloud: FloatArray, n: int, x: float, y: float, z: float, area: FloatArray) -> None:
    """Move particle n to (x, y, z), m, unless that is out of the area, where the prior is zero."""
    if 0.0 <= x <= area[0] and 0.0 <= y <= area[1] and 0.0 <= z <= area[2]:
        cloud[X, n], cloud[Y, n], cloud[Z, n] = x, y, z


@njit(cache=True, error_model="numpy")
def environment_update(
    cloud: FloatArray, moved: NDArray[np.int64], step: Step, area: FloatArray, random: NDArray[np.uint64]
) -> None:
    """env-pu (eq 16) on the particles `moved` (m,): jitter, an upwind step in metres, or as printed."""
    count = moved.shape[0]
    if step.update == JITTER:
        noise = np.empty(3 * count)
        fill_normal(noise, random)
        for i in range(count):
            n = moved[i]
            x = cloud[X, n] + step.update_length * noise[3 * i]
            y = cloud[Y, n] + step.update_length * noise[3 * i + 1]
            z = cloud[Z, n] + step.update_length * noise[3 * i + 2]
            _place(cloud, n, x, y, z, area)
    elif step.update != NO_UPDATE:
        state = random[0]
        for n in moved:
            state, u = uniform(state)
            scale_x = cloud[X, n] if step.update == PRINTED else step.update_length
            scale_y = cloud[Y, n] if step.update == PRINTED else step.update_length
            x = cloud[X, n] + u * scale_x * step.upwind_x
            y = cloud[Y, n] + u * scale_y * step.upwind_y
            _place(cloud, n, x, y, cloud[Z, n], area)
        random[0] = state


@njit(cache=True, error_model="numpy")
def attract(
    cloud: FloatArray,
    moved: NDArray[np.int64],
    point: FloatArray,
    area: FloatArray,
    random: NDArray[np.uint64],
) -> None:
    """col-pu (eq 17): o_n += rand (gbest - o_n) for the particles `moved`, with gbest `point` (3,), m."""
    state = random[0]
    for n in moved:
        state, u = uniform(state)
        x = cloud[X, n] + u * (point[0] - cloud[X, n])
        y = cloud[Y, n] + u * (point[1] - cloud[Y, n])
        z = cloud[Z, n] + u * (point[2] - cloud[Z, n])
        _place(cloud, n, x, y, z, area)
    random[0] = state


@njit(cache=True, error_model="numpy")
def _choose(count: int, chosen: int, random: NDArray[np.uint64]) -> NDArray[np.int64]:
    """`chosen` different indices below `count`, in random order (the first steps of Fisher and Yates' shuffle)."""
    order = np.arange(count)
    state = random[0]
    for i in range(chosen):
        state, u = uniform(state)
        j = i + int(u * (count - i))
        order[i], order[j] = order[j], order[i]
    random[0] = state
    return order[:chosen]


@njit(cache=True, error_model="numpy")
def next_count(gaussian: FloatArray, reading: FloatArray, step: Step) -> int:
    """N of eq 18, with f_dist from the mean of `gaussian` (12,) and the place of the UAV's own `reading` (6,)."""
    scaled = step.full_count
    if step.nearness:
        dx, dy, dz = reading[0] - gaussian[0], reading[1] - gaussian[1], reading[2] - gaussian[2]
        scaled *= math.exp(-1.0 / max(math.sqrt(dx * dx + dy * dy + dz * dz), _LEAST_DISTANCE))
    return min(max(int(scaled + 0.5), step.least_count), step.most_count)


@njit(cache=True, error_model="numpy")
def col_pf_update(
    cloud: FloatArray,
    gaussian: FloatArray,
    readings: FloatArray,
    neighbours: FloatArray,
    detected: NDArray[np.bool_],
    model: HitModel,
    step: Step,
    area: FloatArray,
    random: NDArray[np.uint64],
) -> tuple[FloatArray, float]:
    """One iteration of Col-PF (eqs 10 to 20): the new cloud (5, m) and its entropy, nats; `gaussian` (12,) is renewed.

    `readings` (1 + F, 6), the UAV's own first, then those of the frames whose Gaussians are `neighbours` (F, 12) and
    whose senders have `detected` (F,) something.
    """
    powers = np.ones(readings.shape[0])
    sharing_powers(gaussian, neighbours, step.printed_beta, powers[1:])
    entropy = weigh(cloud, readings, powers, model)
    due = needs_resampling(cloud, step.resample_below)
    if due:
        resample(cloud, cloud, random)
        entropy = math.log(cloud.shape[1])
    count = cloud.shape[1]
    moved = _choose(count, min(int(count * step.moved_share + 0.5), count), random)
    environment_update(cloud, moved, step, area, random)
    attracted = int(moved.shape[0] * step.attracted_share + 0.5)
    point = np.empty(3)
    if attracted > 0 and attraction_point(neighbours, detected, powers[1:], step.summed_attraction, point):
        attract(cloud, moved[:attracted], point, area, random)
    fit_gaussian(cloud[X], cloud[Y], cloud[Z], cloud[WEIGHT], gaussian)
    if due or step.redraw:
        drawn = np.empty((ROWS, next_count(gaussian, readings[0], step)))
        resample(cloud, drawn, random)
        cloud = drawn
        entropy = math.log(cloud.shape[1])
        fit_gaussian(cloud[X], cloud[Y], cloud[Z], cloud[WEIGHT], gaussian)
    return cloud, entropy
