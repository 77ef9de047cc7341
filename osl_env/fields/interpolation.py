"""Interpolation of gridded fields in space and time, for compiled code.

Trilinear between the centres of cells, linear between frames. A wind is the arithmetic of `osl_env.air`: outside the
grid its nearest values hold. A concentration is 0 outside the grid's cells; next to a solid cell, which holds no gas,
the weights of the free cells around the place are scaled to sum to 1 (no gas diffuses into a wall), so a linear field
stays exact away from walls and nothing is read through a wall that is one cell thick.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from osl_env import air
from osl_env.geometry import SOLID
from osl_env.parameters import FloatArray

_EDGE = 1e-9  # of a cell: a place on the edge of the area, rounded, is still in the grid


@njit(cache=True, error_model="numpy")
def locate(times: FloatArray, period: float, elapsed: float) -> tuple[int, int, float]:
    """The two frames around `elapsed`, s since the first of `times` (n_t,), and the weight of the second.

    With a `period` > 0, s, the last frame blends into the first, which follows it; without one, the first and the
    last frames hold before and after.
    """
    n = times.size
    if n == 1:
        return 0, 0, 0.0
    if period > 0.0:
        elapsed -= period * math.floor(elapsed / period)
    at = times[0] + elapsed
    if at <= times[0]:
        return 0, 0, 0.0
    if at >= times[n - 1]:
        if period <= 0.0:
            return n - 1, n - 1, 0.0
        gap = times[0] + period - times[n - 1]
        return n - 1, 0, min((at - times[n - 1]) / gap, 1.0)
    low = np.searchsorted(times, at, side="right") - 1
    return low, low + 1, (at - times[low]) / (times[low + 1] - times[low])


@njit(inline="always", error_model="numpy")
def _cell(x: float, origin: float, spacing: float, n: int) -> Any:
    """The lower of the cells whose centres are around `x`, the weight of the upper, and whether `x` is in the grid."""
    place = (x - origin) / spacing
    inside = -0.5 - _EDGE <= place <= n - 0.5 + _EDGE
    clamped = min(max(place, 0.0), n - 1.0)
    low = min(math.floor(clamped), max(n - 2, 0))
    return low, clamped - low, inside


@njit(error_model="numpy")
def concentration_at(
    grid: Any,
    cells: Any,
    origin: Any,
    spacing: Any,
    first: int,
    second: int,
    blend: float,
    x: float,
    y: float,
    z: float,
) -> float:
    """The concentration at (x, y, z), m, of `grid` (n_t, nx, ny, nz) between the frames `first` and `second`.

    `cells` are the solid cells (nx, ny, nz), or empty. A grid of a single layer holds at all heights.
    """
    i, a, in_x = _cell(x, origin[0], spacing[0], grid.shape[1])
    j, b, in_y = _cell(y, origin[1], spacing[1], grid.shape[2])
    k, c, in_z = _cell(z, origin[2], spacing[2], grid.shape[3])
    if not (in_x and in_y and (in_z or grid.shape[3] == 1)):
        return 0.0
    total, weights = 0.0, 0.0
    for di in range(2 if a > 0.0 else 1):
        of_x = a if di == 1 else 1.0 - a
        for dj in range(2 if b > 0.0 else 1):
            of_y = of_x * (b if dj == 1 else 1.0 - b)
            for dk in range(2 if c > 0.0 else 1):
                share = of_y * (c if dk == 1 else 1.0 - c)
                if cells.size > 0 and cells[i + di, j + dj, k + dk] == SOLID:
                    continue
                value = float(grid[first, i + di, j + dj, k + dk])
                if blend > 0.0:
                    value += blend * (float(grid[second, i + di, j + dj, k + dk]) - value)
                total += share * value
                weights += share
    return total / weights if cells.size > 0 and weights > 0.0 else total


@njit(cache=True, error_model="numpy")
def concentrations_at(
    grid: Any,
    cells: Any,
    origin: FloatArray,
    spacing: FloatArray,
    first: int,
    second: int,
    blend: float,
    points: FloatArray,
    out: FloatArray,
) -> None:
    """`concentration_at` the `points` (n, 3), m, into `out` (n,)."""
    for k in range(points.shape[0]):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        out[k] = concentration_at(grid, cells, origin, spacing, first, second, blend, x, y, z)


def winds_at(
    grid: NDArray[np.float32],
    origin: FloatArray,
    spacing: FloatArray,
    first: int,
    second: int,
    blend: float,
    points: FloatArray,
    out: FloatArray,
) -> None:
    """The wind of `grid` (n_t, nx, ny, nz, 3), m/s, at `points` (n, 3), m, into `out` (n, 3)."""
    frame = np.array([[first, second]], np.int64)
    air.winds_at(air.Air(np.zeros((1, 3)), grid, frame, np.array([blend]), origin, spacing), 0, points, out)
