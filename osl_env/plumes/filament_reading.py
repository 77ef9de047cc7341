"""Concentration of a world's filaments at points: the sum of truncated, renormalised Gaussians.

    c(x) = sum_i  m_i / (share (2 pi)^{3/2} sigma_i^3) * exp( -d_i^2 / (2 sigma_i^2) ),   d_i <= cut-off * sigma_i

(Farrell et al. 2002; GADEN), m_i the content of filament i, `share` the part of a Gaussian that is inside the
cut-off: the integral of c is what was released. Over a reflecting floor each filament has an image below it. With
line of sight, a filament counts only at places from which its centre is seen (`geometry`; None: nothing hides).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from osl_env.geometry import Geometry, clear_share
from osl_env.parameters import FloatArray
from osl_env.plumes.filament_blocks import (
    CONTENT,
    HIGH_X,
    HIGH_Y,
    HIGH_Z,
    LOW_X,
    LOW_Y,
    LOW_Z,
    SLOTS,
    VARIANCE,
    WIDEST,
    FilamentState,
    X,
    Y,
    Z,
)
from osl_env.plumes.filament_noise import BLOCK, exp_single
from osl_env.state import BoolArray

_F = np.float32
_HALF, _ZERO = _F(0.5), _F(0.0)


class Optics(NamedTuple):
    """How filaments are seen by a sensor."""

    cut_off: float  # in standard deviations
    mirrored: bool  # a reflecting floor at z = 0
    factor: float  # 1 / ((2 pi)^{3/2} share inside the cut-off)


def share_inside(cut_off: float) -> float:
    """The share of a Gaussian in three dimensions within `cut_off` standard deviations of its centre."""
    tail = math.sqrt(2.0 / math.pi) * cut_off * math.exp(-0.5 * cut_off**2)
    return math.erf(cut_off / math.sqrt(2.0)) - tail


def optics(cut_off: float, mirrored: bool) -> Optics:
    """Filaments that are seen within `cut_off` standard deviations, over a `mirrored` floor."""
    return Optics(cut_off, mirrored, 1.0 / (share_inside(cut_off) * (2.0 * math.pi) ** 1.5))


@njit(inline="always", error_model="numpy")
def _near_blocks(boxes: Any, n_blocks: int, reach: Any, x: Any, y: Any, z: Any, distances: Any, near: Any) -> int:
    """Blocks whose box is within `reach` (cut-off squared) variances of a place, into `near`; their number."""
    low_x, low_y, low_z = boxes[LOW_X], boxes[LOW_Y], boxes[LOW_Z]
    high_x, high_y, high_z = boxes[HIGH_X], boxes[HIGH_Y], boxes[HIGH_Z]
    widest = boxes[WIDEST]
    for b in range(n_blocks):
        dx = max(max(low_x[b] - x, x - high_x[b]), _ZERO)
        dy = max(max(low_y[b] - y, y - high_y[b]), _ZERO)
        dz = max(max(low_z[b] - z, z - high_z[b]), _ZERO)
        distances[b] = dx * dx + dy * dy + dz * dz - reach * widest[b]
    n = 0
    for b in range(n_blocks):
        near[n] = b
        n += 1 if distances[b] <= _ZERO else 0
    return n


@njit(inline="always", error_model="numpy")
def _contributions(bodies: Any, start: int, reach: Any, x: Any, y: Any, z: Any, parts: Any) -> None:
    """What each filament of a block adds at a place, without the constant factor."""
    xs, ys = bodies[X, start : start + BLOCK], bodies[Y, start : start + BLOCK]
    zs, variances = bodies[Z, start : start + BLOCK], bodies[VARIANCE, start : start + BLOCK]
    contents = bodies[CONTENT, start : start + BLOCK]
    for k in range(BLOCK):
        dx, dy, dz, variance = xs[k] - x, ys[k] - y, zs[k] - z, variances[k]
        square = dx * dx + dy * dy + dz * dz
        part = contents[k] / (variance * math.sqrt(variance)) * exp_single(-_HALF * square / variance)
        parts[k] = part if square <= reach * variance else _ZERO


@njit(error_model="numpy")
def _hide(bodies: Any, start: int, geometry: Any, x: float, y: float, z: float, parts: Any) -> None:
    """Take away what a wall hides from the place."""
    for k in range(BLOCK):
        if parts[k] > 0.0:
            there = bodies[:, start + k]
            if clear_share(geometry, x, y, z, float(there[X]), float(there[Y]), float(there[Z])) < 1.0:
                parts[k] = 0.0


@njit(inline="always", error_model="numpy")
def _add(parts: Any, sums: Any) -> None:
    for k in range(BLOCK):
        sums[k] += parts[k]


@njit(error_model="numpy")
def _total(sums: Any) -> float:
    """The sum of a row of BLOCK, by halving: the same on every machine, and in vectors."""
    half = BLOCK // 2
    while half > 0:
        for k in range(half):
            sums[k] += sums[k + half]
        half //= 2
    return float(sums[0])


@njit(error_model="numpy")
def _read_world(bodies: Any, boxes: Any, slots: int, geometry: Any, optics: Any, points: Any, out: Any) -> None:
    """The concentration of one world at `points` (n, 3) m, into `out` (n,)."""
    n_blocks = -(-slots // BLOCK)
    parts, sums = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    distances, near = np.empty(n_blocks, np.float32), np.empty(n_blocks + 1, np.int32)
    reach = _F(optics.cut_off * optics.cut_off)
    for p in range(points.shape[0]):
        x, y, z = _F(points[p, 0]), _F(points[p, 1]), _F(points[p, 2])
        n_near = _near_blocks(boxes, n_blocks, reach, x, y, z, distances, near)
        if n_near == 0 or (optics.mirrored and z < _ZERO):
            out[p] = 0.0
            continue
        sums[:] = 0.0
        for n in range(n_near):
            b = near[n]
            _contributions(bodies, b * BLOCK, reach, x, y, z, parts)
            if geometry is not None:
                _hide(bodies, b * BLOCK, geometry, float(x), float(y), float(z), parts)
            _add(parts, sums)
            below = z + boxes[LOW_Z, b]
            if optics.mirrored and below * below <= reach * boxes[WIDEST, b]:
                _contributions(bodies, b * BLOCK, reach, x, y, -z, parts)
                if geometry is not None:
                    _hide(bodies, b * BLOCK, geometry, float(x), float(y), float(z), parts)
                _add(parts, sums)
        out[p] = optics.factor * _total(sums)


@njit(cache=True, error_model="numpy")
def read_worlds(
    state: FilamentState,
    geometry: Geometry | None,
    optics: Optics,
    positions: FloatArray,
    due: BoolArray,
    out: FloatArray,
) -> None:
    """The concentration at `positions` (n_envs, n, 3) m in the worlds of `due`, into `out` (n_envs, n)."""
    for e in range(positions.shape[0]):
        if due[e]:
            slots = state.tallies[e, SLOTS]
            _read_world(state.bodies[e], state.boxes[e], slots, geometry, optics, positions[e], out[e])


@njit(cache=True, error_model="numpy")
def read_points(
    state: FilamentState, geometry: Geometry | None, optics: Optics, e: int, points: FloatArray, out: FloatArray
) -> None:
    """The concentration of world `e` at `points` (n, 3) m, into `out` (n,)."""
    _read_world(state.bodies[e], state.boxes[e], state.tallies[e, SLOTS], geometry, optics, points, out)
