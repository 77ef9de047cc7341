"""Ways among obstacles: which hops are clear, which places are free, and where to fly first to get behind something.

The team knows the map (`Briefing.arena`), so that this is looked up, not sensed. A route goes over a lattice of free
places all over the arena, with flights to the 26 neighbours where nothing is in the way: Dijkstra's distances from the
goal, then the place in sight of the UAV from which the way is shortest. Without obstacles every place is free and every
way straight, and nothing is computed.
"""

from __future__ import annotations

import functools
import heapq
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from baselines.policy import Briefing
from osl_env.actions import HOP_DIRECTIONS
from osl_env.arena import Arena
from osl_env.geometry import Geometry, flight_share
from osl_env.parameters import FloatArray
from osl_env.state import BoolArray, IntArray

_N_PLACES = 8000  # of the lattice, about
_SAME = 1e-9  # m, two ways are as long; also: no flight
_STEPS: NDArray[np.int64] = HOP_DIRECTIONS.astype(np.int64)


@njit(cache=True, error_model="numpy")
def _reach(geometry: Geometry, position: FloatArray, steps: FloatArray, longest: int, out: IntArray) -> None:
    """How many of `longest` times `steps` (n, 3), m, are clear from `position` (3,), into `out` (n,)."""
    x, y, z = position[0], position[1], position[2]
    for k in range(steps.shape[0]):
        u, v, w = steps[k, 0], steps[k, 1], steps[k, 2]
        share = flight_share(geometry, x, y, z, x + longest * u, y + longest * v, z + longest * w)[0]
        length = int(share * longest + _SAME)
        while length > 0 and flight_share(geometry, x, y, z, x + length * u, y + length * v, z + length * w)[0] < 1.0:
            length -= 1
        out[k] = length


@njit(cache=True, error_model="numpy")
def _link(geometry: Geometry, places: FloatArray, shape: IntArray, free: BoolArray, linked: BoolArray) -> None:
    """Which neighbours (n, 26) of the `places` (n, 3), m, of a lattice of `shape` (3,) can be flown to."""
    for n in range(places.shape[0]):
        i, j, k = n // (shape[1] * shape[2]), n // shape[2] % shape[1], n % shape[2]
        for d in range(_STEPS.shape[0]):
            p, q, r = i + _STEPS[d, 0], j + _STEPS[d, 1], k + _STEPS[d, 2]
            if p < 0 or q < 0 or r < 0 or p >= shape[0] or q >= shape[1] or r >= shape[2]:
                continue
            m = (p * shape[1] + q) * shape[2] + r
            a, b = places[n], places[m]
            if free[n] and free[m]:
                linked[n, d] = flight_share(geometry, a[0], a[1], a[2], b[0], b[1], b[2])[0] >= 1.0


@njit(cache=True, error_model="numpy")
def _spread(places: FloatArray, shape: IntArray, linked: BoolArray, remaining: FloatArray) -> None:
    """Dijkstra: lower `remaining` (n,), m, infinite but at the places where it is known, to what links make of it."""
    queue = [(remaining[n], n) for n in range(remaining.size) if remaining[n] < np.inf]
    heapq.heapify(queue)
    while len(queue) > 0:
        so_far, n = heapq.heappop(queue)
        if so_far > remaining[n]:
            continue
        for d in range(_STEPS.shape[0]):
            if linked[n, d]:
                m = n + (_STEPS[d, 0] * shape[1] + _STEPS[d, 1]) * shape[2] + _STEPS[d, 2]
                length = so_far + np.sqrt(((places[m] - places[n]) ** 2).sum())
                if length < remaining[m]:
                    remaining[m] = length
                    heapq.heappush(queue, (length, m))


