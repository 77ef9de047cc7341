"""Steering to a place by targets that are never farther ahead than a carrot, inside the area and around obstacles.

A target ahead by the carrot makes a position controller fly at a steady speed, about 1.5 times the carrot a second for
the paper's vehicle. A way point counts as reached within `switching_radius`, and also when the UAV has come no nearer
for `_PATIENCE` s (wind, an obstacle or a bound can keep it away for good): a flight never waits for what cannot be.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from baselines.policy import Briefing
from baselines.ways import Ways
from osl_env.parameters import FloatArray

Direction: TypeAlias = tuple[float, float, float]  # a place, m, or a direction: faster than small arrays

_PATIENCE = 5.0  # s without progress
_TRIES = 3  # decisions without progress, at least: a leg can take longer than the patience
_PROGRESS = 0.01  # m


class Steering:
    """One UAV's way to the place that it is bound for."""

    __slots__ = ("_best", "_goal", "_radius", "_since", "_size", "_stuck", "_tries", "_via", "_ways")

    def __init__(self, briefing: Briefing, switching_radius: float, obstacle_margin: float) -> None:
        self._size: list[float] = np.asarray(briefing.area, dtype=np.float64).tolist()
        self._ways = Ways(briefing, obstacle_margin) if briefing.arena.obstructed else None
        self._radius = switching_radius
        self.aim((0.0, 0.0, 0.0))

    def aim(self, goal: Direction) -> None:
        """Be bound for `goal`, m, from now on."""
        self._goal: Direction = goal
        self._aim_again()

    def _aim_again(self) -> None:
        self._via: FloatArray | None = None  # (3,) m: where it goes first, around an obstacle
        self._best, self._since, self._tries, self._stuck = math.inf, math.inf, 0, False

    def free(self, places: FloatArray) -> FloatArray:
        """Those of `places` (n, 3), m, that are not in an obstacle; all if there is none."""
        return places if self._ways is None else self._ways.free(places)

    def reached(self, position: Direction) -> bool:
        """Whether the UAV is at its goal, or will never be."""
        return self._stuck or math.dist(position, self._goal) < self._radius

    def towards(self, position: Direction, time: float, carrot: float) -> Direction:
        """The next target, m, at `time` s of the mission."""
        goal = self._goal if self._ways is None else self._around(self._ways, position)
        distance = math.dist(position, goal)
        if distance < self._best - _PROGRESS:
            self._best, self._since, self._tries = distance, time, 0
        else:
            self._tries += 1
            self._stuck = self._stuck or (self._tries >= _TRIES and time - self._since > _PATIENCE)
        return self.ahead(position, (goal[0] - position[0], goal[1] - position[1], goal[2] - position[2]), carrot)

    def _around(self, ways: Ways, position: Direction) -> Direction:
        """The goal, or the place to fly to first."""
        here, goal, via = np.array(position), np.array(self._goal), self._via
        if ways.clear(here, goal):
            if via is not None:
                self._aim_again()
            return self._goal
        if via is None or math.dist(position, via) < self._radius or not ways.clear(here, via):
            self._aim_again()
            via = self._via = ways.towards(here, goal)
            self._stuck = (
                math.dist(position, via) < self._radius
            )  # no way, or at what stands for a goal that is not free
        x, y, z = via.tolist()
        return x, y, z

    def ahead(self, position: Direction, offset: Direction, longest: float, margin: float = 0.0) -> Direction:
        """The place `offset` m from `position`, at most `longest` m, and at least `margin` m inside the area."""
        length = math.hypot(*offset)
        share = longest / length if length > longest else 1.0
        (x, y, z), (u, v, w), (a, b, c) = position, offset, self._size
        return (
            _between(x + share * u, a, margin),
            _between(y + share * v, b, margin),
            _between(z + share * w, c, margin),
        )

    def blocked(self, position: Direction, target: Direction) -> bool:
        """Whether an obstacle is in the straight way to `target`, m."""
        return self._ways is not None and not self._ways.clear(np.array(position), np.array(target))

    def aim_beyond(self, position: Direction, target: Direction) -> bool:
        """Be bound for the far side of what is in the way to `target`, m; False if there is none in the area."""
        here = np.array(position)
        place = None if self._ways is None else self._ways.beyond(here, np.array(target) - here)
        if place is None:
            return False
        x, y, z = place.tolist()
        self.aim((x, y, z))
        return True


def _between(coordinate: float, side: float, margin: float) -> float:
    """The coordinate held at `margin` m inside [0, `side`], or in the middle half of a side that is too short."""
    margin = min(margin, side / 4.0)
    return min(max(coordinate, margin), side - margin)
