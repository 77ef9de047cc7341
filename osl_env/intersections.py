"""Where a straight segment first meets a solid: boxes, upright cylinders and the cells of an occupancy grid.

The segment goes from (x0, y0, z0) by (dx, dy, dz); a meeting is a share t of it, 0 .. 1, or `NONE`. Solids are closed
(touching is meeting), and 0 is returned for a segment that begins inside one. Boxes: slabs (Kay and Kajiya 1986).
Cylinders: the quadratic of the side and the slab of the caps. Grid: the traversal of Amanatides and Woo (1987), with
all the cells around an edge or corner that is crossed, so that nothing slips between two cells that touch there.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

NONE = 2.0  # no meeting
_SAME = 1e-12  # shares this near to each other: an edge or a corner of cells is crossed
SOLID_CELL = 1  # `osl_env.geometry.SOLID`
SIDE = 3  # what is met: the faces across axis 0, 1, 2, or the side of a cylinder; -1: the segment begins inside


@njit(inline="always", error_model="numpy")
def _slab(low: float, high: float, x: float, d: float) -> Any:
    """The shares between which a coordinate is within [low, high]; first > last: never."""
    if d == 0.0:
        return (-math.inf, math.inf) if low <= x <= high else (math.inf, -math.inf)
    first, last = (low - x) / d, (high - x) / d
    return (first, last) if first <= last else (last, first)


@njit(error_model="numpy")
def box_entry(
    xl: float, yl: float, zl: float, xh: float, yh: float, zh: float,
    x0: float, y0: float, z0: float, dx: float, dy: float, dz: float,
) -> tuple[float, int]:  # fmt: skip
    """Share at which the segment meets the box of the corners (xl, yl, zl) and (xh, yh, zh), m, and the face's axis."""
    first, last = _slab(xl, xh, x0, dx)
    axis = 0
    low, high = _slab(yl, yh, y0, dy)
    if low > first:
        first, axis = low, 1
    last = min(last, high)
    low, high = _slab(zl, zh, z0, dz)
    if low > first:
        first, axis = low, 2
    last = min(last, high)
    if first > last or last < 0.0 or first > 1.0:
        return NONE, -1
    return (first, axis) if first > 0.0 else (0.0, -1)


@njit(error_model="numpy")
def cylinder_entry(
    x: float, y: float, radius: float, bottom: float, top: float,
    x0: float, y0: float, z0: float, dx: float, dy: float, dz: float,
) -> tuple[float, int]:  # fmt: skip
    """Share at which the segment meets the upright cylinder around (x, y), m, and the axis 2 for a cap, or SIDE."""
    u, v = x0 - x, y0 - y
    a, b, c = dx * dx + dy * dy, u * dx + v * dy, u * u + v * v - radius * radius
    first, last = -math.inf, math.inf
    if a > 0.0:
        discriminant = b * b - a * c
        if discriminant < 0.0:
            return NONE, -1
        root = math.sqrt(discriminant)
        first, last = (-b - root) / a, (-b + root) / a
    elif c > 0.0:
        return NONE, -1
    face = SIDE
    low, high = _slab(bottom, top, z0, dz)
    if low > first:
        first, face = low, 2
    last = min(last, high)
    if first > last or last < 0.0 or first > 1.0:
        return NONE, -1
    return (first, face) if first > 0.0 else (0.0, -1)


@njit(inline="always", error_model="numpy")
def _crossing(i: int, low: float, side: float, x: float, d: float) -> float:
    """Share at which the segment leaves the cell `i` along one axis."""
    if d == 0.0:
        return math.inf
    return (low + (i + 1 if d > 0.0 else i) * side - x) / d


@njit(inline="always", error_model="numpy")
def _first_cell(x: float, low: float, side: float, n: int, beyond: int) -> int:
    return min(max(math.floor((x - low) / side), -beyond), n - 1 + beyond)


