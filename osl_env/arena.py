"""The search volume: an axis-aligned box from the origin to its far corner, and the obstacles in it.

Obstacles are axis-aligned boxes, upright cylinders, and the solid cells of a field file (an occupancy grid), in any
combination. They stop UAVs (`collision`), air and gas alike; UAVs keep `clearance` from their surfaces.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Annotated, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, field_validator, model_validator

from osl_env.geometry import Geometry, mark_clear, mark_taken, open_air
from osl_env.parameters import FloatArray, Parameters, Vector, quantity
from osl_env.state import BoolArray

_LATTICE = 16  # places along each side of a region that are tried when a free one is sought


class Box(Parameters):
    """An axis-aligned box."""

    kind: Literal["box"] = "box"
    low: Vector = quantity(..., "m")  # corners
    high: Vector = quantity(..., "m")

    @model_validator(mode="after")
    def _ordered(self) -> Box:
        if any(low >= high for low, high in zip(self.low, self.high, strict=True)):
            raise ValueError(f"high = {list(self.high)}: must exceed low = {list(self.low)} on every axis")
        return self

    def meets(self, size: Vector) -> bool:
        """Whether some of it is inside the arena of `size`, m."""
        return all(low < side and high > 0.0 for low, high, side in zip(self.low, self.high, size, strict=True))


class Cylinder(Parameters):
    """An upright cylinder."""

    kind: Literal["cylinder"] = "cylinder"
    center: tuple[float, float] = quantity(..., "m")  # x, y of the axis
    radius: float = quantity(..., "m", gt=0)
    bottom: float = quantity(0.0, "m")
    top: float = quantity(math.inf, "m", infinite=True)  # default: as high as the arena

    @model_validator(mode="after")
    def _upright(self) -> Cylinder:
        if self.top <= self.bottom:
            raise ValueError(f"top = {self.top:g}: must exceed bottom = {self.bottom:g}")
        return self

    def meets(self, size: Vector) -> bool:
        """Whether some of it is inside the arena of `size`, m."""
        x, y = self.center
        outside = math.hypot(x - min(max(x, 0.0), size[0]), y - min(max(y, 0.0), size[1]))
        return outside < self.radius and self.bottom < size[2] and self.top > 0.0


Obstacle: TypeAlias = Annotated[Box | Cylinder, Field(discriminator="kind")]


class Occupancy(Parameters):
    """The solid cells of a field, moved by `offset`: the place of the field's own origin in the arena."""

    field: str = Field(min_length=1)  # name or path of a field file
    offset: Vector = quantity((0.0, 0.0, 0.0), "m")


class _Solids:
    """A Geometry that compares by identity, for pydantic compares whatever it finds in two models."""

    __slots__ = ("geometry",)

    def __init__(self, geometry: Geometry) -> None:
        self.geometry = geometry


