"""Surge-cast in 3D: surge upwind after a hit, cast crosswind when the plume is lost (Lochmatter and Martinoli 2009).

search: sweep the volume crosswind, back and forth, a `sweep_spacing` further upwind at each turn, at a height of the
        UAV's own (the levels divide the volume's height among the team).
surge:  after a hit, upwind in legs of `surge_step`, until `lost_distance` has been flown without another.
cast:   around the place of the last hit, crosswind legs to both sides and up and down in turn, each round
        `surge_step` wider, until a hit (surge again) or a round wider than `cast_limit` (search again).

Hits are rare and come singly far from a source, so a leg ends with `samples` samples. Without wind there is no upwind:
the surge goes on in the direction of the flight that brought the hit. It keeps no map, hears nobody, and declares by
`baselines.nearby_declaration`. An obstacle ends a surge as the bounds do; other legs go around it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pydantic import PrivateAttr

from baselines.nearby_declaration import NearbyParameters, NearbyRule
from baselines.passage import Passage
from baselines.policy import Briefing, Policy, register_policy
from osl_env.actions import Action, Hover, Waypoint
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity
from osl_env.radio import Message

_CALM = 1e-3  # m/s: no wind
_SAME = 0.1  # m
_MOST_SKIPPED = 100  # stops
_UP = np.array([0.0, 0.0, 1.0])


class Tracker:
    """One UAV's state of an episode."""

    __slots__ = (
        "_along",
        "_area",
        "_bound_for",
        "_cast",
        "_centre",
        "_course",
        "_height",
        "_parameters",
        "_passage",
        "_previous",
        "_samples",
        "_side",
        "_since_hit",
        "_threshold",
        "rule",
    )

    def __init__(self, parameters: SurgeCast, briefing: Briefing) -> None:
        self.rule = NearbyRule(parameters, briefing)
        self._parameters = parameters
        self._area = np.asarray(briefing.area, dtype=np.float64)
        self._samples = min(parameters.samples, briefing.max_samples)
        self._height = float(self._area[2]) * (briefing.uav + 0.5) / briefing.n_uavs
        self._course = np.array([0.0, 1.0, 0.0])  # upwind, or the way flown when there is no wind
        self._previous = np.array(briefing.start, dtype=np.float64)
        self._since_hit = math.inf  # m flown since the last hit; infinite while searching
        self._cast = 0  # legs of the present cast
        self._centre = np.array(briefing.start, dtype=np.float64)  # where it was last smelt
        self._threshold = briefing.threshold
        self._side = 1.0 if briefing.uav % 2 == 0 else -1.0  # of the sweep
        self._along = math.nan  # m upwind along the sweep; not begun
        self._passage = Passage(briefing)
        self._bound_for: FloatArray | None = None  # (3,) m: a goal that it is going around an obstacle to

    def act(self, observation: Observation) -> Action:
        """The next leg."""
        self.rule.take(observation)
        u, wind = observation.position, observation.wind
        speed = math.hypot(wind[0], wind[1])
        if speed > _CALM:
            self._course = np.array([-wind[0] / speed, -wind[1] / speed, 0.0])
        elif observation.reading > self._threshold and (flown := math.dist(u[:2], self._previous[:2])) > _SAME:
            self._course = np.array([*(u[:2] - self._previous[:2]) / flown, 0.0])
        self._previous = u.copy()
        if observation.reading > self._threshold:
            self._since_hit, self._cast, self._along = 0.0, 0, math.nan
            self._centre, self._bound_for = u.copy(), None
        if self.rule.suspects:
            return Hover(1)
        if self._since_hit < self._parameters.lost_distance:
            target = self._inside(u + self._parameters.surge_step * self._course)
            if np.linalg.norm(target - u) > _SAME and self._passage.clear(u, target):
                self._since_hit += self._parameters.surge_step
                return Waypoint(target, self._samples)
            self._since_hit = self._parameters.lost_distance  # against the boundary or an obstacle
        goal = self._bound_for if self._bound_for is not None else self._lost(u)
        place = self._passage.towards(u, goal)
        there = place is goal or bool(np.linalg.norm(place - u) < _SAME)
        self._bound_for = None if there else goal
        return Waypoint(place, self._samples)

    def _inside(self, point: FloatArray) -> FloatArray:
        return np.clip(point, 0.0, self._area)

    def _lost(self, u: FloatArray) -> FloatArray:
        """Cast around the place of the last hit, or search."""
        if math.isfinite(self._since_hit):
            while self._cast // 4 * self._parameters.surge_step < self._parameters.cast_limit:
                target = self._inside(self._centre + self._cast_offset())
                self._cast += 1
                if np.linalg.norm(target - u) > _SAME and self._passage.free(target[None])[0]:
                    return target
            self._since_hit, self._along = math.inf, math.nan
        for _ in range(_MOST_SKIPPED):  # stops inside an obstacle are passed over
            u = self._sweep(u)
            if self._passage.free(u[None])[0]:
                break
        return u

    def _cast_offset(self) -> FloatArray:
        """Leg number `_cast` of the cast: left, right, up, down, each round a step wider."""
        across = np.array([-self._course[1], self._course[0], 0.0])
        direction = (across, -across, _UP, -_UP)[self._cast % 4]
        return direction * self._parameters.surge_step * (self._cast // 4 + 1)

    def _sweep(self, u: FloatArray) -> FloatArray:
        """The next stop of a crosswind sweep that climbs upwind, from the downwind end."""
        spacing = self._parameters.sweep_spacing
        across = np.array([-self._course[1], self._course[0], 0.0])
        middle = self._area / 2.0
        reach = float(np.abs(self._course) @ middle)
        width = float(np.abs(across) @ middle)
        if math.isnan(self._along):
            self._along = float(np.clip((u - middle) @ self._course, -reach, reach))
        here = float((u - middle) @ across)
        if here * self._side >= width - spacing / 2.0 or self._blocked(u, across * self._side):
            self._side = -self._side
            self._along += spacing
            if self._along > reach:
                self._along = -reach
        ahead = float(np.clip(here + self._side * spacing, -width, width))
        target = middle + self._along * self._course + ahead * across
        target[2] = self._height
        return self._inside(target)

    def _blocked(self, u: FloatArray, direction: FloatArray) -> bool:
        """Whether the boundary stops a flight from `u` in `direction` (an area is no circle: oblique winds)."""
        ahead = u + direction * self._parameters.sweep_spacing
        return float(np.linalg.norm(self._inside(ahead) - u)) < self._parameters.sweep_spacing / 2.0


@register_policy
class SurgeCast(NearbyParameters, Policy):
    """Surge upwind on a hit, cast crosswind when lost."""

    name: ClassVar[str] = "surge-cast"
    summary: ClassVar[str] = "surge upwind on a hit, cast crosswind and vertically when lost"
    plume_quantities: ClassVar[tuple[str, ...]] = ("hit_rate", "concentration")

    surge_step: float = quantity(3.0, "m", gt=0)
    lost_distance: float = quantity(6.0, "m", gt=0)
    cast_limit: float = quantity(9.0, "m", gt=0)
    sweep_spacing: float = quantity(8.0, "m", gt=0)
    samples: int = quantity(2, "", ge=1)  # at the end of each leg

    _tracker: Tracker | None = PrivateAttr(default=None)

    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`."""
        self._tracker = Tracker(self, briefing)

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """The next leg; nothing is heard."""
        if self._tracker is None:
            raise RuntimeError("surge-cast: reset(briefing) comes before the first decision")
        return self._tracker.act(observation)

    def declaration(self) -> FloatArray | None:
        """(3,) m, the UAV's own place, once the rule holds."""
        return self._tracker.rule.declared if self._tracker else None