@dataclass(frozen=True, eq=False)
class _Lattice:
    """Places all over an arena, and which of their neighbours can be flown to."""

    places: FloatArray  # (n, 3) m
    shape: IntArray  # (3,)
    free: BoolArray  # (n,)
    linked: BoolArray  # (n, 26)

    def remaining(self, arena: Arena, goal: FloatArray) -> FloatArray:
        """The length of the way to `goal` (3,), m, from each place: (n,) m, infinite where there is none."""
        seen = self.free & arena.clear_from(goal, self.places)
        remaining = np.where(seen, np.linalg.norm(self.places - goal, axis=1), np.inf)
        _spread(self.places, self.shape, self.linked, remaining)
        return remaining


@functools.lru_cache(maxsize=4)
def _lattice(arena: Arena) -> _Lattice:
    size = np.array(arena.size)
    counts = np.maximum(1, np.round(size * (_N_PLACES / size.prod()) ** (1.0 / 3.0)).astype(np.int64))
    axes = [side * (np.arange(count) + 0.5) / count for side, count in zip(size, counts, strict=True)]
    places = np.ascontiguousarray(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3))
    free = arena.free(places)
    linked = np.zeros((len(places), len(_STEPS)), np.bool_)
    _link(arena.geometry, places, counts, free, linked)
    return _Lattice(places, counts, free, linked)


class Passage:
    """What one UAV knows of the obstacles around it."""

    __slots__ = ("_arena", "_goal", "_remaining")

    def __init__(self, briefing: Briefing) -> None:
        """For the arena of `briefing`."""
        self._arena = briefing.arena
        self._goal: FloatArray | None = None  # (3,) m, of the last route
        self._remaining: FloatArray = np.empty(0)  # (n,) m, from the lattice's places to it

    @property
    def obstructed(self) -> bool:
        """Whether there are any obstacles."""
        return self._arena.obstructed

    def reach(self, position: FloatArray, hop: float, longest: int = 1) -> IntArray:
        """How many hops of `hop` m (times 1, sqrt 2, sqrt 3) in a row, up to `longest`, no obstacle is in the way of.

        For each row of `HOP_DIRECTIONS`, and for staying: (27,). The arena's bounds are not looked at.
        """
        out = np.full(len(HOP_DIRECTIONS) + 1, longest, np.int64)
        if self.obstructed:
            _reach(self._arena.geometry, np.ascontiguousarray(position), hop * HOP_DIRECTIONS, longest, out[:-1])
        return out

    def free(self, places: FloatArray) -> BoolArray:
        """Which of `places` (n, 3), m, a UAV can be at: (n,)."""
        return self._arena.free(places)

    def clear(self, position: FloatArray, goal: FloatArray) -> bool:
        """Whether the straight way from `position` to `goal` (3,), m, is clear."""
        return self._arena.clear(position, goal)

    def towards(self, position: FloatArray, goal: FloatArray) -> FloatArray:
        """Where to fly straight to on the shortest way from `position` to `goal` (3,), m.

        That is `goal` itself (the same array) if nothing is in the way. A goal in or too near to an obstacle stands for
        the nearest free place of the lattice; where no way is found the UAV stays.
        """
        arena = self._arena
        if not arena.obstructed or arena.clear(position, goal):
            return goal
        lattice = _lattice(arena)
        if not lattice.free.any():
            return position.copy()
        end = goal
        if not arena.is_free(goal):
            distance = np.where(lattice.free, np.linalg.norm(lattice.places - goal, axis=1), np.inf)
            end = np.array(lattice.places[int(np.argmin(distance))])
            if arena.clear(position, end):
                return end
        if self._goal is None or not np.array_equal(self._goal, end):
            self._goal, self._remaining = end.copy(), lattice.remaining(arena, end)
        near = np.flatnonzero(lattice.free & np.isfinite(self._remaining))
        near = near[arena.clear_from(position, lattice.places[near])]
        if near.size == 0:
            return position.copy()
        length = np.linalg.norm(lattice.places[near] - position, axis=1) + self._remaining[near]
        shortest = near[length <= length.min() + _SAME]  # several on one line: the one that is nearest to the goal
        chosen: FloatArray = lattice.places[shortest[np.argmin(self._remaining[shortest])]].copy()
        return chosen
