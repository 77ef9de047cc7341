"""Kernels that look at a particle belief from a place: the mass near it, and a coarse map around it.

Masses are weights as integers (`belief_kernels.MASS` is 1): their sums vectorise, and do not depend on their order.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from baselines.features.belief_kernels import MASS, WEIGHT, X, Y, Z

MAP_CELLS = 48  # 3 rings, 8 octants, below and above
_MASS, _TO_BELIEF = np.float32(MASS), np.float32(1.0 / MASS)
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
_COS, _SIN = np.float32(math.cos(math.pi / 8.0)), np.float32(math.sin(math.pi / 8.0))


@njit(error_model="numpy")
def to_masses(cloud: Any, masses: Any) -> None:
    """The weights as integers, in `masses` (n,) int32."""
    weight = cloud[WEIGHT]
    for n in range(weight.size):
        masses[n] = np.int32(weight[n] * _MASS)


@njit(error_model="numpy")
def mass_within(cloud: Any, masses: Any, px: Any, py: Any, pz: Any, radius: Any) -> float:
    """Belief within `radius` of a point, m."""
    total, limit = np.int32(0), radius * radius
    x, y, z = cloud[X], cloud[Y], cloud[Z]
    for n in range(x.size):
        dx, dy, dz = x[n] - px, y[n] - py, z[n] - pz
        inside = np.int32(dx * dx + dy * dy + dz * dz <= limit)
        total += masses[n] * inside
    return min(total / MASS, 1.0)


@njit(error_model="numpy")
def write_map(
    cloud: Any, masses: Any, px: Any, py: Any, pz: Any, inner: Any, outer: Any, cells: Any, sums: Any, out: Any, at: int
) -> None:
    """Belief in sectors around a point into `out` (..,) from `at` on; `cells` (n,) and `sums` (4, 48) are scratch.

    A cell is 16 ring + 2 octant + above: rings of horizontal distance up to `inner`, up to `outer`, and beyond, m;
    octants of direction, of which the first is centred on +x, the second on +x+y, and so on around.
    """
    x, y, z = cloud[X], cloud[Y], cloud[Z]
    near, far = inner * inner, outer * outer
    for n in range(x.size):
        dx, dy = x[n] - px, y[n] - py
        squared = dx * dx + dy * dy
        u, v = _COS * dx - _SIN * dy, _SIN * dx + _COS * dy  # turned by half an octant
        up, steep = np.int32(v < _ZERO), np.int32(abs(v) > abs(u))
        left = np.int32(u < _ZERO)
        octant = np.int32(4) * up + np.int32(2) * (left ^ up) + (steep ^ left ^ up)
        ring = np.int32(squared > near) + np.int32(squared > far)
        cells[n] = np.int32(16) * ring + np.int32(2) * octant + np.int32(z[n] > pz)
    sums[:] = 0
    for n in range(0, x.size, 4):  # four parts, which do not wait for each other
        sums[0, cells[n]] += masses[n]
        sums[1, cells[n + 1]] += masses[n + 1]
        sums[2, cells[n + 2]] += masses[n + 2]
        sums[3, cells[n + 3]] += masses[n + 3]
    for cell in range(sums.shape[1]):
        out[at + cell] = min(
            np.float32(sums[0, cell] + sums[1, cell] + sums[2, cell] + sums[3, cell]) * _TO_BELIEF, _ONE
        )
