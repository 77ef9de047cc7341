"""From a wished velocity to what the vehicle takes: the same reactive search flies velocities, setpoints and legs.

Velocities are flown as they are, cut to the vehicle's speed; setpoints lie ahead in proportion. A leg goes
`leg_length` in the wished direction, less if the wished speed is below the vehicle's, and ends with samples. A robot
on the ground (`Briefing.planar`) moves in the plane. Nothing is flown out of the area. With `avoids`, a way that meets
an obstacle is turned aside in the plane to the nearest direction that does not: the team has the map
(`Briefing.arena`).
"""

from __future__ import annotations

import math

import numpy as np

from baselines.policy import Briefing
from osl_env.actions import Action, Hover, Setpoint, Velocity, Waypoint
from osl_env.parameters import FloatArray

_LONGEST_LEG = 0.25  # of the area's shorter horizontal side
_STILL = 1e-6  # m/s, or m: no movement
_SIGHT_TIME = 1.0  # s of flight that must be clear, at least, with velocities and setpoints
_TURNS = tuple(sign * math.radians(angle) for angle in (22.5, 45, 67.5, 90, 112.5, 135, 157.5, 180) for sign in (1, -1))


class Driver:
    """Turns one UAV's wished velocities into actions."""

    __slots__ = (
        "_action",
        "_area",
        "_arena",
        "_avoids",
        "_leg",
        "_lookahead",
        "_planar",
        "_samples",
        "_sight",
        "speed",
    )

    def __init__(self, briefing: Briefing, leg_length: float, *, samples: int = 1, avoids: bool = True) -> None:
        """`leg_length`, m, is flown where the vehicle takes legs only; at most a quarter of the shorter side."""
        self.speed = float(briefing.speed)  # m/s: the greatest
        self._action, self._planar = briefing.action, briefing.planar
        self._area = np.asarray(briefing.area, dtype=np.float64)
        self._arena, self._avoids = briefing.arena, avoids and briefing.arena.obstructed
        self._leg = min(leg_length, _LONGEST_LEG * float(self._area[:2].min()))
        self._samples = min(samples, briefing.max_samples)
        self._lookahead = briefing.lookahead if math.isfinite(briefing.lookahead) else self._leg
        self._sight = self.speed * max(_SIGHT_TIME, 2.0 * briefing.decision_period)

    def towards(self, position: FloatArray, goal: FloatArray, speed: float | None = None) -> Action:
        """Go to `goal` (3,) m, at the greatest speed by default; no farther than `goal` where a leg is flown."""
        way = np.asarray(goal, dtype=np.float64) - position
        distance = float(np.linalg.norm(way))
        if distance < _STILL:
            return self.drive(position, np.zeros(3))
        wished = self.speed if speed is None else speed
        if self._action == "leg":
            wished = min(wished, self.speed * distance / self._leg)
        return self.drive(position, way * (wished / distance))

    def drive(self, position: FloatArray, velocity: FloatArray) -> Action:
        """The action for a wished `velocity` (3,) m/s at `position` (3,) m."""
        wished = np.array(velocity, dtype=np.float64)
        if self._planar:
            wished[2] = 0.0
        size = float(np.linalg.norm(wished))
        if size > self.speed:
            wished *= self.speed / size
        if self._action == "leg":
            return self._fly_leg(position, wished)
        wished = self._clear(position, wished, self._sight / self.speed)
        if self._action == "velocity":
            return Velocity(wished)
        return Setpoint(np.clip(position + wished * (self._lookahead / self.speed), 0.0, self._area))

    def _fly_leg(self, position: FloatArray, wished: FloatArray) -> Action:
        wished = self._clear(position, wished, self._leg / self.speed)
        target = np.clip(position + wished * (self._leg / self.speed), 0.0, self._area)
        if float(np.linalg.norm(target - position)) < max(_STILL, 0.01 * self._leg):
            return Hover(self._samples)
        return Waypoint(target, self._samples)

    def _clear(self, position: FloatArray, wished: FloatArray, seconds: float) -> FloatArray:
        """`wished`, turned aside so far that `seconds` of it are clear; zero if nothing is."""
        if not self._avoids or not wished.any():
            return wished
        turned = wished
        for turn in (0.0, *_TURNS):
            if turn:
                cos, sin = math.cos(turn), math.sin(turn)
                x, y, z = wished.tolist()
                turned = np.array([cos * x - sin * y, sin * x + cos * y, z])
            if self._arena.clear(position, np.clip(position + seconds * turned, 0.0, self._area)):
                return turned
        return np.zeros(3)


def concentration(counts: bool, reading: float, sampling_time: float) -> float:
    """A reading as something that grows with the gas: itself, or, of a sensor that counts, hits per second."""
    if not counts:
        return reading
    return reading / sampling_time if sampling_time > 0.0 else 0.0


def area_scale(briefing: Briefing) -> float:
    """m: the side of a square as large as the area's floor. Lengths that a policy is not given are shares of it."""
    return math.sqrt(float(briefing.area[0] * briefing.area[1]))
