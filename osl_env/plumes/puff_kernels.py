"""The puffs of a batch of worlds: their motion, release and end, and the concentration that they make together.

    c_k = m / ((2 pi)^{3/2} sy^2 sz) exp(-((x - x_k)^2 + (y - y_k)^2) / (2 sy^2))
          * [exp(-(h - h_k)^2 / (2 sz^2)) + exp(-(h + h_k)^2 / (2 sz^2))]                      (chemotaxis eq 2)

with h the height above the ground. The bracket is computed as exp(-(h - h_k)^2 / (2 sz^2)) (1 + exp(-2 h h_k /
sz^2)). The puffs of a world lie in a ring of releases: release number k is made at the time k `interval` by all
sources at once, and takes the place k mod capacity, whose puffs are then too old. So a puff's age follows from its
place, exactly.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from osl_env.air import Air, air_velocity
from osl_env.numerics import exp
from osl_env.parameters import FloatArray
from osl_env.plumes.dispersion import DispersionLaw, sigmas
from osl_env.state import BoolArray, IntArray

X, Y, Z, DISTANCE, MASS, AMPLITUDE, ACROSS, UP = range(8)  # what `PuffState.puffs` holds of a puff
BLOCK = 32  # places that are read together: neighbours, so that a puff far from them is told at once
_NORMALISATION = (2.0 * math.pi) ** -1.5
_SLACK = 1e-9  # of a number of intervals: rounding must not move a release to the next tick


class PuffState(NamedTuple):
    """The puffs of all worlds."""

    # (n_envs, 8, capacity n_sources): centre (m), distance travelled (m), mass m, m / ((2 pi)^{3/2} sy^2 sz),
    # 1 / (2 sy^2) and 1 / (2 sz^2) (1/m^2); a place without a puff has mass and amplitude 0
    puffs: FloatArray
    ticks: IntArray  # (n_envs,) since the world began
    newest: IntArray  # (n_envs,): number of the latest release


class PuffConstants(NamedTuple):
    """The parameters of the model for compiled code."""

    step: float  # s
    interval: float  # s between releases
    max_age: float  # s
    rise: float  # m/s, of a puff through the air
    calm_speed: float  # m/s: a puff spreads as if it travelled at least so fast
    ground: float  # m; -inf: none
    mass: float  # of a puff of a source with strength 1, in units of the reading times m^3
    limit: float  # cut_off^2 / 2
    steady_start: bool


@njit(inline="always", error_model="numpy")
def puff_concentration(
    dx: float,
    dy: float,
    dz: float,
    height: float,
    puff_height: float,
    amplitude: float,
    across: float,
    up: float,
    limit: float,
) -> float:
    """Eq 2 at the offset (dx, dy, dz), m, from a puff's centre; both heights are above the ground, m.

    Exactly zero below the ground and farther than the cut-off from the centre.
    """
    spread = (dx * dx + dy * dy) * across + dz * dz * up
    value = amplitude * exp(-spread) * (1.0 + exp(-4.0 * up * height * puff_height))
    return value if spread < limit and height >= 0.0 else 0.0


@njit(error_model="numpy")
def _move(p: Any, first: int, last: int, air: Any, e: int, c: Any, dt: float) -> None:
    """Carry the puffs from place `first` to before `last` of world `e` on by `dt` s in the present air (eq 3).

    Exact where the air is uniform, of second order in `dt` elsewhere.
    """
    if air.grid.shape[0] == 0:
        u, v, w = air.mean[e, 0], air.mean[e, 1], air.mean[e, 2]
        distance = max(math.sqrt(u * u + v * v + w * w), c.calm_speed) * dt
        for k in range(first, last):
            p[X, k] += u * dt
            p[Y, k] += v * dt
            p[Z, k] = max(p[Z, k] + (w + c.rise) * dt, c.ground)
            p[DISTANCE, k] += distance
        return
    half = 0.5 * dt
    for k in range(first, last):
        x, y, z = p[X, k], p[Y, k], p[Z, k]
        u, v, w = air_velocity(air, e, x, y, z)
        u, v, w = air_velocity(air, e, x + u * half, y + v * half, max(z + (w + c.rise) * half, c.ground))
        p[X, k] = x + u * dt
        p[Y, k] = y + v * dt
        p[Z, k] = max(z + (w + c.rise) * dt, c.ground)
        p[DISTANCE, k] += max(math.sqrt(u * u + v * v + w * w), c.calm_speed) * dt


@njit(inline="always", error_model="numpy")
def _release(p: Any, k: int, source: Any, mass: float) -> None:
    p[X, k], p[Y, k], p[Z, k] = source[0], source[1], source[2]
    p[DISTANCE, k] = 0.0
    p[MASS, k] = mass


@njit(inline="always", error_model="numpy")
def _empty(p: Any, k: int) -> None:
    p[MASS, k], p[AMPLITUDE, k] = 0.0, 0.0
    p[ACROSS, k], p[UP, k] = 1.0, 1.0


@njit(error_model="numpy")
def _spread(p: Any, n_sources: int, newest: int, time: float, law: Any, c: Any) -> None:
    """End the puffs that are too old, and find how wide the others are at `time` s."""
    capacity = p.shape[1] // n_sources
    for place in range(capacity):
        age = time - (newest - (newest - place) % capacity) * c.interval
        for k in range(place * n_sources, (place + 1) * n_sources):
            if p[MASS, k] == 0.0 or age > c.max_age + _SLACK * c.interval:
                _empty(p, k)
                continue
            sigma_y, sigma_z = sigmas(law, p[DISTANCE, k], age)
            p[AMPLITUDE, k] = p[MASS, k] * _NORMALISATION / (sigma_y * sigma_y * sigma_z)
            p[ACROSS, k] = 0.5 / (sigma_y * sigma_y)
            p[UP, k] = 0.5 / (sigma_z * sigma_z)


@njit(error_model="numpy")
def _begin_world(state: Any, air: Any, sources: Any, strengths: Any, law: Any, c: Any, e: int) -> None:
    p = state.puffs[e]
    n_sources = sources.shape[1]
    capacity = p.shape[1] // n_sources
    for k in range(p.shape[1]):
        _empty(p, k)
    state.ticks[e], state.newest[e] = 0, 0
    substeps = max(round(c.interval / c.step), 1) if air.grid.shape[0] > 0 else 1
    for s in range(n_sources):
        _release(p, s, sources[e, s], c.mass * strengths[e, s])
        # in air that does not change, a puff is where an older one was: one track gives them all
        for number in range(1, capacity if c.steady_start else 0):
            k = (capacity - number) * n_sources + s
            younger = s if number == 1 else k + n_sources
            for row in range(AMPLITUDE):
                p[row, k] = p[row, younger]
            for _ in range(substeps):
                _move(p, k, k + 1, air, e, c, c.interval / substeps)
    _spread(p, n_sources, 0, 0.0, law, c)


@njit(cache=True, error_model="numpy")
def begin(
    state: PuffState,
    air: Air,
    sources: FloatArray,
    strengths: FloatArray,
    law: DispersionLaw,
    c: PuffConstants,
    rows: IntArray,
) -> None:
    """The worlds `rows` at the moment of the first release; with a steady start, among the puffs of all ages."""
    for e in rows:
        _begin_world(state, air, sources, strengths, law, c, e)


@njit(error_model="numpy")
def _tick(state: Any, air: Any, sources: Any, strengths: Any, law: Any, c: Any, e: int) -> None:
    p = state.puffs[e]
    n_sources = sources.shape[1]
    capacity = p.shape[1] // n_sources
    _move(p, 0, p.shape[1], air, e, c, c.step)
    state.ticks[e] += 1
    time = state.ticks[e] * c.step
    latest = math.floor(time / c.interval + _SLACK)
    for number in range(max(state.newest[e] + 1, latest - capacity + 1), latest + 1):
        for s in range(n_sources):
            _release(p, (number % capacity) * n_sources + s, sources[e, s], c.mass * strengths[e, s])
        k = (number % capacity) * n_sources
        _move(p, k, k + n_sources, air, e, c, max(time - number * c.interval, 0.0))
    state.newest[e] = latest
    _spread(p, n_sources, latest, time, law, c)


@njit(cache=True, error_model="numpy")
def advance(
    state: PuffState,
    air: Air,
    sources: FloatArray,
    strengths: FloatArray,
    law: DispersionLaw,
    c: PuffConstants,
    due: BoolArray,
) -> None:
    """One tick of the worlds of `due`: move, release, end, spread."""
    for e in range(due.size):
        if due[e]:
            _tick(state, air, sources, strengths, law, c, e)


@njit(cache=True, error_model="numpy")
def read(state: PuffState, c: PuffConstants, positions: FloatArray, due: BoolArray, out: FloatArray) -> None:
    """Concentration at `positions` (n_envs, n, 3) m in the worlds of `due`, into `out` (n_envs, n)."""
    n_places = state.puffs.shape[2]
    shares = np.empty(n_places)
    for e in range(due.size):
        if not due[e]:
            continue
        p = state.puffs[e]
        for i in range(positions.shape[1]):
            x, y, z = positions[e, i, 0], positions[e, i, 1], positions[e, i, 2]
            height = z - c.ground
            for k in range(n_places):
                shares[k] = puff_concentration(
                    x - p[X, k],
                    y - p[Y, k],
                    z - p[Z, k],
                    height,
                    p[Z, k] - c.ground,
                    p[AMPLITUDE, k],
                    p[ACROSS, k],
                    p[UP, k],
                    c.limit,
                )
            total = 0.0
            for k in range(n_places):  # in the order of their places: vectors must not change the sum
                total += shares[k]
            out[e, i] = total


@njit(error_model="numpy")
def _add_all(p: Any, c: Any, blocks: Any, boxes: Any, out: Any) -> None:
    """Add all puffs to the readings `out` (m, BLOCK) at `blocks` (m, 3, BLOCK) m of places, whose `boxes` are (m, 6) m.

    A puff touches the blocks whose box comes within its cut-off. Vectorised over the places of a block.
    """
    ground, limit = c.ground, c.limit
    for k in range(p.shape[1]):
        x, y, z, amplitude, across, up = p[X, k], p[Y, k], p[Z, k], p[AMPLITUDE, k], p[ACROSS, k], p[UP, k]
        if amplitude == 0.0:
            continue
        puff_height = z - ground
        for b in range(boxes.shape[0]):
            dx = max(boxes[b, 0] - x, x - boxes[b, 3], 0.0)
            dy = max(boxes[b, 1] - y, y - boxes[b, 4], 0.0)
            dz = max(boxes[b, 2] - z, z - boxes[b, 5], 0.0)
            if (dx * dx + dy * dy) * across + dz * dz * up >= limit:
                continue
            xs, ys, zs, readings = blocks[b, 0], blocks[b, 1], blocks[b, 2], out[b]
            for j in range(BLOCK):
                readings[j] += puff_concentration(
                    xs[j] - x, ys[j] - y, zs[j] - z, zs[j] - ground, puff_height, amplitude, across, up, limit
                )


@njit(cache=True, error_model="numpy")
def at(puffs: FloatArray, c: PuffConstants, blocks: FloatArray, boxes: FloatArray, out: FloatArray) -> None:
    """Concentration of a world's `puffs` (8, n) at `blocks` (m, 3, BLOCK) m of places, into `out` (m, BLOCK)."""
    out[:] = 0.0
    _add_all(puffs, c, blocks, boxes, out)


@njit(cache=True, error_model="numpy")
def series(
    state: PuffState,
    air: Air,
    sources: FloatArray,
    strengths: FloatArray,
    law: DispersionLaw,
    c: PuffConstants,
    winds: FloatArray,
    blocks: FloatArray,
    boxes: FloatArray,
    order: IntArray,
    out: FloatArray,
) -> None:
    """Tick the one world of `state` through `winds` (n, 3) m/s; after each, the readings go to `out` (n, places)."""
    readings = np.empty((boxes.shape[0], BLOCK))
    air.mean[0] = winds[0]
    _begin_world(state, air, sources, strengths, law, c, 0)
    for n in range(winds.shape[0]):
        air.mean[0] = winds[n]
        _tick(state, air, sources, strengths, law, c, 0)
        readings[:] = 0.0
        _add_all(state.puffs[0], c, blocks, boxes, readings)
        for j in range(order.size):
            out[n, order[j]] = readings[j // BLOCK, j % BLOCK]
