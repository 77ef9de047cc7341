"""What reactive searchers share: the way upwind, a path of places to follow, and a verdict on the own place.

Upwind: the measured wind is averaged with a time constant; the course is against its horizontal part. Without wind
there is no upwind: then the course is the way that was flown into the last detection, as in `baselines.surge_cast`.

A path is a list of places. Those outside the area are left out, and those that cannot be seen past the obstacles are
passed over until one can, so that a spiral or a sweep around a box goes on behind it. A place that is not reached in
three times the time that it should take (and a little) is passed over as well.

The verdict is that of `baselines.nearby_declaration`.

Searchers that surge also judge by the heads of the plume, the places of the last detections of their surges: beyond the
source a surge finds nothing, and what follows leads back to where it was last smelt, time and again. After Hayes,
Martinoli and Goodman (Robotica 2003), whose robots declare after SrcDecCount small differences between hits one after
the other, and after W. Li, J. A. Farrell, S. Pang, R. M. Arrieta: Moth-inspired chemical plume tracing on an autonomous
underwater vehicle, IEEE Transactions on Robotics 22, 2006, who compare last detection points.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from baselines.driving import Driver, area_scale
from baselines.nearby_declaration import NearbyParameters, NearbyRule
from baselines.policy import Briefing
from osl_env.actions import Action
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity

_CALM = 1e-3  # m/s: no wind
_MARGIN = 0.02  # of the area's scale: places of a path keep this far from the walls
_NEAR = 0.01  # of the area's scale: a place of a path counts as reached
_TRAIL = 0.02  # of the area's scale: the way flown is taken over this length
_PATIENCE = 3.0  # times the time that a place should take to reach
_GRACE = 2.0  # s, beyond it: to turn round and to speed up
_BRAKING = 0.25  # s of flight at full speed that a place must be away from the walls, unless legs are flown
_DECELERATION = 2.0  # m/s^2, towards a place: a tilt of some 12 degrees
_HEAD = 0.05  # of the area's scale: heads are at one place
_OF_SUCCESS = 0.6  # of the success radius: heads farther apart would make a bold declaration


def wall_margin(briefing: Briefing) -> FloatArray:
    """(3,) m: how far from each of the bounds the places to go to must be."""
    braking = 0.0 if briefing.action == "leg" else _BRAKING * briefing.speed
    area = np.asarray(briefing.area, dtype=np.float64)
    return np.minimum(max(_MARGIN * area_scale(briefing), braking), 0.1 * area)


def pace(driver: Driver, distance: float) -> float:
    """m/s: how fast to go to a place `distance`, m, away: so that it could stop there.

    A quadrotor that goes through the turns of a winding path at full speed tilts so far that it sinks.
    """
    return min(driver.speed, math.sqrt(2.0 * _DECELERATION * distance))


class SurgeParameters(NearbyParameters):
    """Thresholds of the declaration by heads; mixed into the parameters of policies that surge."""

    source_count: int = quantity(3, "", ge=0)  # SrcDecCount; 0: not by heads
    source_distance: float | None = quantity(None, "m", gt=0)  # SrcDecThresh; None: 0.05 of the area's scale, or less


class Course:
    """One UAV's way upwind."""

    __slots__ = ("_passed", "_span", "_time", "_wind", "_wind_time", "flown", "upwind")

    def __init__(self, briefing: Briefing, wind_time: float) -> None:
        """`wind_time`, s: the time constant of the wind's mean."""
        self._wind_time, self._span = wind_time, _TRAIL * area_scale(briefing)
        self._wind: FloatArray | None = None  # (3,) m/s
        self._time = 0.0  # s
        self._passed = np.array(briefing.start, dtype=np.float64)  # m: a place that it came through lately
        self.flown = np.zeros(3)  # (3,) the horizontal direction in which it came; zero before it has moved
        self.upwind = np.array([0.0, 1.0, 0.0])  # (3,) horizontal, of length 1

    def take(self, observation: Observation, detects: bool) -> None:
        """Take note of the wind and of the way flown; `detects`: the reading is above the threshold."""
        if self._wind is None:
            self._wind = np.array(observation.wind)
        else:
            passed = observation.time - self._time
            share = 1.0 if self._wind_time <= 0.0 else 1.0 - math.exp(-passed / self._wind_time)
            self._wind += share * (observation.wind - self._wind)
        self._time = observation.time
        way = (observation.position - self._passed)[:2]
        length = math.hypot(way[0], way[1])
        if length > self._span:
            self.flown = np.array([way[0] / length, way[1] / length, 0.0])
            self._passed = observation.position.copy()
        speed = math.hypot(self._wind[0], self._wind[1])
        if speed > _CALM:
            self.upwind = np.array([-self._wind[0] / speed, -self._wind[1] / speed, 0.0])
        elif detects and self.flown.any():
            self.upwind = self.flown

    @property
    def across(self) -> FloatArray:
        """(3,) horizontal, of length 1: to the left of the way upwind."""
        return np.array([-self.upwind[1], self.upwind[0], 0.0])