class Arena(Parameters):
    """Bounds of the search volume, 0 <= x <= Lx, 0 <= y <= Ly, 0 <= z <= Lz, and the obstacles inside.

    A UAV that runs into an obstacle stops there (`stop`), keeps the part of its velocity along the surface (`slide`;
    legs are straight, and stop), or is lost (`end`). UAVs that fly velocities or setpoints are held at the bounds
    (`hold`), or lost once they are more than `margin` outside (`end`); legs stay inside.
    """

    size: Vector = quantity((100.0, 60.0, 30.0), "m")  # Lx, Ly, Lz
    obstacles: tuple[Obstacle, ...] = ()
    occupancy: str | Occupancy | None = None  # name or path of a field file whose solid cells are obstacles
    collision: Literal["stop", "slide", "end"] = "slide"
    clearance: float = quantity(0.01, "m", gt=0)  # that UAVs keep from surfaces: a UAV's radius
    bounds: Literal["hold", "end"] = "hold"
    margin: float = quantity(0.0, "m", ge=0)

    @field_validator("size")
    @classmethod
    def _positive(cls, size: Vector) -> Vector:
        if min(size) <= 0:
            raise ValueError(f"size = {list(size)}: every side must be above 0 m")
        return size

    @field_validator("obstacles", mode="before")
    @classmethod
    def _named_kinds(cls, obstacles: object) -> object:
        """Each obstacle must say what it is: its other keys then give clear messages."""
        if not isinstance(obstacles, list | tuple):
            raise ValueError(f"obstacles = {obstacles!r}: must be a list of boxes and cylinders")
        for k, entry in enumerate(obstacles):
            if isinstance(entry, dict) and entry.get("kind") not in ("box", "cylinder"):
                raise ValueError(f"obstacles.{k}.kind = {entry.get('kind')!r}: allowed are box, cylinder")
        return obstacles

    @field_validator("occupancy", mode="before")
    @classmethod
    def _named_field(cls, occupancy: object) -> object:
        """A mapping is an Occupancy, whose keys then give clear messages."""
        return Occupancy.model_validate(occupancy) if isinstance(occupancy, dict) else occupancy

    @model_validator(mode="after")
    def _fits(self) -> Arena:
        for k, obstacle in enumerate(self.obstacles):
            if not obstacle.meets(self.size):
                raise ValueError(f"obstacles.{k}: this {obstacle.kind} is outside the arena of {list(self.size)} m")
        if self.occupancy is not None:
            _ = self.geometry  # loads and checks the field
        return self

    @property
    def geometry(self) -> Geometry:
        """The obstacles, for compiled code. Raises ValueError if the field of `occupancy` does not fit."""
        return self._solids.geometry

    @cached_property
    def _solids(self) -> _Solids:
        return _Solids(self._build())

    def _build(self) -> Geometry:
        empty = open_air()
        boxes = [(*o.low, *o.high) for o in self.obstacles if isinstance(o, Box)]
        cylinders = [
            (*o.center, o.radius, o.bottom, min(o.top, max(self.size[2], o.bottom) + 1.0))
            for o in self.obstacles
            if isinstance(o, Cylinder)
        ]
        geometry = Geometry(
            np.array(boxes, dtype=np.float64).reshape(-1, 6),
            np.array(cylinders, dtype=np.float64).reshape(-1, 5),
            empty.cells,
            empty.origin,
            empty.spacing,
            self.clearance,
        )
        return geometry if self.occupancy is None else self._with_cells(geometry)

    def _with_cells(self, geometry: Geometry) -> Geometry:
        from osl_env.fields import load_field  # reading files is needed only here

        given = Occupancy(field=self.occupancy) if isinstance(self.occupancy, str) else self.occupancy
        assert given is not None
        try:
            field = load_field(given.field)
        except ValueError as error:
            raise ValueError(f"occupancy = {given.field!r}: {error}") from None
        if field.solid is None:
            raise ValueError(f"occupancy = {given.field!r}: this field has no solid cells")
        if not field.covers(self.size, given.offset):
            low, high = field.low + np.array(given.offset), field.high + np.array(given.offset)
            raise ValueError(
                f"occupancy = {given.field!r}: its cells from {_rounded(low)} to {_rounded(high)} m do not cover the"
                f" arena from [0, 0, 0] to {list(self.size)} m"
            )
        origin, spacing = field.low + np.array(given.offset), np.array(field.spacing)
        if field.solid.shape[2] == 1:  # a single layer holds at all heights
            origin[2], spacing[2] = -1.0, self.size[2] + 2.0
        return geometry._replace(cells=np.array(field.solid, np.uint8, order="C"), origin=origin, spacing=spacing)

    @property
    def obstructed(self) -> bool:
        """Whether there are any obstacles."""
        return bool(self.obstacles) or self.occupancy is not None

    def contains(self, position: Vector) -> bool:
        """Whether `position` (m) lies inside or on the bounds."""
        return all(0.0 <= x <= side for x, side in zip(position, self.size, strict=True))

    def is_free(self, position: ArrayLike) -> bool:
        """Whether `position` (3,), m, is at least `clearance` away from every obstacle."""
        return bool(self.free(np.asarray(position, dtype=np.float64)[None])[0])

    def free(self, places: FloatArray) -> BoolArray:
        """Which of `places` (n, 3), m, are at least `clearance` away from every obstacle: (n,)."""
        taken = np.zeros(len(places), np.bool_)
        if self.obstructed:
            mark_taken(self.geometry, np.ascontiguousarray(places, dtype=np.float64), taken)
        return ~taken

    def clear(self, a: ArrayLike, b: ArrayLike) -> bool:
        """Whether a UAV can fly straight from `a` to `b` (3,), m, past all obstacles."""
        return bool(self.clear_from(np.asarray(a), np.asarray(b)[None])[0])

    def clear_from(self, begin: FloatArray, ends: FloatArray) -> BoolArray:
        """To which of `ends` (n, 3), m, a UAV can fly straight from `begin` (3,), m, past all obstacles: (n,)."""
        clear = np.ones(len(ends), np.bool_)
        if self.obstructed:
            first = np.ascontiguousarray(begin, dtype=np.float64)
            mark_clear(self.geometry, first, np.ascontiguousarray(ends, dtype=np.float64), clear)
        return clear

    def has_room(self, region: tuple[Vector, Vector]) -> bool:
        """Whether a lattice in the box `region` (low and high corner, m) finds a place that is free."""
        sides = [np.linspace(low, high, 2 * _LATTICE + 1)[1::2] for low, high in zip(*region, strict=True)]
        lattice = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
        return bool(self.free(lattice).any())


def _rounded(corner: FloatArray) -> list[float]:
    return [round(float(x), 6) for x in corner]
