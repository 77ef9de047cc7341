"""Boustrophedon flight over a volume: parallel lanes, back and forth, level by level, that fits the time there is.

Lanes lie along the longer horizontal side, in rows across it and in levels above each other, at the same spacing both
ways: the narrowest with which the whole flight fits into `survey_share` of the UAV's time, and no narrower than a cell
of the gas map; or `lane_spacing`. The flight begins at the corner nearest to the UAV's start. Several UAVs divide the
volume: it is cut across its longer horizontal side into one equal part for each, in the order of their numbers. Where a
flight is over before the time is, the UAV flies the same way back.

A lane is flown over in goals that are at most `goal_distance` apart; at the ends of legs, where UAVs that fly legs
sample, at most a lane spacing. Goals in obstacles are left out.
"""

from __future__ import annotations

import math

import numpy as np

from baselines.passage import Passage
from baselines.policy import Briefing
from osl_env.errors import InputError
from osl_env.parameters import FloatArray, Parameters, quantity

_WIDER = 1.02  # from one spacing that is tried to the next
_SAME = 1e-9  # of a number of lanes
_MOST_GOALS = 1_000_000


class SurveyParameters(Parameters):
    """Parameters of the survey; mixed into the parameters of the policy."""

    lane_spacing: float | None = quantity(None, "m", gt=0)  # in any volume; None: what fits the time
    survey_share: float = quantity(0.9, "", gt=0, le=1)  # of the time; the rest is for turns and detours
    goal_distance: float = quantity(1.0, "m", gt=0)  # along a lane, in the paper's volume


def parts(length: float, spacing: float) -> int:
    """How many equal parts, none longer than `spacing`, `length` has, both m."""
    return max(1, math.ceil(length / spacing - _SAME))


def goals(low: FloatArray, high: FloatArray, start: FloatArray, spacing: float, stop: float) -> FloatArray:
    """The goals (n, 3), m, in flying order, of lanes at most `spacing` m apart in the box from `low` to `high` (3,).

    The first is near the corner that is nearest to `start` (3,). Goals on a lane are at most `stop` m apart.
    """
    sides = high - low
    along, across = (0, 1) if sides[0] >= sides[1] else (1, 0)
    inset = 0.5 * min(spacing, sides[along])
    count = parts(sides[along] - 2.0 * inset, stop) + 1 if sides[along] > 2.0 * inset else 1
    ways = np.linspace(low[along] + inset, high[along] - inset, count)
    rows, levels = (_middles(low[axis], high[axis], spacing) for axis in (across, 2))
    lanes = [(row, level) for k, level in enumerate(levels) for row in (rows if k % 2 == 0 else rows[::-1])]
    places = np.empty((len(lanes), count, 3))
    for k, (row, level) in enumerate(lanes):
        places[k, :, along] = ways if k % 2 == 0 else ways[::-1]
        places[k, :, across], places[k, :, 2] = row, level
    flat = places.reshape(-1, 3)
    return np.asarray(np.where(start > 0.5 * (low + high), low + high - flat, flat))


def _middles(low: float, high: float, spacing: float) -> FloatArray:
    """The middles of the equal parts, no wider than `spacing`, from `low` to `high`, m."""
    count = parts(high - low, spacing)
    return np.asarray(low + (high - low) / count * (np.arange(count) + 0.5))


def share_of(briefing: Briefing) -> tuple[FloatArray, FloatArray]:
    """The corners (3,), m, of the part of the area that the UAV of `briefing` surveys."""
    low, high = np.zeros(3), np.array(briefing.area, dtype=np.float64)
    along = 0 if high[0] >= high[1] else 1
    width = high[along] / briefing.n_uavs
    low[along], high[along] = briefing.uav * width, (briefing.uav + 1) * width
    return low, high


class Survey:
    """The goals of one UAV, one after another, there and back."""

    __slots__ = ("_back", "_next", "goals", "spacing")

    def __init__(
        self, parameters: SurveyParameters, briefing: Briefing, cell: FloatArray, scale: float, samples: int
    ) -> None:
        """For a map with cells of the sides `cell` (3,), m; lengths for the paper's volume are multiplied by `scale`.

        Legs end with `samples` samples. Raises InputError for spacings that make more than a million goals.
        """
        low, high = share_of(briefing)
        start, longest = np.asarray(briefing.start, dtype=np.float64), scale * parameters.goal_distance
        self.spacing = parameters.lane_spacing or self._fitting(parameters, briefing, float(cell.min()), samples)
        stop = self.spacing if briefing.action == "leg" else longest
        x, y, z = (high - low).tolist()
        if parts(min(x, y), self.spacing) * parts(z, self.spacing) * parts(max(x, y), stop) > _MOST_GOALS:
            raise InputError(
                f"survey: lane_spacing = {self.spacing:g} m, goals {stop:g} m apart: "
                f"must be at most {_MOST_GOALS} goals"
            )
        places = goals(low, high, start, self.spacing, stop)
        free = Passage(briefing).free(places)
        self.goals = places[free] if free.any() else places  # (n, 3) m
        self._next, self._back = 0, False

    @staticmethod
    def _fitting(parameters: SurveyParameters, briefing: Briefing, finest: float, samples: int) -> float:
        """The narrowest spacing, m, from `finest` on, with which the flight fits into the UAV's time."""
        low, high = share_of(briefing)
        legs = briefing.action == "leg"
        corner = np.clip(briefing.start, low, high)
        there = math.dist(briefing.start, np.where(corner > 0.5 * (low + high), high, low)) / briefing.speed
        time = (
            briefing.time_limit if legs else min(briefing.time_limit, briefing.max_decisions * briefing.decision_period)
        )
        time = parameters.survey_share * time - there
        pause = briefing.turn_time + min(samples, briefing.max_samples) * briefing.hover_time if legs else 0.0
        sides = high - low
        length, width = max(sides[0], sides[1]), min(sides[0], sides[1])
        spacing = finest
        while spacing < max(width, sides[2]):
            rows, levels = parts(width, spacing), parts(sides[2], spacing)
            lane = max(length - spacing, 0.0)
            stops = rows * levels * (parts(lane, spacing) + 1) if legs else 0
            way = rows * levels * lane + (rows - 1) * levels * width / rows + (levels - 1) * sides[2] / levels
            if way / briefing.speed + stops * pause <= time and stops <= briefing.max_decisions:
                break
            spacing *= _WIDER
        return spacing

    def next_goal(self) -> FloatArray:
        """The next goal, (3,) m."""
        goal = self.goals[self._next]
        if self._next == (0 if self._back else len(self.goals) - 1):
            self._back = not self._back
        self._next = min(max(self._next + (-1 if self._back else 1), 0), len(self.goals) - 1)
        return np.asarray(goal)