class Path:
    """Places to go through, one after the other."""

    __slots__ = (
        "_arena", "_driver", "_goal", "_grace", "_high", "_leg", "_low", "_next", "_places", "_planar", "_reach",
        "_tries",
    )  # fmt: skip

    def __init__(self, briefing: Briefing, driver: Driver, leg_length: float) -> None:
        """`leg_length`, m, is what `driver` flies at once where legs are flown."""
        area = np.asarray(briefing.area, dtype=np.float64)
        scale = area_scale(briefing)
        self._low = wall_margin(briefing)
        self._high = area - self._low
        self._arena, self._driver, self._planar = briefing.arena, driver, briefing.planar
        legs = briefing.action == "leg"
        self._leg = leg_length if legs else driver.speed * briefing.decision_period  # m in a decision
        self._grace = 2.0 if legs else _GRACE / briefing.decision_period  # decisions
        self._reach = max(_NEAR * scale, 0.0 if legs else 2.0 * self._leg)
        self.begin(np.zeros((0, 3)))

    def begin(self, places: FloatArray) -> None:
        """Go through `places` (n, 3), m, from now on; those outside the area are left out, heights are cut."""
        kept = np.array(places, dtype=np.float64)
        kept[:, 2] = np.clip(kept[:, 2], self._low[2], self._high[2])
        self._places: FloatArray = kept[np.all((kept >= self._low) & (kept <= self._high), axis=1)]
        self._next = 0
        self._goal: FloatArray | None = None
        self._tries = 0.0  # decisions until the goal is passed over

    def follow(self, position: FloatArray) -> Action | None:
        """On from `position` (3,), m, to the next place; None when none is left."""
        goal = self._goal
        self._tries -= 1.0
        while goal is None or self._tries < 0.0 or self._distance(position, goal) <= self._reach:
            goal = self._goal = self._following(position)
            if goal is None:
                return None
            self._tries = _PATIENCE * self._distance(position, goal) / self._leg + self._grace
        speed = pace(self._driver, self._distance(position, goal))
        return self._driver.towards(position, np.array([*goal[:2], position[2]]) if self._planar else goal, speed)

    def _following(self, position: FloatArray) -> FloatArray | None:
        """The next place in sight, if any is left."""
        while self._next < len(self._places):
            goal: FloatArray = self._places[self._next].copy()
            self._next += 1
            if self._planar:
                goal[2] = position[2]
            if not self._arena.obstructed or self._arena.clear(position, goal):
                return goal
        return None

    def _distance(self, position: FloatArray, goal: FloatArray) -> float:
        way = goal - position
        return float(np.linalg.norm(way[:2] if self._planar else way))

    def ends(self, position: FloatArray, direction: FloatArray) -> bool:
        """Whether the bounds stop a flight from `position` in `direction` (3,), of length 1."""
        ahead = float(self._low[:2].min())
        free = np.clip(position + ahead * direction, 0.0, self._high + self._low) - position
        return float(free @ direction) < ahead / 2.0


class Verdict:
    """The judgement of one UAV on its own place, where a source has to be declared; else none."""

    __slots__ = ("_rule",)

    def __init__(self, parameters: NearbyParameters, briefing: Briefing) -> None:
        self._rule = NearbyRule(parameters, briefing) if briefing.declares else None

    def take(self, observation: Observation) -> None:
        """Take note of the last sample."""
        if self._rule is not None:
            self._rule.take(observation)

    @property
    def suspects(self) -> bool:
        """It smells here as beside a source, but for too short a time yet: stay and sample."""
        return self._rule is not None and self._rule.suspects

    @property
    def declared(self) -> FloatArray | None:
        """(3,) m: the source is here."""
        return self._rule.declared if self._rule is not None else None


class Heads:
    """The judgement by the heads of the plume, of one UAV, where a source has to be declared; else none."""

    __slots__ = ("_count", "_distance", "_needed", "_previous", "declared")

    def __init__(self, parameters: SurgeParameters, briefing: Briefing) -> None:
        share = min(_HEAD * area_scale(briefing), _OF_SUCCESS * briefing.success_radius)
        self._distance = share if parameters.source_distance is None else parameters.source_distance  # m
        self._needed = parameters.source_count if briefing.declares else 0
        self._count = 0  # of differences one after the other that are small
        self._previous: FloatArray | None = None  # (3,) m
        self.declared: FloatArray | None = None  # (3,) m: the source is here

    def add(self, head: FloatArray) -> None:
        """A surge is over; `head` (3,), m, is where it last smelt something."""
        near = self._previous is not None and float(np.linalg.norm(head - self._previous)) <= self._distance
        self._count = self._count + 1 if near else 0
        self._previous = head.copy()
        if 0 < self._needed <= self._count:
            self.declared = self._previous


def pieces(corners: FloatArray, length: float) -> FloatArray:
    """A path along the straight lines between `corners` (n, 3), m: (m, 3), the first corner left out.

    No place is farther than `length`, m, from the next.
    """
    parts = [np.zeros((0, 3))]
    for begin, end in itertools.pairwise(corners):
        count = max(1, math.ceil(float(np.linalg.norm(end - begin)) / length - 1e-9))
        parts.append(begin + (end - begin) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(parts)
