"""The air of a batch of worlds: where it goes, at any place.

Whatever the wind model, the air is either uniform in space (a velocity for each world) or given on a grid: frames of a
velocity field, of which each world blends two. Winds fill an `Air`; plumes and anemometers read it through
`air_velocity`, trilinear in space and linear between the two frames. Outside the grid its nearest values hold.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from osl_env.parameters import FloatArray
from osl_env.state import IntArray


class Air(NamedTuple):
    """The air of all worlds; shared by reference, changed in place by the wind model."""

    mean: FloatArray  # (n_envs, 3) m/s: the velocity where it is uniform; with a grid, the episode's mean wind
    grid: NDArray[np.float32]  # (n_frames, nx, ny, nz, 3) m/s at the centres of cells; no frames: uniform
    frame: IntArray  # (n_envs, 2): the frames that a world blends
    blend: FloatArray  # (n_envs,): the weight of the second, 0 .. 1
    origin: FloatArray  # (3,) m: the centre of the first cell
    spacing: FloatArray  # (3,) m between centres


def uniform_air(n_envs: int) -> Air:
    """Still air without a grid."""
    return Air(
        np.zeros((n_envs, 3)),
        np.empty((0, 0, 0, 0, 3), np.float32),
        np.zeros((n_envs, 2), np.int64),
        np.zeros(n_envs),
        np.zeros(3),
        np.ones(3),
    )


@njit(inline="always", error_model="numpy")
def _cell(x: float, origin: float, spacing: float, n: int) -> Any:
    """The lower of the two cells whose centres are around `x`, and the weight of the upper; clamped to the grid."""
    at = min(max((x - origin) / spacing, 0.0), n - 1.0)
    low = min(math.floor(at), max(n - 2, 0))
    return low, at - low


@njit(error_model="numpy")
def air_velocity(air: Any, e: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Velocity (u, v, w), m/s, of the air of world `e` at (x, y, z), m."""
    grid = air.grid
    if grid.shape[0] == 0:
        return air.mean[e, 0], air.mean[e, 1], air.mean[e, 2]
    i, a = _cell(x, air.origin[0], air.spacing[0], grid.shape[1])
    j, b = _cell(y, air.origin[1], air.spacing[1], grid.shape[2])
    k, c = _cell(z, air.origin[2], air.spacing[2], grid.shape[3])
    u, v, w = 0.0, 0.0, 0.0
    for side in range(2):
        weight = air.blend[e] if side == 1 else 1.0 - air.blend[e]
        if weight == 0.0:
            continue
        f = air.frame[e, side]
        for di in range(2 if a > 0.0 else 1):
            of_x = weight * (a if di == 1 else 1.0 - a)
            for dj in range(2 if b > 0.0 else 1):
                of_y = of_x * (b if dj == 1 else 1.0 - b)
                for dk in range(2 if c > 0.0 else 1):
                    share = of_y * (c if dk == 1 else 1.0 - c)
                    u += share * grid[f, i + di, j + dj, k + dk, 0]
                    v += share * grid[f, i + di, j + dj, k + dk, 1]
                    w += share * grid[f, i + di, j + dj, k + dk, 2]
    return u, v, w


@njit(cache=True, error_model="numpy")
def winds_at(air: Air, e: int, points: FloatArray, out: FloatArray) -> None:
    """The velocity of world `e`'s air at `points` (n, 3), m, into `out` (n, 3), m/s."""
    for k in range(points.shape[0]):
        out[k, 0], out[k, 1], out[k, 2] = air_velocity(air, e, points[k, 0], points[k, 1], points[k, 2])


@njit(cache=True, error_model="numpy")
def local_winds(air: Air, positions: FloatArray, out: FloatArray) -> None:
    """The air's velocity at `positions` (n_envs, n_uavs, 3), m, into `out` of the same shape, m/s."""
    for e in range(positions.shape[0]):
        for i in range(positions.shape[1]):
            u, v, w = air_velocity(air, e, positions[e, i, 0], positions[e, i, 1], positions[e, i, 2])
            out[e, i, 0], out[e, i, 1], out[e, i, 2] = u, v, w
