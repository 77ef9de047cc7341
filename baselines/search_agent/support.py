"""A belief as a few hundred equally likely places: what the agent's expectations are taken over.

Systematic resampling of the cells in their order (z slowest) is stratified in space; within a cell a place is put by a
low-discrepancy sequence (Roberts' R3). Deterministic: the same belief gives the same places.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from osl_env.parameters import FloatArray

_PLASTIC = 1.2207440846057596  # root of x^4 = x + 1: its powers spread points evenly over a cube
_STEPS = (1.0 / _PLASTIC, 1.0 / _PLASTIC**2, 1.0 / _PLASTIC**3)
_STEP_X, _STEP_Y, _STEP_Z = _STEPS


@njit(cache=True, error_model="numpy")
def draw_support(
    probability: FloatArray,
    xs: FloatArray,
    ys: FloatArray,
    zs: FloatArray,
    size: FloatArray,
    support: NDArray[np.float32],
) -> None:
    """Write P equally likely places of each belief of `probability` (B, cells) to `support` (B, 3, P), m."""
    n_x, n_y, n_points = xs.size, ys.size, support.shape[2]
    for b in range(probability.shape[0]):
        passed, point = 0.0, 0
        threshold = 0.5 / n_points
        for layer in range(zs.size * n_y):
            row = probability[b, layer * n_x : (layer + 1) * n_x]
            mass = row.sum()
            if passed + mass <= threshold:
                passed += mass
                continue
            for ix in range(n_x):
                passed += row[ix]
                while point < n_points and passed > threshold:
                    u, v, w = (point * _STEP_X) % 1.0, (point * _STEP_Y) % 1.0, (point * _STEP_Z) % 1.0
                    support[b, 0, point] = xs[ix] + (u - 0.5) * size[0]
                    support[b, 1, point] = ys[layer % n_y] + (v - 0.5) * size[1]
                    support[b, 2, point] = zs[layer // n_y] + (w - 0.5) * size[2]
                    point += 1
                    threshold = (point + 0.5) / n_points
        for left in range(point, n_points):  # rounding kept the sum below the last threshold
            for axis in range(3):
                support[b, axis, left] = support[b, axis, max(point - 1, 0)]


@njit(cache=True, error_model="numpy")
def summarise(
    probability: FloatArray,
    log_posterior: FloatArray,
    xs: FloatArray,
    ys: FloatArray,
    zs: FloatArray,
    centres: FloatArray,
    radius: float,
    certainty: FloatArray,
    entropy: FloatArray,
) -> None:
    """Each belief's mass within `radius`, m, of `centres` (B, 3), m, by cell centres, and its entropy in nats: (B,)."""
    n_x, n_y = xs.size, ys.size
    for b in range(probability.shape[0]):
        total, disorder = 0.0, 0.0
        for iz in range(zs.size):
            dz = zs[iz] - centres[b, 2]
            for iy in range(n_y):
                dy = ys[iy] - centres[b, 1]
                left = radius * radius - dz * dz - dy * dy
                start = (iz * n_y + iy) * n_x
                for ix in range(n_x):
                    disorder -= probability[b, start + ix] * log_posterior[b, start + ix]
                if left < 0.0:
                    continue
                for ix in range(n_x):
                    dx = xs[ix] - centres[b, 0]
                    if dx * dx <= left:
                        total += probability[b, start + ix]
        certainty[b], entropy[b] = total, disorder
