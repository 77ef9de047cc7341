"""3D Kernel DM+V/W: mean, variance and confidence of the gas concentration in every cell, from readings on the way.

Reggente and Lilienthal 2010 ("Three-dimensional statistical gas distribution mapping in an uncontrolled indoor
environment"), as GaSLAM uses it (eqs 1 and 7). Reading r_i at x_i with wind u_i weighs in the cell with centre x_k by

    w_ik = N(x_i - x_k; Sigma(u_i)) / N(0; sigma0)                                                     (1)

The kernel's axis along the wind is sigma0 + gamma |u|, the two across it sigma0 / sqrt(1 + gamma |u| / sigma0): its
volume is kept, so that its peak is the same in every wind and weights are in units of that peak. No wind gives a round
kernel. With Omega_k = sum_i w_ik, R_k = sum_i w_ik r_i and k(i) the cell of reading i:

    mean_k = R_k / Omega_k,   variance_k = sum_i w_ik (r_i - mean_k(i))^2 / Omega_k
    confidence_k = 1 - exp(-Omega_k / sigma_Omega^2)                                                   (7)

Mean and confidence grow with every reading. The variance asks each reading's distance from the present mean of its own
cell, which later readings move, so it is summed over the noted weights when it is asked for.

Readings of ours: sigma_Omega^2 is the peak of the 3D kernel N(0; sigma0), 1 in our unit (`confidence_scale`). The
kernel ends at 4 of its standard deviations, as in Lilienthal and Duckett 2004 (`cutoff`); a cell that no reading
reaches is at 0 in mean, variance and confidence, and a reading in it adds no variance. `shrink_to="average"` restores
Reggente and Lilienthal's own maps, which shrink where confidence is low: confidence * mean + (1 - confidence) *
average of the readings; the variance alike.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from baselines.gaslam.cells import Cells
from osl_env.errors import InputError
from osl_env.numerics import exp
from osl_env.parameters import FloatArray, Parameters, quantity

BELOW_ONE = float(np.nextafter(1.0, 0.0))
_FIRST_CAPACITY = 256
_COLUMNS = 9  # of a reading: position 0:3, m; concentration 3; wind 4:7, m/s; its own cell 7; end of its entries 8


class KernelParameters(Parameters):
    """The kernel and what counts as measured. Defaults: GaSLAM's tunnel (our readings of it)."""

    width: float = quantity(0.13, "m", ge=1e-3)  # sigma0
    stretching: float = quantity(0.3, "s", ge=0.0)  # gamma: metres along the wind for each m/s
    confidence_scale: float = quantity(1.0, "", ge=1e-6)  # sigma_Omega^2, in peaks of the kernel
    cutoff: float = quantity(4.0, "", gt=0.0, le=30.0)  # the kernel's end, in its standard deviations
    measured_confidence: float = quantity(0.5, "", ge=0.0, lt=1.0)  # a cell above it counts as measured
    shrink_to: Literal["nothing", "average"] = "nothing"  # what the maps go to where confidence is low


