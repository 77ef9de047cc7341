"""Team infotaxis: our reference, an exact shared belief with legs chosen by expected information per second.

Each UAV keeps its own exact grid belief, fed with its readings and all that it hears. Nothing else is shared but, in
each frame's payload, the place where the sender means to sample (12 bytes). Every leg lasts `leg_time` (turn, flight,
and samples for the rest), so that nobody waits for anybody, whichever clock runs; a far goal takes several such legs.

1. Before the first detection: spread and dwell. UAVs stand across the wind, by rank, in units of the belief's standard
   deviation, `downwind` standard deviations from its mean down the wind. The rate integrated over a crosswind section
   hardly depends on the distance, so the share of time spent sampling matters more than the ground covered.
2. No detection for `patience`: search by information. Among places all over the volume, the one with the most
   information from sampling there until `horizon` is over, the way there included.
3. After a detection: among neighbours, the belief's own candidates (mean, mode, points at multiples of its spread, and
   downwind of them) and staying, over several numbers of samples k, the greatest

       ( h I(u, k) + E|u_now - s| - E|u - s| ) / ( turn + flight + k samples )

   h is `entropy_weight`, m per nat. The distance counts because the UAV has to go there in the end.

In 2 and 3 the belief is first conditioned on no hit where the others are about to sample, lest two measure the same.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pydantic import PrivateAttr

from baselines.belief.grid_information import discount, expected_distance
from baselines.belief.grid_searcher import GridParameters, GridSearcher
from baselines.passage import Passage
from baselines.policy import Belief, Briefing, Policy, register_policy
from osl_env.actions import HOP_DIRECTIONS, Action, Waypoint
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity
from osl_env.radio import Message

_HEAVY, _NEGLIGIBLE = 1.0 / 400.0, 1e-4  # see grid_information.compress
_DWELLS = (1, 2, 4, 8, 16, 32)  # samples that places are compared for while searching
_SAME = 1e-6  # m: no flight
_STRAIGHT = 1.0 - 1e-9  # cosine above which a leg needs no turn
_UNIT = HOP_DIRECTIONS / np.linalg.norm(HOP_DIRECTIONS, axis=1)[:, None]
_STALE = 30.0  # s: a UAV not heard for so long is out of contact
_CALM = 1e-3  # m/s: no wind
_GOAL = struct.Struct("<3f")
_LATTICE_SIZE = 100  # places inside the volume that the search by information compares, about


class TeamSearch:
    """One UAV's state of an episode."""

    __slots__ = (
        "_area",
        "_briefing",
        "_goals",
        "_heading",
        "_heard_at",
        "_lattice",
        "_own",
        "_parameters",
        "_passage",
        "_places",
        "_rethink",
        "_turn",
        "_wind",
        "bits",
        "goal",
        "last_detection",
        "searcher",
    )

    def __init__(self, parameters: TeamInfotaxis, briefing: Briefing) -> None:
        self._parameters, self._briefing = parameters, briefing
        self.searcher = GridSearcher(parameters, briefing)
        self._area = np.asarray(briefing.area, dtype=np.float64)
        self._own, self._turn = np.array(briefing.start, dtype=np.float64), briefing.turn_time
        self._wind = np.zeros(3)  # m/s, as last measured
        self._heading: FloatArray | None = None  # (3,) of the last leg
        self._goals: dict[int, FloatArray] = {}  # where the others heard mean to sample, (3,) m
        self._places: dict[int, FloatArray] = {}  # and where they were
        self._heard_at: dict[int, float] = {}  # s, mission clock
        self._rethink = -math.inf  # s: when the place to stand is chosen again
        self._passage = Passage(briefing)
        self._lattice = _lattice(self._area, parameters.lattice_spacing)
        self.last_detection = 0.0  # s; the beginning counts as one
        self.goal: FloatArray | None = None  # (3,) m
        self.bits = 0.0

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """Take in everything new, choose the goal and fly one leg towards it."""
        self._listen(observation, inbox)
        parameters, searcher = self._parameters, self.searcher
        silence = observation.time - self.last_detection
        lost = searcher.heard and silence > parameters.patience and searcher.spread > parameters.lost_spread
        if not searcher.heard and silence < parameters.patience:
            self._stand(observation.time)
        elif lost or not searcher.heard:
            self._explore(observation.time)
        else:
            self.goal = self._best_per_second()
            self._rethink = -math.inf
        return self._leg()

    def _listen(self, observation: Observation, inbox: Sequence[Message]) -> None:
        rows = self.searcher.take(observation, inbox)
        self.bits = self.searcher.processed_bits(0)
        if rows[:, 3].any():
            self.last_detection = observation.time
        self._own, self._wind = observation.position.copy(), observation.wind.copy()
        if self._parameters.sharing:
            for message in inbox:
                self._places[message.sender] = message.position.copy()
                told = len(message.payload) == _GOAL.size
                goal = np.array(_GOAL.unpack(message.payload)) if told else message.position.copy()
                self._goals[message.sender], self._heard_at[message.sender] = goal, message.time
            for sender in [sender for sender, time in self._heard_at.items() if observation.time - time > _STALE]:
                del self._places[sender], self._goals[sender], self._heard_at[sender]

    def _stand(self, now: float) -> None:
        """Phase 1: the UAV's place across the wind, kept for `stand_time` once reached."""
        if self.goal is not None and now < self._rethink:
            return
        mean, covariance = self.searcher.mean, self.searcher.covariance
        speed = math.hypot(self._wind[0], self._wind[1])
        along = np.array([self._wind[0], self._wind[1], 0.0]) / speed if speed > _CALM else np.zeros(3)
        crosswise = np.eye(3) - np.outer(along, along)
        variances, axes = np.linalg.eigh(crosswise @ covariance @ crosswise)
        axis = axes[:, -1] * (1.0 if axes[np.argmax(np.abs(axes[:, -1])), -1] > 0.0 else -1.0)
        rank, count = self._rank(axis)
        offset = self._parameters.stand_width * math.sqrt(max(variances[-1], 0.0)) * ((2 * rank + 1) / count - 1.0)
        back = self._parameters.downwind * math.sqrt(max(float(along @ covariance @ along), 0.0))
        self.goal = np.clip(mean + offset * axis + back * along, 0.0, self._area)
        flight = math.dist(self.goal, self._own) / self._briefing.speed
        self._rethink = now + flight + self._parameters.stand_time

    def _rank(self, axis: FloatArray) -> tuple[int, int]:
        """The UAV's rank along `axis` among those in radio contact, and their number (itself included)."""
        here = (float(self._own @ axis), self._briefing.uav)
        others = [(float(place @ axis), sender) for sender, place in self._places.items()]
        return sum(other < here for other in others), len(others) + 1

    def _points(self, ahead: float) -> FloatArray:
        """The belief, conditioned on the others' finding nothing at their goals in `ahead` s."""
        belief = self.searcher.belief
        points = belief.compressed(heavy=_HEAVY, negligible=_NEGLIGIBLE)
        if self._goals:
            goals = np.array([self._goals[sender] for sender in sorted(self._goals)])
            discount(points, goals, ahead, belief.models[0])
        return points

    def _travel(self, candidates: FloatArray) -> FloatArray:
        """Seconds of turn and flight to each of `candidates` (C, 3)."""
        offsets = candidates - self._own
        distances = np.sqrt((offsets * offsets).sum(axis=1))
        turns = np.zeros(len(candidates))
        if self._heading is not None:
            turns[(offsets @ self._heading < distances * _STRAIGHT) & (distances > _SAME)] = self._turn
        return np.asarray(turns + distances / self._briefing.speed)

    def _explore(self, now: float) -> None:
        """Phase 2: a goal, kept for `explore_time` once reached: chosen at each leg anew, all dodge each other."""
        if self.goal is None or now >= self._rethink:
            self.goal = self._most_informative()
            flight = math.dist(self.goal, self._own) / self._briefing.speed
            self._rethink = now + flight + self._parameters.explore_time

    def _most_informative(self) -> FloatArray:
        """The place with the most information when sampled for what the way there leaves of the horizon."""
        horizon, sample = self._parameters.horizon, self._briefing.hover_time
        neighbours = self._own + (self._parameters.leg_time - self._turn) * self._briefing.speed * _UNIT
        candidates = np.clip(np.concatenate([self._own[None], neighbours, self._lattice]), 0.0, self._area)
        candidates = candidates[self._passage.free(candidates)]
        travel = self._travel(candidates)
        information = self._information(candidates, _DWELLS, self._points(horizon))
        left = np.maximum(horizon - travel, sample) / sample
        knots = np.array(_DWELLS, dtype=np.float64)
        upper = np.clip(np.searchsorted(knots, left), 1, len(knots) - 1)
        share = np.minimum((left - knots[upper - 1]) / (knots[upper] - knots[upper - 1]), 1.0)
        rows = np.arange(len(left))
        value = information[rows, upper - 1] * (1.0 - share) + information[rows, upper] * share
        value *= np.minimum(1.0, horizon / (travel + sample))
        return np.array(candidates[int(np.argmax(value))])

    def _best_per_second(self) -> FloatArray:
        """Phase 3."""
        parameters, sample = self._parameters, self._briefing.hover_time
        candidates = self._candidates()
        points = self.searcher.belief.compressed(heavy=_HEAVY, negligible=_NEGLIGIBLE)
        distances = np.empty(len(candidates))
        expected_distance(points, candidates, distances)
        information = self._information(candidates, parameters.dwells, self._points(parameters.ahead))
        gain = parameters.entropy_weight * information + (distances[0] - distances)[:, None]
        seconds = self._travel(candidates)[:, None] + sample * np.array(parameters.dwells)
        return np.array(candidates[int(np.argmax(gain / seconds)) // len(parameters.dwells)])

    def _information(self, candidates: FloatArray, dwells: tuple[int, ...], points: FloatArray) -> FloatArray:
        self.bits = self.searcher.processed_bits(len(candidates))
        sampling = tuple(self._briefing.hover_time * dwell for dwell in dwells)
        return self.searcher.belief.information(candidates, sampling, points)

    def _candidates(self) -> FloatArray:
        """Staying first; then neighbours, the belief's own places, and places downwind of those."""
        searcher = self.searcher
        variances, axes = np.linalg.eigh(searcher.covariance)
        spreads = (axes * np.sqrt(np.maximum(variances, 0.0))).T  # (3, 3) rows: principal axes, one deviation long
        speed = math.hypot(self._wind[0], self._wind[1])
        along = np.array([self._wind[0], self._wind[1], 0.0]) / speed if speed > _CALM else np.zeros(3)
        parts = [self._own[None], *(self._own + length * _UNIT for length in self._parameters.hop_distances)]
        parts += [searcher.mean[None], searcher.belief.mode()[None]]
        parts += [searcher.mean + multiple * spreads for multiple in (-2.0, -1.0, 1.0, 2.0)]
        for back in self._parameters.downwind_distances:
            parts += [searcher.mean + back * along + multiple * spreads for multiple in (-1.0, 0.0, 1.0)]
        places = np.asarray(np.clip(np.concatenate(parts), 0.0, self._area))
        return places[self._passage.free(places)]

    def _leg(self) -> Action:
        """One leg of `leg_time` towards the goal: turn, fly, and sample in what is left of it."""
        goal, briefing = self._own if self.goal is None else self.goal, self._briefing
        goal = self._passage.towards(self._own, goal)
        sample, time = briefing.hover_time, self._parameters.leg_time
        offset = goal - self._own
        distance = float(np.linalg.norm(offset))
        if distance > _SAME:
            direction = offset / distance
            if self._heading is not None and float(direction @ self._heading) < _STRAIGHT:
                time -= self._turn
            self._heading = direction
            reach = max(time - sample, sample) * briefing.speed
            if reach < distance - 0.5 * briefing.speed * sample:
                return Waypoint(self._own + reach * direction, 1)
            time -= distance / briefing.speed
        samples = min(max(round(time / sample), 1), briefing.max_samples)
        return Waypoint(goal.copy(), samples)


def _lattice(area: FloatArray, spacing: float) -> FloatArray:
    """Places all over the volume, (n, 3) m: about `spacing` m apart, wider in a large volume, and along its sides."""
    step = max(spacing, float(np.prod(area) / _LATTICE_SIZE) ** (1.0 / 3.0))
    axes = []
    for length, sides in zip(area.tolist(), (True, True, False), strict=True):
        count = max(1, math.ceil(length / step))
        centres = length * (np.arange(count) + 0.5) / count
        axes.append(np.concatenate([[0.0], centres, [length]]) if sides else centres)
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


@register_policy
class TeamInfotaxis(GridParameters, Policy):
    """Our reference: exact shared belief, spread and dwell, then information per second."""

    name: ClassVar[str] = "team-infotaxis"
    summary: ClassVar[str] = "our reference: exact shared belief; spread and dwell, then information per second"

    leg_time: float = quantity(6.0, "s", gt=0)  # of every leg
    stand_width: float = quantity(1.5, "", ge=0)  # half width of the line of UAVs, in standard deviations of the belief
    downwind: float = quantity(0.75, "", ge=0)  # how far downwind of the mean it stands, in standard deviations
    stand_time: float = quantity(24.0, "s", ge=0)  # that a place is kept
    patience: float = quantity(100.0, "s", ge=0)  # without a detection, then search by information
    explore_time: float = quantity(12.0, "s", ge=0)  # that a goal of the search by information is kept
    lost_spread: float = quantity(8.0, "m", gt=0)  # above it, silence after a detection means that the trace is lost
    horizon: float = quantity(28.0, "s", gt=0)  # of the search by information
    lattice_spacing: float = quantity(15.0, "m", gt=0)  # of the places that it compares
    entropy_weight: float = quantity(50.0, "m", gt=0)  # h: metres of distance that a nat is worth
    ahead: float = quantity(8.0, "s", ge=0)  # how long the others are taken to sample at their goals after a detection
    dwells: tuple[int, ...] = (2, 4, 8)  # samples that are compared after a detection
    hop_distances: tuple[float, ...] = (3.0, 8.0)  # m, to the neighbours
    downwind_distances: tuple[float, ...] = (4.0, 10.0)  # m, downwind of the belief's own places

    _search: TeamSearch | None = PrivateAttr(default=None)

    def _state(self) -> TeamSearch:
        if self._search is None:
            raise RuntimeError("team-infotaxis: reset(briefing) comes before the first decision")
        return self._search

    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`. Raises InputError for a plume that gives no hits."""
        self._search = TeamSearch(self, briefing)

    def broadcast(self, observation: Observation) -> bytes | None:
        """The present goal: 3 single-precision numbers."""
        goal = self._state().goal
        return None if goal is None or not self.sharing else _GOAL.pack(*goal.tolist())

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """Update on everything new and fly a leg."""
        return self._state().act(observation, inbox)

    def belief(self) -> Belief | None:
        """The grid belief."""
        return self._state().searcher.as_belief()

    def declaration(self) -> FloatArray | None:
        """The belief's mean, (3,) m, once the rule holds."""
        return self._state().searcher.declared

    @property
    def computed_bits(self) -> float:
        """Bits of the cells gone through, for every reading and for every candidate."""
        return self._state().bits
