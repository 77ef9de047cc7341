"""A wind and gas field on a regular grid: frames in time of the air's velocity, of a concentration, or of both.

What simulations made elsewhere (OpenFOAM, GADEN) become, what ships with the package, and what winds and plumes play
back. Values belong to the centres of the cells of a regular grid; between them they are trilinear in space and linear
in time. A field of one frame is steady. A field with a `period` loops without a seam: its last frame blends into its
first.
"""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from osl_env.errors import InputError
from osl_env.fields.interpolation import concentrations_at, locate, winds_at
from osl_env.geometry import OUTLET, SOLID
from osl_env.parameters import FloatArray

Grid: TypeAlias = NDArray[np.float32]
Axis: TypeAlias = Literal["x", "y", "z"]

MAX_SPEED = 1000.0  # m/s: faster air is an error in the file
MAX_CONCENTRATION = 1e30  # in any unit
_TOLERANCE = 1e-6  # of a cell, for comparing places


@dataclass(frozen=True, eq=False)
class Field:
    """A field on a grid of (nx, ny, nz) cells at n_t times. At least one of `wind` and `concentration` is there.

    Arrays are checked and made read-only. Raises InputError ("key = value: what is wrong") for shapes that disagree,
    times that do not increase, values that are not finite, and concentrations below 0.
    """

    times: FloatArray  # (n_t,) s, increasing; a single frame is a steady field
    origin: FloatArray  # (3,) m: the centre of the first cell
    spacing: FloatArray  # (3,) m: sides of a cell
    wind: Grid | None = None  # (n_t, nx, ny, nz, 3) m/s, where the air goes
    concentration: Grid | None = None  # (n_t, nx, ny, nz) in `unit`
    unit: str = "ppm"
    solid: NDArray[np.uint8] | None = None  # (nx, ny, nz): geometry.FREE, SOLID or OUTLET; None: all free
    period: float = 0.0  # s after which the field begins anew; 0: it was not made to loop
    card: dict[str, Any] = field(default_factory=dict)  # title, source, description, licence, sources, ..; JSON

    def __post_init__(self) -> None:
        """Check everything, and make the arrays read-only views of what was given."""
        for name, size in (("times", None), ("origin", 3), ("spacing", 3)):
            self._keep(name, _vector(name, getattr(self, name), size))
        self._check_times()
        if np.any(self.spacing <= 0):
            raise InputError(f"spacing = {self.spacing.tolist()}: every side of a cell must be above 0 m")
        if self.wind is None and self.concentration is None:
            raise InputError("wind, concentration: a field must hold at least one of them")
        if self.wind is not None:
            self._keep("wind", _grid("wind", self.wind, (len(self.times),), (3,), MAX_SPEED))
        if self.concentration is not None:
            self._keep("concentration", self._checked_concentration(self.concentration))
        if self.solid is not None:
            self._keep("solid", self._checked_solid(self.solid))
        object.__setattr__(self, "card", _json("card", self.card))

    def _keep(self, name: str, array: NDArray[Any]) -> None:
        view = array.view()
        view.flags.writeable = False
        object.__setattr__(self, name, view)

    def _check_times(self) -> None:
        times = self.times
        if np.any(np.diff(times) <= 0):
            at = int(np.argmax(np.diff(times) <= 0))
            raise InputError(
                f"times: frame {at + 1} at {times[at + 1]:g} s must come after frame {at} at {times[at]:g} s"
            )
        if not math.isfinite(self.period) or self.period < 0:
            raise InputError(f"period = {self.period!r}: must be finite and not below 0 s")
        if 0 < self.period <= self.duration:
            raise InputError(
                f"period = {self.period:g}: must be longer than the frames, which last {self.duration:g} s"
            )

    def _checked_concentration(self, concentration: ArrayLike) -> Grid:
        grid = _grid("concentration", concentration, (len(self.times),), (), MAX_CONCENTRATION)
        if self.wind is not None and grid.shape != self.wind.shape[:4]:
            raise InputError(f"concentration: its shape {grid.shape} must be the wind's, {self.wind.shape[:4]}")
        if float(grid.min()) < 0:
            raise InputError(f"concentration: its smallest value is {grid.min():g}; must not be below 0 {self.unit}")
        if not isinstance(self.unit, str) or not 0 < len(self.unit) <= 40 or not self.unit.isprintable():
            raise InputError(f"unit = {self.unit!r:.60}: must be 1 to 40 printable characters")
        return grid

    def _checked_solid(self, solid: ArrayLike) -> NDArray[np.uint8]:
        cells = np.asarray(solid)
        if cells.shape != self.shape:
            raise InputError(f"solid: its shape {cells.shape} must be the grid's, {self.shape}")
        if cells.dtype.kind not in "bui" or cells.min() < 0 or cells.max() > OUTLET:
            raise InputError("solid: cells must be 0 (free), 1 (solid) or 2 (outlet)")
        return np.ascontiguousarray(cells, np.uint8)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(nx, ny, nz), cells."""
        grid = self.wind if self.wind is not None else self.concentration
        assert grid is not None
        return int(grid.shape[1]), int(grid.shape[2]), int(grid.shape[3])

    @property
    def n_frames(self) -> int:
        """n_t."""
        return len(self.times)

    @property
    def duration(self) -> float:
        """s from the first frame to the last."""
        return float(self.times[-1] - self.times[0])

    @property
    def loop_period(self) -> float:
        """s of a loop: `period`, or if the field was not made to loop, its duration and its last interval once more."""
        if self.period > 0 or self.n_frames == 1:
            return self.period
        return self.duration + float(self.times[-1] - self.times[-2])

    @property
    def low(self) -> FloatArray:
        """(3,) m: the low corner of the grid."""
        return np.asarray(self.origin - 0.5 * self.spacing)

    @property
    def high(self) -> FloatArray:
        """(3,) m: the high corner of the grid."""
        return np.asarray(self.low + self.spacing * np.array(self.shape))

    @property
    def sources(self) -> FloatArray:
        """(n, 3) m: where the gas of the concentration comes from, as far as the card says."""
        places = [entry["position"] for entry in self.card.get("sources", [])]
        return np.array(places, dtype=np.float64).reshape(-1, 3)

    def centres(self, axis: Axis) -> FloatArray:
        """(n,) m: the centres of the cells along `axis`."""
        k = "xyz".index(axis)
        return np.asarray(self.origin[k] + self.spacing[k] * np.arange(self.shape[k]))

    def covers(self, size: ArrayLike, offset: ArrayLike = (0.0, 0.0, 0.0)) -> bool:
        """Whether the grid moved by `offset` (3,) m covers the area [0, Lx] x [0, Ly] x [0, Lz] of `size` (3,) m.

        A grid of a single layer holds at all heights.
        """
        slack = _TOLERANCE * self.spacing
        low, high = self.low + np.asarray(offset) - slack, self.high + np.asarray(offset) + slack
        flat = np.array([False, False, self.shape[2] == 1])
        return bool(np.all(flat | ((low <= 0) & (high >= np.asarray(size)))))

    def moment(self, time: float, loop: bool = True) -> tuple[int, int, float]:
        """The two frames around `time`, s since the first frame, and the weight of the second."""
        return locate(self.times, self.loop_period if loop else 0.0, float(time))

    def at(
        self, quantity: Literal["wind", "concentration"], points: ArrayLike, time: float, loop: bool = True
    ) -> FloatArray:
        """The wind (.., 3), m/s, or the concentration (..), in `unit`, at `points` (.., 3) m.

        `time` is in s since the first frame. Outside the grid the wind is that of the nearest place in it, and the
        concentration 0. Raises InputError if the field does not hold the quantity.
        """
        grid = getattr(self, quantity, None) if quantity in ("wind", "concentration") else None
        if grid is None:
            raise InputError(f"{quantity}: this field does not hold it")
        places = np.ascontiguousarray(points, dtype=np.float64)
        flat = places.reshape(-1, 3)
        first, second, blend = self.moment(time, loop)
        if quantity == "wind":
            winds = np.empty((len(flat), 3))
            winds_at(grid, self.origin, self.spacing, first, second, blend, flat, winds)
            return winds.reshape(places.shape)
        out = np.empty(len(flat))
        concentrations_at(grid, self.cells, self.origin, self.spacing, first, second, blend, flat, out)
        return out.reshape(places.shape[:-1])

    @property
    def cells(self) -> NDArray[np.uint8]:
        """`solid`, or (0, 0, 0) cells if all are free: for compiled code."""
        return np.empty((0, 0, 0), np.uint8) if self.solid is None else self.solid

    @property
    def free(self) -> NDArray[np.bool_]:
        """(nx, ny, nz): which cells hold air."""
        return np.ones(self.shape, np.bool_) if self.solid is None else np.not_equal(self.solid, SOLID)

    @cached_property
    def mean_wind(self) -> FloatArray:
        """(3,) m/s: the mean wind over the cells that hold air and over the frames; 0 without a wind."""
        if self.wind is None or not self.free.any():
            return np.zeros(3)
        sums = np.zeros((*self.shape, 3))
        for frame in self.wind:
            sums += frame
        return np.asarray(sums[self.free].mean(axis=0) / self.n_frames)

    def frames(self, start: int, stop: int) -> Field:
        """The frames `start` to `stop` (not included) alone, as a field that does not loop."""
        if not 0 <= start < stop <= self.n_frames:
            raise InputError(f"frames = {start}:{stop}: must lie within 0:{self.n_frames}")
        part = slice(start, stop)
        return dataclasses.replace(
            self,
            times=self.times[part],
            wind=None if self.wind is None else self.wind[part],
            concentration=None if self.concentration is None else self.concentration[part],
            period=0.0 if (start, stop) != (0, self.n_frames) else self.period,
        )

    def layer(self, height: float) -> Field:
        """The layer of cells that holds `height`, m (the nearest one outside the grid), as a field one cell high."""
        k = int(np.clip((height - self.low[2]) // self.spacing[2], 0, self.shape[2] - 1))
        part = slice(k, k + 1)
        return dataclasses.replace(
            self,
            origin=self.origin + np.array([0.0, 0.0, k * self.spacing[2]]),
            wind=None if self.wind is None else np.ascontiguousarray(self.wind[:, :, :, part]),
            concentration=None if self.concentration is None else np.ascontiguousarray(self.concentration[..., part]),
            solid=None if self.solid is None else self.solid[..., part],
        )


def _vector(name: str, values: ArrayLike, size: int | None) -> FloatArray:
    try:
        vector = np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} = {values!r:.80}: must be numbers") from None
    if vector.ndim != 1 or vector.size == 0 or (size is not None and vector.size != size):
        raise InputError(f"{name}: has shape {vector.shape}; must be ({size or 'n_t'},)")
    if not np.all(np.isfinite(vector)) or float(np.abs(vector).max()) > 1e12:
        raise InputError(f"{name}: every number must be finite and below 1e12")
    return vector


def _grid(name: str, values: ArrayLike, lead: tuple[int, ...], tail: tuple[int, ...], limit: float) -> Grid:
    """`values` as float32 of shape (*lead, nx, ny, nz, *tail), all finite and within `limit`."""
    with np.errstate(all="ignore"):  # what is not a finite float32 is refused below
        grid = np.ascontiguousarray(values, dtype=np.float32)
    n_lead, n_tail = len(lead), len(tail)
    shape = grid.shape
    if len(shape) != n_lead + 3 + n_tail or shape[:n_lead] != lead or shape[n_lead + 3 :] != tail or grid.size == 0:
        wanted = ", ".join([*map(str, lead), "nx", "ny", "nz", *map(str, tail)])
        raise InputError(f"{name}: has shape {shape}; must be ({wanted})")
    low, high = float(grid.min()), float(grid.max())  # NaN if any value is
    if not (-limit <= low and high <= limit):
        raise InputError(f"{name}: holds values from {low:g} to {high:g}; must be finite and within {limit:g}")
    return grid


def _json(name: str, card: dict[str, Any]) -> dict[str, Any]:
    """A copy of `card`, which must be a JSON object whose `sources`, if any, have positions."""
    try:
        copy: dict[str, Any] = json.loads(json.dumps(card, allow_nan=False))
    except (TypeError, ValueError, RecursionError):
        raise InputError(f"{name}: must hold JSON values only (text, finite numbers, lists, mappings)") from None
    if not isinstance(copy, dict):
        raise InputError(f"{name}: must be a mapping")
    sources = copy.get("sources", [])
    if not isinstance(sources, list) or not all(isinstance(entry, dict) for entry in sources):
        raise InputError(f"{name}.sources: must be a list of mappings with a position")
    for k, entry in enumerate(sources):
        _vector(f"{name}.sources.{k}.position", entry.get("position"), 3)
    return copy
