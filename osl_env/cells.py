"""Cells: which points may lie within a radius of a place, without looking at all of them.

The box around the points is cut into cells that are no smaller than the radius, and the points are sorted by cell (a
counting sort), x fastest: all that is within the radius of a place is then in at most nine runs of consecutive points
(three cells along x each), and the caller checks distances. At constant density the work of a point does not depend on
how many there are. Few points, or a radius as large as their box, make one cell, and one run of all points.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from osl_env.parameters import FloatArray
from osl_env.state import IntArray

FEWEST = 24  # points from which on cells were measured to be faster than looking at all
MOST_RUNS = 9
_WIDER = 1.0 + 1e-9  # cells are wider than the radius by more than rounding: what is near is in the next one at most


class Cells(NamedTuple):
    """Points sorted by cell: room for n of them, used again and again. The caller fills in `points` and `names`."""

    points: FloatArray  # (n, 3) m
    names: IntArray  # (n,) what the caller calls them
    places: FloatArray  # (n, 3) m: the points, sorted by cell
    sorted_names: IntArray  # (n,)
    first: IntArray  # (2 n + 1,) where each cell's points begin, and where the last one's end
    counts: IntArray  # (3,) cells along each axis
    low: FloatArray  # (3,) m, the low corner of the box
    side: FloatArray  # (3,) m, of a cell


@njit(error_model="numpy")
def make_cells(most: int) -> Any:
    """Room for `most` points."""
    return Cells(
        np.empty((most, 3)),
        np.empty(most, np.int64),
        np.empty((most, 3)),
        np.empty(most, np.int64),
        np.empty(2 * most + 2, np.int64),
        np.empty(3, np.int64),
        np.empty(3),
        np.empty(3),
    )


@njit(inline="always", error_model="numpy")
def _along(cells: Any, axis: int, x: float) -> int:
    """Which cell along `axis` the coordinate `x`, m, is in; the outer ones hold what is outside the box."""
    at = (x - cells.low[axis]) / cells.side[axis] if cells.counts[axis] > 1 else 0.0
    if not at > 0.0:
        return 0
    return int(at) if at < cells.counts[axis] else cells.counts[axis] - 1


@njit(error_model="numpy")
def _cut(cells: Any, n: int, radius: float) -> int:
    """Cut the box of the first `n` points into cells of at least `radius`, m; returns how many there are."""
    counts, points = cells.counts, cells.points
    counts[:] = 1
    if n < FEWEST:
        return 1
    for axis in range(3):
        low = high = points[0, axis]
        for k in range(1, n):
            low, high = min(low, points[k, axis]), max(high, points[k, axis])
        cells.low[axis], cells.side[axis] = low, high - low
        fit = cells.side[axis] / (radius * _WIDER)
        if fit >= 2.0:
            counts[axis] = int(min(fit, float(n)))
    while counts[0] * counts[1] * counts[2] > 2 * n:
        counts[np.argmax(counts)] //= 2
    for axis in range(3):
        cells.side[axis] /= counts[axis]
    return int(counts[0] * counts[1] * counts[2])


@njit(error_model="numpy")
def sort_into_cells(cells: Any, n: int, radius: float) -> None:
    """Sort the first `n` of `points` into cells of at least `radius`, m; in a cell they keep their order."""
    points, first, counts = cells.points, cells.first, cells.counts
    n_cells = _cut(cells, n, radius)
    if n_cells == 1:
        first[0], first[1] = 0, n
        cells.places[:n] = points[:n]
        cells.sorted_names[:n] = cells.names[:n]
        return
    first[: n_cells + 2] = 0
    for k in range(n):
        i, j, m = _along(cells, 0, points[k, 0]), _along(cells, 1, points[k, 1]), _along(cells, 2, points[k, 2])
        first[(m * counts[1] + j) * counts[0] + i + 2] += 1
    for cell in range(2, n_cells + 1):
        first[cell] += first[cell - 1]
    for k in range(n):  # first[c + 1] runs from where cell c begins to where it ends
        i, j, m = _along(cells, 0, points[k, 0]), _along(cells, 1, points[k, 1]), _along(cells, 2, points[k, 2])
        cell = (m * counts[1] + j) * counts[0] + i
        at = first[cell + 1]
        first[cell + 1] += 1
        cells.sorted_names[at] = cells.names[k]
        for axis in range(3):
            cells.places[at, axis] = points[k, axis]


@njit(inline="always", error_model="numpy")
def runs_near(cells: Any, x: float, y: float, z: float, runs: Any) -> int:
    """Where in `places` all that is within the radius of (x, y, z), m, stands: begins and ends of runs, into `runs`
    (MOST_RUNS, 2); returns how many runs there are.
    """
    first, counts = cells.first, cells.counts
    i, j, m = _along(cells, 0, x), _along(cells, 1, y), _along(cells, 2, z)
    west, east = max(i - 1, 0), min(i + 1, counts[0] - 1)
    n_runs = 0
    for layer in range(max(m - 1, 0), min(m + 2, counts[2])):
        for line in range(max(j - 1, 0), min(j + 2, counts[1])):
            cell = (layer * counts[1] + line) * counts[0]
            runs[n_runs, 0], runs[n_runs, 1] = first[cell + west], first[cell + east + 1]
            n_runs += 1
    return n_runs
