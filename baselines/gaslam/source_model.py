"""The pseudo-Gaussian plume of source term estimation and its likelihood (GaSLAM eqs 2 and 3).

    C(m) = Q / (2 pi U sy sz) exp(-y^2 / (2 sy^2) - z^2 / (2 sz^2)),  sy = ay x + by,  sz = az x + bz,  x >= 0      (2)
    p(D | m) ~ exp(-1/2 sum_i w_i (D_i - C_i(m))^2 / sigma_E^2)                                                      (3)

with x downwind of the source, y across the wind and z above the source, for any horizontal wind, and
m = (Q, x_s, y_s, z_s, ay, by, az, bz); D_i is the gas map in cell i and w_i its weight: 1 for a cell that is used, 0
for one that is not, or the number of UAVs whose maps use it. Upwind of the source there is no gas. Wind slower than
`minimum_speed` keeps its direction and counts as that fast. Air at rest has no downwind side: there the gas spreads to
all sides alike, as in `osl_env.plumes.pseudo_gaussian`,

    C = Q / ((2 pi)^{3/2} U r sz) exp(-z^2 / (2 sz^2)),  r = max(horizontal distance, sy / sqrt(2 pi))

The plume is linear in Q, so that the sum in (3) is a parabola of Q, and with Q uniform over an interval the likelihood
of the seven other parameters is an integral over that interval in closed form: `log_marginal`. The sampler walks over
those seven alone, and draws Q from the rest of the parabola, a normal distribution cut to the interval.

The cells are kept in columns along z. A column has one place downwind and across, hence one sy, sz and exponential
across; the columns are in downwind order, so that those upwind of a source are skipped.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from baselines.gaslam.cells import Cells
from osl_env.numerics import exp
from osl_env.parameters import FloatArray
from osl_env.state import IntArray

PARAMETERS = ("Q", "x_s", "y_s", "z_s", "a_y", "b_y", "a_z", "b_z")  # of a source term, in this order
SHAPE = len(PARAMETERS) - 1  # those that the sampler walks over: all but Q
_SQRT_2 = math.sqrt(2.0)
_SQRT_2_PI = math.sqrt(2.0 * math.pi)
_SQRT_HALF_PI = math.sqrt(0.5 * math.pi)
FLAT = 1e-6  # in standard deviations, and of the log likelihood: over a shorter interval of Q it is constant
_NARROW = 1e-3  # an interval far from the mode, in units of the decay there, over which two terms of it are enough
_FAR = 12.0  # standard deviations from which on the series of Mills' ratio has 9 digits


class Columns(NamedTuple):
    """The cells that count, in columns along z in downwind order, and their readings."""

    downwind: FloatArray  # (c,) m
    across: FloatArray  # (c,) m
    heights: FloatArray  # (nz,) m
    weight: FloatArray  # (nz, c): w / sigma_E^2 for a plume of 2 pi U Q
    weighted: FloatArray  # (nz, c): w D / sigma_E^2 for a plume of 2 pi U Q
    direction: FloatArray  # (2,) of the wind; x where the air is at rest
    at_rest: bool
    order: IntArray  # (c,): where a column is among all columns of the cells


def bearing(wind: FloatArray) -> tuple[FloatArray, bool]:
    """The direction (2,) of the horizontal part of `wind` (3,) m/s, and whether the air is at rest (then along x)."""
    speed = math.hypot(wind[0], wind[1])
    return (np.array([1.0, 0.0]), True) if speed == 0.0 else (np.asarray(wind[:2] / speed), False)


def columns_of(cells: Cells, mean: FloatArray, weight: FloatArray, wind: FloatArray, carried: float) -> Columns:
    """Columns of `cells` with a cell of positive `weight` (n,), w / sigma_E^2, and its `mean` (n,).

    The wind (3,) m/s gives the direction; `carried` is U, m/s.
    """
    nx, ny, nz = cells.shape
    direction, at_rest = bearing(wind)
    place = cells.centres[::nz, :2]
    downwind = place @ direction
    across = place[:, 1] * direction[0] - place[:, 0] * direction[1]
    per_column = weight.reshape(nx * ny, nz)
    counted = np.flatnonzero(per_column.any(axis=1))
    order = counted[np.argsort(downwind[counted], kind="stable")]
    strength = 1.0 / (2.0 * math.pi * carried)
    w = np.ascontiguousarray(per_column[order].T)
    weighted = w * np.where(w > 0.0, mean.reshape(nx * ny, nz)[order].T, 0.0)
    heights = np.array(cells.axes[2])
    return Columns(
        downwind[order], across[order], heights, w * strength**2, weighted * strength, direction, at_rest, order
    )


@njit(inline="always", error_model="numpy")
def _spread(
    x: float, y: float, growth_y: float, width_y: float, growth_z: float, width_z: float
) -> tuple[float, float]:
    """At x, y, m, downwind of and across from a source: 2 pi U C / Q at its height, 1/m^2, and -1 / (2 sz^2)."""
    sigma_y, sigma_z = growth_y * x + width_y, growth_z * x + width_z
    offset = y / sigma_y
    return exp(-0.5 * offset * offset) / (sigma_y * sigma_z), -0.5 / (sigma_z * sigma_z)


@njit(inline="always", error_model="numpy")
def _ring(x: float, y: float, growth_y: float, width_y: float, growth_z: float, width_z: float) -> tuple[float, float]:
    """The same in air at rest."""
    r = math.sqrt(x * x + y * y)
    sigma_z = growth_z * r + width_z
    wide = max(r, (growth_y * r + width_y) / _SQRT_2_PI)
    return 1.0 / (_SQRT_2_PI * wide * sigma_z), -0.5 / (sigma_z * sigma_z)


@njit(cache=True, error_model="numpy")
def _at_columns(shape: FloatArray, columns: Columns, level: FloatArray, decay: FloatArray) -> int:
    """Write what `_spread` gives at each column downwind of the source to `level`, `decay` (c,), from their start on.

    `shape` (7,) is a source term without its Q. Returns the first column downwind.
    """
    ux, uy = columns.direction[0], columns.direction[1]
    x, y = shape[0] * ux + shape[1] * uy, shape[1] * ux - shape[0] * uy
    growth_y, width_y, growth_z, width_z = shape[3], shape[4], shape[5], shape[6]
    if columns.at_rest:
        for c in range(columns.downwind.size):
            dx, dy = columns.downwind[c] - x, columns.across[c] - y
            level[c], decay[c] = _ring(dx, dy, growth_y, width_y, growth_z, width_z)
        return 0
    first = int(np.searchsorted(columns.downwind, x))
    downwind, across = columns.downwind[first:], columns.across[first:]  # from 0 on: so LLVM vectorises
    for c in range(downwind.size):
        level[c], decay[c] = _spread(downwind[c] - x, across[c] - y, growth_y, width_y, growth_z, width_z)
    return first


@njit(cache=True, error_model="numpy")
def parabola(shape: FloatArray, columns: Columns, scratch: FloatArray) -> tuple[float, float]:
    """a and b of the log likelihood b Q - a Q^2 / 2 + constant of a source term with `shape` (7,).

    `scratch` (4, c) is overwritten.
    """
    level, decay, squares, products = scratch[0], scratch[1], scratch[2], scratch[3]
    first = _at_columns(shape, columns, level, decay)
    n = columns.downwind.size - first
    squares[:n] = 0.0
    products[:n] = 0.0
    for k in range(columns.heights.size):
        height = (columns.heights[k] - shape[2]) ** 2
        weight, weighted = columns.weight[k, first:], columns.weighted[k, first:]
        for c in range(n):
            relative = exp(height * decay[c])
            squares[c] += weight[c] * relative * relative
            products[c] += weighted[c] * relative
    a0 = a1 = b0 = b1 = 0.0  # two sums: one alone waits for itself
    for c in range(0, n - 1, 2):
        a0 += squares[c] * level[c] * level[c]
        a1 += squares[c + 1] * level[c + 1] * level[c + 1]
        b0 += products[c] * level[c]
        b1 += products[c + 1] * level[c + 1]
    if n % 2 == 1:
        a0 += squares[n - 1] * level[n - 1] * level[n - 1]
        b0 += products[n - 1] * level[n - 1]
    return a0 + a1, b0 + b1


@njit(cache=True, error_model="numpy")
def _mills(x: float) -> float:
    """(1 - Phi(x)) / phi(x) of the standard normal distribution, x >= 0."""
    if x < _FAR:
        return _SQRT_HALF_PI * math.exp(0.5 * x * x) * math.erfc(x / _SQRT_2)
    r = 1.0 / (x * x)
    return (1.0 - r * (1.0 - 3.0 * r * (1.0 - 5.0 * r * (1.0 - 7.0 * r * (1.0 - 9.0 * r))))) / x


@njit(cache=True, error_model="numpy")
def log_marginal(a: float, b: float, low: float, high: float) -> float:
    """log of the mean of exp(b Q - a Q^2 / 2) over Q in [low, high]; at low = high its value there."""
    root = math.sqrt(a)
    if max(root, abs(b)) * (high - low) < FLAT:
        middle = 0.5 * (low + high)
        return b * middle - 0.5 * a * middle * middle
    left, right = root * low - b / root, root * high - b / root  # standard deviations from the mode
    if left <= 0.0 <= right:
        share = _SQRT_HALF_PI * (math.erf(right / _SQRT_2) - math.erf(left / _SQRT_2))
        return 0.5 * b * b / a + math.log(share / (right - left))
    near, far = (left, right) if left > 0.0 else (-right, -left)
    width = far - near
    if width * (1.0 + near) < _NARROW:
        share = width * (1.0 - 0.5 * near * width)
    else:
        share = _mills(near) - math.exp(-0.5 * width * (near + far)) * _mills(far)
    edge = low if left > 0.0 else high
    return edge * (b - 0.5 * a * edge) + math.log(share / width)


@njit(cache=True, error_model="numpy")
def log_likelihoods(sources: FloatArray, columns: Columns, out: FloatArray) -> None:
    """Write the logarithm of (3) of each of `sources` (k, 8), less that of no gas at all, to `out` (k,)."""
    scratch = np.empty((4, columns.downwind.size))
    for k in range(sources.shape[0]):
        a, b = parabola(sources[k, 1:], columns, scratch)
        out[k] = sources[k, 0] * (b - 0.5 * a * sources[k, 0])


@njit(cache=True, error_model="numpy")
def fill_plume(source: FloatArray, columns: Columns, carried: float, scratch: FloatArray, out: FloatArray) -> None:
    """Write eq 2 of `source` (8,) in wind of `carried`, m/s, to `out` (nz, c)."""
    shape = source[1:]
    first = _at_columns(shape, columns, scratch[0], scratch[1])
    out[:] = 0.0
    strength = source[0] / (2.0 * math.pi * carried)
    for k in range(columns.heights.size):
        height = (columns.heights[k] - shape[2]) ** 2
        for c in range(columns.downwind.size - first):
            out[k, first + c] = strength * scratch[0, c] * exp(height * scratch[1, c])
