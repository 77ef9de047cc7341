"""GaSLAM's final gas map: the plume of the estimated source, corrected by what was measured.

In the cells that the kernel map calls gaseous stands its mean; in the cells that it measured and calls free of gas the
average of its means over all of those; elsewhere the map of the source term. Not said in the paper, and our reading:
cells that were not measured are neither gaseous nor free of gas. With every cell given as measured, those that the
flight never came near count as free of gas.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from osl_env.errors import InputError
from osl_env.parameters import FloatArray


def final_map(plume: ArrayLike, kernel_mean: ArrayLike, measured: ArrayLike, gaseous: ArrayLike) -> FloatArray:
    """(n,) the final map from the source term's `plume` (n,) and the kernel map's mean (n,), in the sensor's unit.

    `measured` (n,) bool are the cells that the kernel map knows, `gaseous` (n,) bool those that it calls gaseous; a
    cell that was not measured is not taken as gaseous. Nothing measured gives `plume`. Raises InputError for other
    shapes.
    """
    estimate, mean = np.array(plume, dtype=np.float64), np.asarray(kernel_mean, dtype=np.float64)
    known, gas = np.asarray(measured, dtype=np.bool_), np.asarray(gaseous, dtype=np.bool_)
    if estimate.ndim != 1 or not estimate.shape == mean.shape == known.shape == gas.shape:
        shapes = ", ".join(str(array.shape) for array in (estimate, mean, known, gas))
        raise InputError(f"final map: plume, kernel mean, measured, gaseous have the shapes {shapes}: must be one (n,)")
    estimate[known & gas] = mean[known & gas]
    clean = known & ~gas
    if clean.any():
        estimate[clean] = mean[clean].mean()
    return estimate