@njit(error_model="numpy")
def _nearest_cell(
    cells: Any, origin: Any, spacing: Any, margin: float, i: int, j: int, k: int, i2: int, j2: int, k2: int,
    rx: int, ry: int, rz: int, x0: float, y0: float, z0: float, dx: float, dy: float, dz: float,
) -> tuple[float, int]:  # fmt: skip
    """The first meeting with a solid cell, grown by `margin`, within (rx, ry, rz) cells of those from i, j, k to
    i2, j2, k2."""
    best, axis = NONE, -1
    for p in range(max(min(i, i2) - rx, 0), min(max(i, i2) + rx, cells.shape[0] - 1) + 1):
        xl = origin[0] + p * spacing[0] - margin
        for q in range(max(min(j, j2) - ry, 0), min(max(j, j2) + ry, cells.shape[1] - 1) + 1):
            yl = origin[1] + q * spacing[1] - margin
            for r in range(max(min(k, k2) - rz, 0), min(max(k, k2) + rz, cells.shape[2] - 1) + 1):
                if cells[p, q, r] != SOLID_CELL:
                    continue
                zl = origin[2] + r * spacing[2] - margin
                xh = origin[0] + (p + 1) * spacing[0] + margin
                yh = origin[1] + (q + 1) * spacing[1] + margin
                zh = origin[2] + (r + 1) * spacing[2] + margin
                t, face = box_entry(xl, yl, zl, xh, yh, zh, x0, y0, z0, dx, dy, dz)
                if t < best:
                    best, axis = t, face
    return best, axis


@njit(inline="always", error_model="numpy")
def _is_solid_among(cells: Any, i: int, j: int, k: int, i2: int, j2: int, k2: int) -> bool:
    """Whether a cell from i, j, k to i2, j2, k2 is solid; cells outside the grid are not."""
    for p in range(max(min(i, i2), 0), min(max(i, i2), cells.shape[0] - 1) + 1):
        for q in range(max(min(j, j2), 0), min(max(j, j2), cells.shape[1] - 1) + 1):
            for r in range(max(min(k, k2), 0), min(max(k, k2), cells.shape[2] - 1) + 1):
                if cells[p, q, r] == SOLID_CELL:
                    return True
    return False


@njit(error_model="numpy")
def grid_entry(
    cells: Any, origin: Any, spacing: Any, margin: float,
    x0: float, y0: float, z0: float, dx: float, dy: float, dz: float,
) -> tuple[float, int]:  # fmt: skip
    """Share at which the segment meets a solid cell grown by `margin`, m, on all sides, and the axis of the face."""
    nx, ny, nz = cells.shape
    rx, ry, rz = math.ceil(margin / spacing[0]), math.ceil(margin / spacing[1]), math.ceil(margin / spacing[2])
    start, axis = box_entry(
        origin[0] - rx * spacing[0], origin[1] - ry * spacing[1], origin[2] - rz * spacing[2],
        origin[0] + (nx + rx) * spacing[0], origin[1] + (ny + ry) * spacing[1], origin[2] + (nz + rz) * spacing[2],
        x0, y0, z0, dx, dy, dz,
    )  # fmt: skip
    if start > 1.0:
        return NONE, -1
    i = _first_cell(x0 + start * dx, origin[0], spacing[0], nx, rx)
    j = _first_cell(y0 + start * dy, origin[1], spacing[1], ny, ry)
    k = _first_cell(z0 + start * dz, origin[2], spacing[2], nz, rz)
    i2, j2, k2 = i, j, k
    t = start
    while True:
        if margin > 0.0:
            best, face = _nearest_cell(cells, origin, spacing, margin, i, j, k, i2, j2, k2, rx, ry, rz,
                                       x0, y0, z0, dx, dy, dz)  # fmt: skip
        elif _is_solid_among(cells, i, j, k, i2, j2, k2):
            return max(t, 0.0), axis
        else:
            best, face = NONE, -1
        i, j, k = i2, j2, k2
        tx = _crossing(i, origin[0], spacing[0], x0, dx)
        ty = _crossing(j, origin[1], spacing[1], y0, dy)
        tz = _crossing(k, origin[2], spacing[2], z0, dz)
        t = min(tx, ty, tz)
        if best <= t or t > 1.0:
            return best, face
        axis = 0 if tx == t else 1 if ty == t else 2
        if tx <= t + _SAME:
            i2 = i + 1 if dx > 0.0 else i - 1
        if ty <= t + _SAME:
            j2 = j + 1 if dy > 0.0 else j - 1
        if tz <= t + _SAME:
            k2 = k + 1 if dz > 0.0 else k - 1
        if i2 < -rx or i2 >= nx + rx or j2 < -ry or j2 >= ny + ry or k2 < -rz or k2 >= nz + rz:
            return best, face
