"""Lawnmower survey: boustrophedon lanes through the whole volume, divided among the UAVs, with stops to sample.

The longer horizontal side is cut into one strip for each UAV. In its strip a UAV flies lanes along the other side, at
levels of `lane_spacing` height, with a stop at every `stop_spacing`. A survey needs a map to end: the readings (shared
by radio) go into an exact grid posterior. When its spread is below the declaration's, the UAV flies to the estimate and
declares by the common rule; until then the path does not depend on the readings. A survey that ends without an estimate
is followed by one with half the spacing, through the box of two standard deviations about the posterior mean if
anything was detected, through the whole volume otherwise. Stops inside obstacles are left out; ways go around them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pydantic import PrivateAttr

from baselines.belief.grid_searcher import GridParameters, GridSearcher
from baselines.passage import Passage
from baselines.policy import Belief, Briefing, Policy, register_policy
from osl_env.actions import Action, Hover, Waypoint
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity
from osl_env.radio import Message

_FINEST = 1.0 / 8.0  # of the spacings: later surveys are no finer
_THERE = 0.5  # m: near enough to the estimate to hover
_SAME = 1e-6  # m: no flight


def centres(low: float, high: float, spacing: float) -> FloatArray:
    """The middles of the equal parts, no wider than `spacing`, of [low, high]."""
    count = max(1, math.ceil((high - low) / spacing - 1e-9))
    return np.asarray(low + (high - low) / count * (np.arange(count) + 0.5))


def survey(low: FloatArray, high: FloatArray, strip: int, n_strips: int, lane: float, stop: float) -> FloatArray:
    """The stops (n, 3), m, of strip `strip` of `n_strips` of the box from `low` to `high`, in flying order."""
    sides = high - low
    long, short = (0, 1) if sides[0] >= sides[1] else (1, 0)
    width = sides[long] / n_strips
    lanes = centres(low[long] + strip * width, low[long] + (strip + 1) * width, lane)
    levels = centres(low[2], high[2], lane)
    stops = centres(low[short], high[short], stop)
    points, lane_back, stop_back = [], False, False
    for level in levels:
        for across in lanes[::-1] if lane_back else lanes:
            for along in stops[::-1] if stop_back else stops:
                point = np.empty(3)
                point[long], point[short], point[2] = across, along, level
                points.append(point)
            stop_back = not stop_back
        lane_back = not lane_back
    return np.array(points)


class Survey:
    """One UAV's state of an episode."""

    __slots__ = ("_briefing", "_next", "_parameters", "_passage", "_round", "bits", "searcher", "stops")

    def __init__(self, parameters: Lawnmower, briefing: Briefing) -> None:
        self._parameters, self._briefing = parameters, briefing
        self.searcher = GridSearcher(parameters, briefing)
        self._round, self.bits = -1, 0.0
        self._passage = Passage(briefing)
        self._begin_round()

    def _begin_round(self) -> None:
        self._round += 1
        p, b = self._parameters, self._briefing
        finer = max(0.5**self._round, _FINEST)
        low, high = np.zeros(3), np.asarray(b.area, dtype=np.float64)
        if self.searcher.heard:
            reach = 2.0 * np.sqrt(np.diag(self.searcher.covariance))
            low, high = np.maximum(self.searcher.mean - reach, low), np.minimum(self.searcher.mean + reach, high)
        stops = survey(low, high, b.uav, b.n_uavs, finer * p.lane_spacing, finer * p.stop_spacing)
        free = self._passage.free(stops)
        self.stops = stops[free] if free.any() else stops
        self._next = 0

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """Fly to the estimate if there is one; else to the next stop."""
        searcher, samples = self.searcher, min(self._parameters.samples, self._briefing.max_samples)
        searcher.take(observation, inbox)
        self.bits = searcher.processed_bits(0)
        if searcher.heard and searcher.spread < self._parameters.declare_spread:
            if math.dist(searcher.mean, observation.position) < _THERE:
                return Hover(samples)
            return Waypoint(self._passage.towards(observation.position, searcher.mean).copy(), samples)
        if self._next == len(self.stops):
            self._begin_round()
        stop = self.stops[self._next]
        place = self._passage.towards(observation.position, stop)
        if place is stop or math.dist(place, observation.position) < _SAME:  # else it is on the way there
            self._next += 1
        return Waypoint(place, samples)


@register_policy
class Lawnmower(GridParameters, Policy):
    """Boustrophedon survey of the whole volume with an exact posterior for the declaration."""

    name: ClassVar[str] = "lawnmower"
    summary: ClassVar[str] = "boustrophedon survey, the volume divided among the UAVs"

    lane_spacing: float = quantity(15.0, "m", gt=0)  # between lanes, and between levels
    stop_spacing: float = quantity(15.0, "m", gt=0)  # between stops on a lane
    samples: int = quantity(2, "", ge=1)  # at each stop

    _survey: Survey | None = PrivateAttr(default=None)

    def _state(self) -> Survey:
        if self._survey is None:
            raise RuntimeError("lawnmower: reset(briefing) comes before the first decision")
        return self._survey

    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`. Raises InputError for a plume that gives no hits."""
        self._survey = Survey(self, briefing)

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """The next stop, or the estimate."""
        return self._state().act(observation, inbox)

    def belief(self) -> Belief | None:
        """The survey's posterior."""
        return self._state().searcher.as_belief()

    def declaration(self) -> FloatArray | None:
        """The posterior mean, (3,) m, once the rule holds."""
        return self._state().searcher.declared

    @property
    def computed_bits(self) -> float:
        """Bits of the cells gone through."""
        return self._state().bits
