"""Ways that keep a distance from obstacles, for UAVs that cannot stop at once.

As `baselines.passage`, for obstacles that are larger by a margin. A UAV that has got nearer than that, and one that
finds no way so far from everything, takes the way that just clears the obstacles.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from baselines.passage import Passage
from baselines.policy import Briefing
from osl_env.arena import Arena
from osl_env.parameters import FloatArray

_STEPS = 100  # that are looked at beyond an obstacle


@functools.lru_cache(maxsize=8)
def _grown(arena: Arena, margin: float) -> Arena:
    """`arena` with obstacles that are larger by `margin` m."""
    content = {name: getattr(arena, name) for name in Arena.model_fields}
    return Arena.model_validate(content | {"clearance": arena.clearance + margin})


class Ways:
    """The ways of one UAV among obstacles."""

    __slots__ = ("_bare", "_bare_arena", "_size", "_wide", "_wide_arena")

    def __init__(self, briefing: Briefing, margin: float) -> None:
        """In the arena of `briefing`, `margin` m from its obstacles where that is possible."""
        self._size = np.asarray(briefing.area, dtype=np.float64)
        self._bare_arena, self._bare = briefing.arena, Passage(briefing)
        self._wide_arena = _grown(briefing.arena, margin)
        self._wide = Passage(dataclasses.replace(briefing, arena=self._wide_arena))

    def _arena(self, here: FloatArray) -> Arena:
        return self._wide_arena if self._wide_arena.is_free(here) else self._bare_arena

    def free(self, places: FloatArray) -> FloatArray:
        """Those of `places` (n, 3), m, that are far enough from all obstacles; all of them if none is."""
        free = self._wide.free(places)
        return places[free] if free.any() else places

    def clear(self, here: FloatArray, goal: FloatArray) -> bool:
        """Whether the straight way from `here` to `goal` (3,), m, is clear."""
        return self._arena(here).clear(here, goal)

    def towards(self, here: FloatArray, goal: FloatArray) -> FloatArray:
        """Where to fly straight to on the way from `here` to `goal` (3,), m; `here` where there is none."""
        if self._wide_arena.is_free(here):
            place = self._wide.towards(here, goal)
            if not np.array_equal(place, here):
                return place
        return self._bare.towards(here, goal)

    def beyond(self, here: FloatArray, offset: FloatArray) -> FloatArray | None:
        """The first place in the direction of `offset` (3,), m, in steps of it, that is free; None if none is."""
        steps = np.arange(1, _STEPS + 1)[:, None] * offset
        places = here + steps[((here + steps >= 0.0) & (here + steps <= self._size)).all(axis=1)]
        free = np.flatnonzero(self._wide.free(places))
        return places[free[0]] if free.size else None
