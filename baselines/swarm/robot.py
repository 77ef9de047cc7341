"""One robot of a swarm: what it remembers of an episode, and the lengths that it takes from its briefing."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from baselines.driving import Driver, area_scale, concentration
from baselines.nearby_declaration import NearbyRule
from baselines.policy import Briefing
from baselines.swarm.finding import Line
from osl_env.actions import Action, Velocity
from osl_env.observation import Observation
from osl_env.parameters import FloatArray

if TYPE_CHECKING:
    from baselines.swarm.policy import Searcher

_SHARE_OF_AREA = 0.25  # of the area's scale: the greatest delta_d by default
_SHARE_OF_HEARING = 0.25  # of delta_d: a leg
# delta_d, R1, R2, m: the paper's two settings
_SETTINGS = ((0.0, 1.0, 6.0), (0.0, 0.1, 2.2), (0.0, 0.5, 3.3))
_STILL: FloatArray = np.zeros(3)
_STILL.setflags(write=False)


def neighbour_distance(briefing: Briefing) -> float:
    """delta_d, m: the radio's radius, or a quarter of the area's scale if that is less or the radio is off."""
    share = _SHARE_OF_AREA * area_scale(briefing)
    return min(briefing.radio.radius, share) if briefing.radio.radius > 0.0 else share


def default_distances(hearing: float) -> tuple[float, float]:
    """R1 and R2, m, for `hearing` (delta_d), m: the paper's, linear between its settings, in proportion beyond."""
    known, *settings = _SETTINGS
    beyond = max(hearing / known[-1], 1.0)
    near, far = (float(np.interp(hearing, known, setting)) * beyond for setting in settings)
    return near, far


class Robot:
    """One robot's state of an episode."""

    __slots__ = (
        "_decision",
        "_filter_time",
        "_line",
        "_time",
        "concentration",
        "counts",
        "direct",
        "driver",
        "found",
        "hearing",
        "horizon",
        "largest",
        "law",
        "numbers",
        "planar",
        "rule",
        "speed",
        "threshold",
        "tracks",
        "uav",
    )

    def __init__(self, parameters: Searcher, briefing: Briefing) -> None:
        self.hearing = parameters.neighbour_distance or neighbour_distance(briefing)
        self.law = parameters.law(briefing, self.hearing)
        self.numbers = np.array(self.law, dtype=np.float64)
        self.uav, self.planar, self.speed = briefing.uav, briefing.planar, float(briefing.speed)
        sees = briefing.range_sensors.count > 0
        leg = parameters.leg_length or _SHARE_OF_HEARING * self.hearing
        self.driver = Driver(
            briefing, leg, avoids=not sees or briefing.action == "leg"
        )  # eq 8 does not see a leg ahead
        self.direct = briefing.action == "velocity" and (sees or not briefing.arena.obstructed)
        self.horizon = leg / self.speed if briefing.action == "leg" else briefing.decision_period  # s
        self.rule = NearbyRule(parameters, briefing) if briefing.declares else None
        self.threshold = briefing.threshold
        self.tracks, self.found = parameters.tracks, parameters.tracks and not parameters.searches
        self.concentration = self.largest = self.law.clean_air  # C_i and Cmax
        self.counts = briefing.gas_sensor.reports == "hits"  # whether readings are hits
        self._filter_time = parameters.mean_time
        self._line = Line(parameters, briefing, self.hearing)
        self._decision, self._time = -1, math.nan

    def take(self, seen: Observation) -> None:
        """Take note of an observation, once."""
        if seen.decision == self._decision:
            return
        first = self._decision < 0
        elapsed = seen.sampling_time if first else seen.time - self._time
        self._decision, self._time = seen.decision, seen.time
        if not (self.tracks and self.found):
            self._line.measure(seen.wind, elapsed)
        if seen.sampling_time > 0.0:
            sample = concentration(self.counts, seen.reading, seen.sampling_time)
            gain = -math.expm1(-elapsed / self._filter_time) if self._filter_time > 0.0 else 1.0
            self.concentration += gain * (sample - self.concentration)
            self.found = self.found or seen.reading > self.threshold
        if self.rule is not None:
            self.rule.take(seen)

    def wish(self, seen: Observation) -> tuple[float, float, float]:
        """m/s: towards its place in the line; zero while it follows the law."""
        if self.tracks and self.found:
            return 0.0, 0.0, 0.0
        x, y, z = self._line.place(seen.time + self.horizon)
        own_x, own_y, own_z = seen.position.tolist()
        return (x - own_x) / self.horizon, (y - own_y) / self.horizon, (z - own_z) / self.horizon

    def row(self) -> tuple[Any, ...]:
        """One row of ROBOT."""
        sent = float(np.float32(self.concentration))  # as the others know it: equal readings make no gradient
        return (self.uav, self.speed, self.hearing, sent, self.largest, self.planar, self.tracks, self.found)

    def action(self, seen: Observation, velocity: FloatArray) -> Action:
        """What flies `velocity` (3,) m/s; a robot that suspects the source here stays."""
        if self.rule is not None and self.rule.suspects:
            return self.driver.drive(seen.position, _STILL)
        return Velocity(velocity) if self.direct else self.driver.drive(seen.position, velocity)