class KernelMap:
    """The gas map of one UAV (or of a team that shares its readings) over `cells`; empty when made."""

    def __init__(self, cells: Cells, parameters: KernelParameters | None = None) -> None:
        """An empty map over `cells`."""
        self.cells = cells
        self.parameters = parameters or KernelParameters()
        kernel = (self.parameters.width, self.parameters.stretching, self.parameters.cutoff)
        self._setting = np.concatenate((cells.low, cells.size, cells.shape, kernel))
        self._readings = np.empty((_FIRST_CAPACITY, _COLUMNS))
        # the cells that each reading reaches and its weights there, one reading after the other: for the variance
        self._entries = np.empty((8 * cells.n, 2))
        self.clear()

    def clear(self) -> None:
        """Forget every reading."""
        self._sums = np.zeros((2, self.cells.n))  # Omega and R
        self._count = 0
        self._used = 0
        self._mean: FloatArray | None = None
        self._variance: FloatArray | None = None

    def add(self, position: ArrayLike, concentration: float, wind: ArrayLike) -> None:
        """Take in a reading, in the sensor's unit, at `position` (3,) m in wind (3,) m/s; incremental.

        A position outside the cells counts as far as the kernel reaches in. Raises InputError for what is not finite.
        """
        if self._count == len(self._readings) or self._used + self.cells.n > len(self._entries):
            self._make_room()
        here, air = np.asarray(position, dtype=np.float64), np.asarray(wind, dtype=np.float64)
        if here.shape != (3,) or air.shape != (3,):
            raise InputError(f"kernel map: position, wind have the shapes {here.shape}, {air.shape}: must be (3,)")
        state = (self._sums, self._readings, self._entries, self._setting)
        used = _add(*state, self._count, self._used, here, air, float(concentration))
        if used < 0:
            raise InputError(
                f"kernel map: position = {here.tolist()}, concentration = {concentration}, wind = {air.tolist()}: "
                "must be finite"
            )
        self._used = used
        self._count += 1
        self._mean = self._variance = None

    def _make_room(self) -> None:
        """Double the readings and the entries; one more reading may reach every cell."""
        self._readings = np.concatenate((self._readings, np.empty_like(self._readings)))
        self._entries = np.concatenate((self._entries, np.empty_like(self._entries)))

    @property
    def n_readings(self) -> int:
        """How many readings the map holds."""
        return self._count

    @property
    def positions(self) -> FloatArray:
        """(n_readings, 3) m, where the readings were taken; a read-only view."""
        return _view(self._readings[: self._count, 0:3])

    @property
    def readings(self) -> FloatArray:
        """(n_readings,) concentrations in the sensor's unit; a read-only view."""
        return _view(self._readings[: self._count, 3])

    @property
    def reading_cells(self) -> NDArray[np.int64]:
        """(n_readings,) the cell nearest to each reading: k(i)."""
        return self._readings[: self._count, 7].astype(np.int64)

    @property
    def weight(self) -> FloatArray:
        """(n,) Omega, in peaks of the kernel: 1 for one reading at the cell's centre; a read-only view."""
        return _view(self._sums[0])

    @property
    def confidence(self) -> FloatArray:
        """(n,) in [0, 1)  (7)."""
        confidence: FloatArray = (-np.expm1(self._sums[0] / -self.parameters.confidence_scale)).clip(max=BELOW_ONE)
        return confidence

    @property
    def measured(self) -> NDArray[np.bool_]:
        """(n,) the cells whose confidence is above `measured_confidence`."""
        return self.confidence > self.parameters.measured_confidence

    @property
    def mean(self) -> FloatArray:
        """(n,) mean concentration in the sensor's unit; 0 where no reading reaches."""
        if self._mean is None:
            self._mean = self._shrunk(self._per_weight(self._sums[1]), self.readings)
        return self._mean

    @property
    def variance(self) -> FloatArray:
        """(n,) variance of the concentration in the sensor's unit squared; 0 where no reading reaches."""
        if self._variance is None:
            own = self.reading_cells
            residuals = (self.readings - self.mean[own]) ** 2
            if self.parameters.shrink_to == "nothing":
                residuals[self._sums[0, own] == 0.0] = 0.0  # the cell has no mean to differ from
            total = np.zeros(self.cells.n)
            _spread(total, self._readings, self._entries, residuals)
            self._variance = self._shrunk(self._per_weight(total), residuals)
        return self._variance

    def _per_weight(self, total: FloatArray) -> FloatArray:
        """(n,) `total` / Omega, 0 where Omega is 0."""
        ratio = np.zeros_like(total)
        np.divide(total, self._sums[0], out=ratio, where=self._sums[0] > 0.0)
        return ratio

    def _shrunk(self, values: FloatArray, of_readings: FloatArray) -> FloatArray:
        """(n,) `values`, shrunk by confidence towards the average of `of_readings` (n_readings,) if asked for."""
        if self.parameters.shrink_to == "average" and len(of_readings):
            confidence = self.confidence
            values = confidence * values + (1.0 - confidence) * of_readings.mean()
        return _view(values)


def _view(values: FloatArray) -> FloatArray:
    """`values`, read-only."""
    shown = values[:]
    shown.setflags(write=False)
    return shown


@njit(inline="always", error_model="numpy")
def _span(nearest: float, farthest: float, low: float, size: float, n: float) -> tuple[int, int]:
    """The cells first .. last - 1 along an axis whose centres are from `nearest` to `farthest`, m."""
    first = max(math.ceil((nearest - low) / size - 0.5), 0.0)
    last = min(math.floor((farthest - low) / size - 0.5), n - 1.0)
    return (int(first), int(last) + 1) if first <= last else (0, 0)


