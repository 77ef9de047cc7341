"""The cells of a gas map: a regular grid over the search volume.

GaSLAM maps its 7 x 2 x 0.5 m search volume on 14 x 10 x 5 cells of 0.5 x 0.2 x 0.1 m. Cells are numbered in C order, x
slowest, so that the cells of one x form a block, and of those the cells of one (x, y) a column along z.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from baselines.policy import GasMap
from osl_env.errors import InputError
from osl_env.parameters import FloatArray

PAPER_SHAPE = (14, 10, 5)
MOST_CELLS = 1_000_000


@dataclass(frozen=True, eq=False)
class Cells:
    """A grid of `shape` equal cells that fills the box from `low` to `high`.

    Raises InputError for a box without a volume or a number of cells below 1.
    """

    low: FloatArray  # (3,) m
    high: FloatArray  # (3,) m
    shape: tuple[int, int, int] = PAPER_SHAPE

    def __post_init__(self) -> None:
        """Check the box and the numbers of cells, and keep read-only copies."""
        low, high = _corner("low", self.low), _corner("high", self.high)
        if not (high > low).all():
            raise InputError(f"cells.high = {high.tolist()}: must be above low = {low.tolist()} m on every axis")
        shape = tuple(self.shape)
        if len(shape) != 3 or any(int(n) != n or n < 1 for n in shape) or math.prod(shape) > MOST_CELLS:
            raise InputError(f"cells.shape = {shape}: must be three whole numbers >= 1, at most {MOST_CELLS} cells")
        object.__setattr__(self, "low", low)
        object.__setattr__(self, "high", high)
        object.__setattr__(self, "shape", tuple(int(n) for n in shape))

    @classmethod
    def of_size(cls, low: ArrayLike, high: ArrayLike, size: ArrayLike) -> Cells:
        """The grid over the box whose cells are nearest to `size` (3,) m, at least one along each axis."""
        corner, far, side = _corner("low", low), _corner("high", high), _corner("size", size)
        if not (side > 0.0).all():
            raise InputError(f"cells.size = {side.tolist()}: must be above 0 m on every axis")
        nx, ny, nz = (max(1, round(float(n))) for n in (far - corner) / side)
        return cls(corner, far, (nx, ny, nz))

    @property
    def n(self) -> int:
        """How many cells there are."""
        return math.prod(self.shape)

    @functools.cached_property
    def size(self) -> FloatArray:
        """(3,) m, sides of a cell."""
        return _read_only((self.high - self.low) / np.array(self.shape, dtype=np.float64))

    @functools.cached_property
    def axes(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Centres along x (nx,), y (ny,) and z (nz,), m."""
        x, y, z = (
            _read_only(self.low[axis] + (np.arange(count) + 0.5) * self.size[axis])
            for axis, count in enumerate(self.shape)
        )
        return x, y, z

    @functools.cached_property
    def centres(self) -> FloatArray:
        """(n, 3) m, in C order."""
        return _read_only(np.stack(np.meshgrid(*self.axes, indexing="ij"), axis=-1).reshape(-1, 3))

    def gas_map(self, values: ArrayLike) -> GasMap:
        """`values` (n,) of the cells as the gas map of a belief."""
        of_cells = np.array(values, dtype=np.float64)
        if of_cells.shape != (self.n,):
            raise InputError(f"gas map: values have the shape {of_cells.shape}: must be ({self.n},), one for each cell")
        return GasMap(self.low, self.size, of_cells.reshape(self.shape))

    def index_of(self, point: ArrayLike) -> int | None:
        """The number of the cell that holds `point` (3,) m, the high faces included; None outside the grid."""
        where = np.asarray(point, dtype=np.float64)
        if not ((where >= self.low) & (where <= self.high)).all():
            return None
        return self.nearest(where)

    def nearest(self, point: ArrayLike) -> int:
        """The number of the cell nearest to `point` (3,) m, inside the grid or not. Raises InputError for NaN."""
        where = np.asarray(point, dtype=np.float64)
        if where.shape != (3,) or np.isnan(where).any():
            raise InputError(f"point = {where.tolist()}: must be three numbers in m")
        last = np.array(self.shape) - 1
        along = np.floor((np.clip(where, self.low, self.high) - self.low) / self.size).astype(np.int64)
        i, j, k = np.minimum(along, last).tolist()
        return int((i * self.shape[1] + j) * self.shape[2] + k)


def _corner(key: str, value: ArrayLike | Sequence[float]) -> FloatArray:
    corner = np.array(value, dtype=np.float64)
    if corner.shape != (3,) or not np.isfinite(corner).all():
        raise InputError(f"cells.{key} = {corner.tolist()}: must be three finite numbers in m")
    return _read_only(corner)


def _read_only(values: FloatArray) -> FloatArray:
    values.setflags(write=False)
    return values
