"""Solid things in the arena, for compiled code: what is inside them, and how far a straight line is free.

A `Geometry` holds axis-aligned boxes, upright cylinders and an occupancy grid, any of them empty; the bounds of the
arena are not part of it. Boxes and cylinders are closed; a cell of the grid owns its low faces. A UAV keeps
`clearance` from every surface: for its flight, boxes, cylinders and solid cells are larger by it on every side (a
little more than a ball needs at edges).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from osl_env.intersections import NONE, SIDE, SOLID_CELL, box_entry, cylinder_entry, grid_entry
from osl_env.parameters import FloatArray
from osl_env.state import BoolArray

FREE, SOLID, OUTLET = 0, SOLID_CELL, 2  # contents of a cell of the occupancy grid (GADEN's numbers)
_LONGER = 1.0 + 1e-9  # how much longer than a ray what is near it is looked for: more than rounding
_BESIDE = 1e-6  # m by which a box is surely beside a segment, for all rounding
_BACK = 1e-9  # m along its path that a UAV stops before a surface, at least


class Geometry(NamedTuple):
    """Obstacles of a scenario, the same in all its worlds."""

    boxes: FloatArray  # (n, 6) m: low corner, high corner
    cylinders: FloatArray  # (n, 5) m: x, y, radius, bottom, top
    cells: NDArray[np.uint8]  # (nx, ny, nz): FREE, SOLID or OUTLET; (0, 0, 0): no grid
    origin: FloatArray  # (3,) m: low corner of the grid
    spacing: FloatArray  # (3,) m: sides of a cell
    clearance: float = 0.0  # m that UAVs keep from surfaces; nothing to the air and what it carries


def open_air() -> Geometry:
    """A geometry without anything in it."""
    return Geometry(np.empty((0, 6)), np.empty((0, 5)), np.empty((0, 0, 0), np.uint8), np.zeros(3), np.ones(3))


@njit(inline="always", error_model="numpy")
def has_obstacles(geometry: Any) -> bool:
    """Whether there is anything in the geometry, outlets included."""
    return bool((geometry.boxes.shape[0] > 0) | (geometry.cylinders.shape[0] > 0) | (geometry.cells.size > 0))


@njit(inline="always", error_model="numpy")
def _content(geometry: Any, x: float, y: float, z: float) -> int:
    """What the occupancy grid holds at a place; FREE outside it."""
    cells, origin, spacing = geometry.cells, geometry.origin, geometry.spacing
    i = math.floor((x - origin[0]) / spacing[0])
    j = math.floor((y - origin[1]) / spacing[1])
    k = math.floor((z - origin[2]) / spacing[2])
    if i < 0 or j < 0 or k < 0 or i >= cells.shape[0] or j >= cells.shape[1] or k >= cells.shape[2]:
        return FREE
    return int(cells[int(i), int(j), int(k)])


@njit(error_model="numpy")
def is_solid(geometry: Any, x: float, y: float, z: float) -> bool:
    """Whether the place (x, y, z), m, is inside or on an obstacle."""
    boxes, cylinders = geometry.boxes, geometry.cylinders
    for n in range(boxes.shape[0]):
        b = boxes[n]
        if b[0] <= x <= b[3] and b[1] <= y <= b[4] and b[2] <= z <= b[5]:
            return True
    for n in range(cylinders.shape[0]):
        c = cylinders[n]
        if (x - c[0]) ** 2 + (y - c[1]) ** 2 <= c[2] ** 2 and c[3] <= z <= c[4]:
            return True
    return geometry.cells.size > 0 and _content(geometry, x, y, z) == SOLID


@njit(error_model="numpy")
def is_outlet(geometry: Any, x: float, y: float, z: float) -> bool:
    """Whether the place (x, y, z), m, is in a cell through which the air leaves."""
    return geometry.cells.size > 0 and _content(geometry, x, y, z) == OUTLET


@njit(inline="always", error_model="numpy")
def _first_box(
    boxes: Any, margin: float, x0: float, y0: float, z0: float, x1: float, y1: float, z1: float
) -> tuple[float, int]:
    """The first of `boxes`, grown by `margin`, on a segment, as `box_entry` says it; those beside it cost little."""
    best, face, beside = NONE, -1, margin + _BESIDE
    west, south, low = min(x0, x1) - beside, min(y0, y1) - beside, min(z0, z1) - beside
    east, north, high = max(x0, x1) + beside, max(y0, y1) + beside, max(z0, z1) + beside
    for n in range(boxes.shape[0]):
        b = boxes[n]
        if b[0] > east or b[3] < west or b[1] > north or b[4] < south or b[2] > high or b[5] < low:
            continue
        t, side = box_entry(b[0] - margin, b[1] - margin, b[2] - margin, b[3] + margin, b[4] + margin, b[5] + margin,
                            x0, y0, z0, x1 - x0, y1 - y0, z1 - z0)  # fmt: skip
        if t < best:
            best, face = t, side
    return best, face


@njit(error_model="numpy")
def first_hit(
    geometry: Any, margin: float, x0: float, y0: float, z0: float, x1: float, y1: float, z1: float
) -> tuple[float, float, float, float]:
    """The first solid, grown by `margin` m, on the segment from (x0, y0, z0) to (x1, y1, z1), m.

    Returns the share of the segment before it (1: none is met; 0: it begins inside one) and the unit normal of the
    surface there, outwards (zero where there is none).
    """
    dx, dy, dz = x1 - x0, y1 - y0, z1 - z0
    cylinders, met = geometry.cylinders, -1
    best, face = _first_box(geometry.boxes, margin, x0, y0, z0, x1, y1, z1)
    for n in range(cylinders.shape[0]):
        c = cylinders[n]
        t, side = cylinder_entry(c[0], c[1], c[2] + margin, c[3] - margin, c[4] + margin, x0, y0, z0, dx, dy, dz)
        if t < best:
            best, face, met = t, side, n
    if geometry.cells.size > 0:
        t, side = grid_entry(geometry.cells, geometry.origin, geometry.spacing, margin, x0, y0, z0, dx, dy, dz)
        if t < best:
            best, face = t, side
    if best > 1.0:
        return 1.0, 0.0, 0.0, 0.0
    if face == 0:
        return best, -math.copysign(1.0, dx), 0.0, 0.0
    if face == 1:
        return best, 0.0, -math.copysign(1.0, dy), 0.0
    if face == 2:
        return best, 0.0, 0.0, -math.copysign(1.0, dz)
    if face == SIDE:
        u, v = x0 + best * dx - cylinders[met, 0], y0 + best * dy - cylinders[met, 1]
        distance = math.sqrt(u * u + v * v)
        return best, u / distance, v / distance, 0.0
    return best, 0.0, 0.0, 0.0


@njit(error_model="numpy")
def clear_share(geometry: Any, x0: float, y0: float, z0: float, x1: float, y1: float, z1: float) -> float:
    """The share, 0 .. 1, of the segment that is free of solids, from its beginning; 1: all of it."""
    if not has_obstacles(geometry):
        return 1.0
    return float(first_hit(geometry, 0.0, x0, y0, z0, x1, y1, z1)[0])


@njit(error_model="numpy")
def is_taken(geometry: Any, x: float, y: float, z: float) -> bool:
    """Whether a UAV cannot be at (x, y, z), m: inside a solid, or less than `clearance` from one."""
    return bool(first_hit(geometry, geometry.clearance, x, y, z, x, y, z)[0] < 1.0)


@njit(error_model="numpy")
def flight_share(
    geometry: Any, x0: float, y0: float, z0: float, x1: float, y1: float, z1: float
) -> tuple[float, float, float, float]:
    """How far a UAV can fly along the segment: the share of it, 1 for all, and the normal of what stops it.

    A UAV at (x0, y0, z0) + share * (dx, dy, dz) is free (see `is_taken`) if it was at the beginning, rounding or not.
    """
    share, u, v, w = first_hit(geometry, geometry.clearance, x0, y0, z0, x1, y1, z1)
    if share >= 1.0 and not is_taken(geometry, x1, y1, z1):
        return 1.0, 0.0, 0.0, 0.0
    dx, dy, dz = x1 - x0, y1 - y0, z1 - z0
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    back = _BACK / length if length > _BACK else 1.0
    share = max(share - back, 0.0)
    while share > 0.0 and is_taken(geometry, x0 + share * dx, y0 + share * dy, z0 + share * dz):
        back *= 2.0
        share = max(share - back, 0.0)
    return share, u, v, w


@njit(inline="always", error_model="numpy")
def _to_wall(area: Any, x: float, y: float, z: float, dx: float, dy: float, dz: float, longest: float) -> float:
    """Distance, m, along the unit vector (dx, dy, dz) to the walls of the arena; `longest` if they are farther."""
    reach = longest
    if dx != 0.0 and area[0] < math.inf:
        reach = min(reach, ((area[0] if dx > 0.0 else 0.0) - x) / dx)
    if dy != 0.0 and area[1] < math.inf:
        reach = min(reach, ((area[1] if dy > 0.0 else 0.0) - y) / dy)
    if dz != 0.0 and area[2] < math.inf:
        reach = min(reach, ((area[2] if dz > 0.0 else 0.0) - z) / dz)
    return max(reach, 0.0)


@njit(error_model="numpy")
def ray_distance(
    geometry: Any, area: Any, x: float, y: float, z: float, dx: float, dy: float, dz: float, longest: float
) -> float:
    """Distance, m, from a place inside the arena along the unit vector (dx, dy, dz) to the first solid or bound.

    The arena is [0, Lx] x [0, Ly] x [0, Lz] with `area` (3,) m, without walls across an axis where it is infinite;
    `longest` if there is nothing nearer.
    """
    reach = _to_wall(area, x, y, z, dx, dy, dz, longest)
    return reach * clear_share(geometry, x, y, z, x + reach * dx, y + reach * dy, z + reach * dz)


@njit(error_model="numpy")
def _is_near(geometry: Any, x: float, y: float, z: float, radius: float) -> bool:
    """Whether a solid may be within `radius`, m, of (x, y, z): no if none is; any grid of cells may."""
    boxes, cylinders = geometry.boxes, geometry.cylinders
    for n in range(boxes.shape[0]):
        b = boxes[n]
        if (
            b[0] - radius <= x <= b[3] + radius
            and b[1] - radius <= y <= b[4] + radius
            and b[2] - radius <= z <= b[5] + radius
        ):
            return True
    for n in range(cylinders.shape[0]):
        c = cylinders[n]
        across = c[2] + radius
        if abs(x - c[0]) <= across and abs(y - c[1]) <= across and c[3] - radius <= z <= c[4] + radius:
            return True
    return bool(geometry.cells.size > 0)


@njit(cache=True, error_model="numpy")
def range_readings(
    geometry: Geometry, area: FloatArray, positions: FloatArray, n_rays: int, longest: float, out: FloatArray
) -> None:
    """Distances, m, to what is around the UAVs at `positions` (n_envs, n_uavs, 3), into `out` (n_envs, n_uavs, n_rays).

    The rays are horizontal and equally spaced in the world's frame: the first along +x, the others counter-clockwise.
    """
    rays = np.empty((n_rays, 2))
    for r in range(n_rays):
        angle = 2.0 * math.pi * r / n_rays
        rays[r, 0], rays[r, 1] = math.cos(angle), math.sin(angle)
        if 4 * r % n_rays == 0:  # along an axis: exactly
            rays[r, 0], rays[r, 1] = float(round(rays[r, 0])), float(round(rays[r, 1]))
    for e in range(positions.shape[0]):
        for i in range(positions.shape[1]):
            x, y, z = positions[e, i, 0], positions[e, i, 1], positions[e, i, 2]
            alone = not _is_near(geometry, x, y, z, longest * _LONGER)
            for r in range(n_rays):
                dx, dy = rays[r, 0], rays[r, 1]
                if alone:
                    out[e, i, r] = _to_wall(area, x, y, z, dx, dy, 0.0, longest)
                else:
                    out[e, i, r] = ray_distance(geometry, area, x, y, z, dx, dy, 0.0, longest)


@njit(cache=True, error_model="numpy")
def mark_taken(geometry: Geometry, places: FloatArray, taken: BoolArray) -> None:
    """At which of `places` (n, 3), m, a UAV cannot be, into `taken` (n,)."""
    for k in range(places.shape[0]):
        taken[k] = is_taken(geometry, places[k, 0], places[k, 1], places[k, 2])


@njit(cache=True, error_model="numpy")
def mark_clear(geometry: Geometry, begin: FloatArray, ends: FloatArray, clear: BoolArray) -> None:
    """To which of `ends` (n, 3), m, a UAV can fly straight from `begin` (3,), m, into `clear` (n,)."""
    x, y, z = begin[0], begin[1], begin[2]
    for k in range(ends.shape[0]):
        clear[k] = flight_share(geometry, x, y, z, ends[k, 0], ends[k, 1], ends[k, 2])[0] >= 1.0
