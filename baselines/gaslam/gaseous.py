"""Which cells hold gas: 2-means of the concentrations, with a floor below which nothing is gas.

GaSLAM splits each of its maps, the measured one and that of the source term, by K-means into gas and no gas. Two means
split noise as readily as gas: the floor keeps a map of clean air empty. The clusters start at the least and the
largest value, so that the split is a function of the map alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.cluster.vq import kmeans

from osl_env.errors import InputError


def gas_threshold(values: ArrayLike, floor: float) -> float:
    """The concentration above which a cell is gaseous: midway between the two means of `values` (n,), and >= `floor`.

    It is `floor` where the values do not differ, or are none. Raises InputError for values that are not finite.
    """
    of_cells = np.asarray(values, dtype=np.float64)
    if of_cells.ndim != 1 or not np.isfinite(of_cells).all():
        raise InputError(f"gas map of shape {of_cells.shape}: must be (n,) finite concentrations")
    least, largest = (float(of_cells.min()), float(of_cells.max())) if of_cells.size else (0.0, 0.0)
    if least == largest:
        return float(floor)
    shares = (of_cells - least) / (largest - least)
    means, _ = kmeans(shares, np.array([0.0, 1.0]), thresh=0.0, check_finite=False)  # 0.0: until the means stand still
    return max(least + float(means.mean()) * (largest - least), float(floor))


def gaseous(values: ArrayLike, floor: float, among: ArrayLike | None = None) -> NDArray[np.bool_]:
    """(n,) the cells of a map `values` (n,) that hold gas; `among` (n,) bool are the cells that count, all by default.

    Concentrations and the `floor` are in the sensor's unit. Cells that do not count hold no gas.
    """
    of_cells = np.asarray(values, dtype=np.float64)
    count = np.ones(of_cells.shape, dtype=np.bool_) if among is None else np.asarray(among, dtype=np.bool_)
    if count.shape != of_cells.shape:
        raise InputError(f"gas map of shape {of_cells.shape}: the cells that count have another shape, {count.shape}")
    return count & (of_cells > gas_threshold(of_cells[count], floor))
