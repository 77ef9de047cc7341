"""What carries a UAV to its goals: velocities, setpoints or legs, whichever the vehicle takes.

With velocities it flies at full speed, and slows down near a goal only if it does not head for it: goals are passed
through, not stopped at. Setpoints are ahead by the vehicle's lookahead. Ways keep clear of obstacles.
"""

from __future__ import annotations

import math

import numpy as np

from baselines.policy import Briefing
from baselines.steering import Direction, Steering
from osl_env.actions import Action, Hover, Setpoint, Velocity, Waypoint
from osl_env.observation import Observation
from osl_env.parameters import FloatArray

_AHEAD = 0.9  # cosine: a UAV that flies to its goal so straight need not slow down for it
_HERE = 1e-6  # m: no flight
_MARGIN, _OF_SIDE = 0.5, 0.1  # m, and share of a side at most: how far from the bounds goals of a body stay


class Flying:
    """The way of one UAV from goal to goal."""

    __slots__ = ("_action", "_briefing", "_goal", "_lookahead", "_radius", "_samples", "_speed", "_steering")

    def __init__(self, briefing: Briefing, arrival_radius: float, samples: int) -> None:
        """Goals count as reached within `arrival_radius`, m, and obstacles are passed so far away where there is room.

        Legs end with `samples` samples.
        """
        self._action, self._speed, self._briefing = briefing.action, briefing.speed, briefing
        self._lookahead = max(briefing.lookahead, _HERE)
        self._samples, self._radius = min(samples, briefing.max_samples), arrival_radius
        self._steering = Steering(briefing, arrival_radius, arrival_radius)
        self.aim((0.0, 0.0, 0.0))

    def aim(self, goal: Direction) -> None:
        """Be bound for `goal`, m, from now on. A body that steers to setpoints overshoots: off the bounds with it."""
        if self._action == "setpoint":
            x, y, z = (
                min(max(c, margin), side - margin)
                for c, side in zip(goal, self._briefing.area.tolist(), strict=True)
                for margin in (min(_MARGIN, _OF_SIDE * side),)
            )
            goal = (x, y, z)
        self._goal = goal
        self._steering.aim(goal)

    def arrived(self, position: Direction) -> bool:
        """Whether the UAV is at its goal, or will never be."""
        return self._steering.reached(position)

    def gave_up(self, position: Direction) -> bool:
        """Whether it has stopped short of the goal that it has arrived at."""
        return math.dist(position, self._goal) >= self._radius

    def target(self, observation: Observation, position: Direction) -> Direction:
        """Where to fly now on the way to the goal, m."""
        reach = self._lookahead if self._action == "setpoint" else math.inf
        return self._steering.towards(position, observation.time, reach)

    def duration(self, position: Direction, target: Direction) -> float:
        """s that the next decision lasts at least."""
        if self._action != "leg":
            return self._briefing.decision_period
        sampling = self._samples * self._briefing.hover_time
        return self._briefing.turn_time + math.dist(position, target) / self._speed + sampling

    def command(self, observation: Observation, position: Direction, target: Direction) -> Action:
        """The command that flies to `target`, m."""
        if self._action == "setpoint":
            return Setpoint(np.array(target))
        distance = math.dist(position, target)
        if self._action == "leg":
            return Waypoint(np.array(target), self._samples) if distance > _HERE else Hover(self._samples)
        return Velocity(self._velocity(observation, position, target, distance))

    def _velocity(
        self, observation: Observation, position: Direction, target: Direction, distance: float
    ) -> FloatArray:
        if distance <= _HERE:
            return np.zeros(3)
        offset = [b - a for a, b in zip(position, target, strict=True)]
        velocity = observation.velocity.tolist()
        along = sum(u * v for u, v in zip(offset, velocity, strict=True))
        straight = along >= _AHEAD * distance * math.hypot(*velocity)
        speed = self._speed if straight else self._speed * min(1.0, distance / self._lookahead)
        return np.array(offset) * (min(speed, distance / self._briefing.decision_period) / distance)