@njit(error_model="numpy")
def _deposit(sums: FloatArray, reading: FloatArray, entries: FloatArray, setting: FloatArray, used: int) -> int:
    """Add the weight (1) of a `reading` (9,) to Omega and R (2, n), and note them in `entries` after `used`.

    With d = x_k - x_i and the unit vector e along the wind, d^T Sigma^-1 d = a d^2 + b (e d)^2: down a column of cells
    a parabola in dz, of which the part under cutoff^2 counts. Returns how many entries are used then.
    """
    width, stretching, cutoff = setting[9], setting[10], setting[11]
    speed = math.sqrt(reading[4] ** 2 + reading[5] ** 2 + reading[6] ** 2)
    inverse = 1.0 / speed if speed > 0.0 else 0.0
    ex, ey, ez = reading[4] * inverse, reading[5] * inverse, reading[6] * inverse
    stretch = 1.0 + stretching * speed / width
    square_along, square_across = (width * stretch) ** 2, width**2 / stretch
    a = 1.0 / square_across
    b = 1.0 / square_along - a
    longer = square_along - square_across  # sqrt of Sigma's diagonal times the cutoff is the half side of its box
    reach_x = cutoff * math.sqrt(square_across + longer * ex * ex)
    reach_y = cutoff * math.sqrt(square_across + longer * ey * ey)
    curve = a + b * ez * ez
    x, y, z, lx, ly, lz = reading[0], reading[1], reading[2], setting[0], setting[1], setting[2]
    sx, sy, sz, nx, ny, nz = setting[3], setting[4], setting[5], setting[6], setting[7], setting[8]
    concentration = reading[3]
    x0, x1 = _span(x - reach_x, x + reach_x, lx, sx, nx)
    y0, y1 = _span(y - reach_y, y + reach_y, ly, sy, ny)
    for ix in range(x0, x1):
        dx = lx + (ix + 0.5) * sx - x
        for iy in range(y0, y1):
            dy = ly + (iy + 0.5) * sy - y
            along = ex * dx + ey * dy
            slope = b * ez * along
            level = a * (dx * dx + dy * dy) + b * along * along
            under = slope * slope - curve * (level - cutoff * cutoff)
            if under < 0.0:
                continue
            middle, half = z - slope / curve, math.sqrt(under) / curve
            z0, z1 = _span(middle - half, middle + half, lz, sz, nz)
            first = (ix * int(ny) + iy) * int(nz)
            for iz in range(z0, z1):
                dz = lz + (iz + 0.5) * sz - z
                weight = exp(-0.5 * (level + (2.0 * slope + curve * dz) * dz))
                sums[0, first + iz] += weight
                sums[1, first + iz] += weight * concentration
                entries[used, 0] = first + iz
                entries[used, 1] = weight
                used += 1
    return used


@njit(cache=True, error_model="numpy")
def _add(
    sums: FloatArray,
    readings: FloatArray,
    entries: FloatArray,
    setting: FloatArray,
    count: int,
    used: int,
    position: FloatArray,
    wind: FloatArray,
    concentration: float,
) -> int:
    """Make reading number `count` and add it to the map: the entries used then; -1, and nothing added: not finite."""
    reading = readings[count]
    total = concentration
    for axis in range(3):
        reading[axis], reading[4 + axis] = position[axis], wind[axis]
        total += position[axis] ** 2 + wind[axis] ** 2
    if not math.isfinite(total):
        return -1
    reading[3] = concentration
    cell = 0.0
    for axis in range(3):
        n = setting[6 + axis]
        cell = cell * n + min(max(math.floor((position[axis] - setting[axis]) / setting[3 + axis]), 0.0), n - 1.0)
    reading[7] = cell
    used = _deposit(sums, reading, entries, setting, used)
    reading[8] = used
    return used


@njit(cache=True, error_model="numpy")
def _spread(total: FloatArray, readings: FloatArray, entries: FloatArray, values: FloatArray) -> None:
    """Add to `total` (n,) sum_i w_ik values_i over the first readings, with the weights noted before."""
    entry = 0
    for i in range(len(values)):
        while entry < readings[i, 8]:
            total[int(entries[entry, 0])] += entries[entry, 1] * values[i]
            entry += 1
