"""The concentration of filaments on the cells of a grid, as GADEN computes it at a place (Farrell et al. 2002).

    c(x) = sum_i 10^6 n_f / (n_air (2 pi)^(3/2) sigma_i^3) exp( -d_i^2 / (2 sigma_i^2) )      ppm

with n_f mol of gas in a filament, n_air mol of all gases in a cm^3, sigma in cm and d_i the distance of filament i, cm.
A filament counts within `cutoff` sigma, in cells that hold air and are in its line of sight. A cell gets the value at
its centre: filaments narrower than a cell are undersampled, as they are in GADEN's own concentration maps.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from osl_env.fields.gaden_grid import Occupancy
from osl_env.fields.gaden_results import GadenResult
from osl_env.geometry import SOLID, Geometry, clear_share, open_air
from osl_env.numerics import exp
from osl_env.parameters import FloatArray

_CM = 100.0  # in a m


def concentration_of(result: GadenResult, occupancy: Occupancy, cutoff: float = 3.0) -> NDArray[np.float32]:
    """(nx, ny, nz) ppm: the gas of `result` in the cells of `occupancy`; its own concentration if it holds one."""
    if result.concentration is not None:
        return result.concentration
    assert result.filaments is not None
    geometry = open_air()
    if np.any(occupancy.solid == SOLID):
        geometry = geometry._replace(
            cells=occupancy.solid, origin=occupancy.low.copy(), spacing=np.full(3, occupancy.cell)
        )
    total = np.zeros(occupancy.shape)
    amount = 1e6 * result.moles / (result.air * (2.0 * math.pi) ** 1.5)  # ppm cm^3
    _add_filaments(result.filaments, amount, cutoff, geometry, occupancy.low, occupancy.cell, total)
    return total.astype(np.float32)


@njit(error_model="numpy")
def _span(x: float, low: float, cell: float, reach: float, n: int) -> Any:
    """The first cell whose centre is within `reach` of `x`, and the one after the last."""
    first = math.ceil((x - reach - low) / cell - 0.5)
    last = math.floor((x + reach - low) / cell - 0.5)
    return max(first, 0), min(last, n - 1) + 1


@njit(cache=True, error_model="numpy")
def _add_filaments(
    filaments: FloatArray,
    amount: float,
    cutoff: float,
    geometry: Geometry,
    low: FloatArray,
    cell: float,
    total: FloatArray,
) -> None:
    """Add the filaments (n, 4) to `total` (nx, ny, nz), ppm."""
    walls = geometry.cells.size > 0
    for f in range(filaments.shape[0]):
        x, y, z, sigma = filaments[f, 0], filaments[f, 1], filaments[f, 2], filaments[f, 3]
        reach = cutoff * sigma / _CM
        centre = amount / (sigma * sigma * sigma)
        fall = -0.5 * (_CM / sigma) ** 2
        i0, i1 = _span(x, low[0], cell, reach, total.shape[0])
        j0, j1 = _span(y, low[1], cell, reach, total.shape[1])
        k0, k1 = _span(z, low[2], cell, reach, total.shape[2])
        for i in range(i0, i1):
            cx = low[0] + (i + 0.5) * cell
            for j in range(j0, j1):
                cy = low[1] + (j + 0.5) * cell
                for k in range(k0, k1):
                    cz = low[2] + (k + 0.5) * cell
                    square = (cx - x) ** 2 + (cy - y) ** 2 + (cz - z) ** 2
                    if square > reach * reach:
                        continue
                    if walls and clear_share(geometry, cx, cy, cz, x, y, z) < 1.0:
                        continue
                    total[i, j, k] += centre * exp(fall * square)
