"""One UAV's flight by chemotaxis: scan, recruited, search, and what takes it from one to the other.

    scan       --- a reading above the threshold ------------------------------> search
    scan       --- one that was heard from another UAV ------------------------> recruited
    recruited  --- a reading above the threshold, or arrived where it was -----> search
    search     --- no reading above the threshold for `lost_time` -------------> scan, where it was left

The paper has scan, and search for good; the rest is for teams, and for plumes that can be lost.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from baselines.chemotaxis.declaring import Declaring
from baselines.chemotaxis.gradient import Window
from baselines.chemotaxis.scan import Pattern, has_other_side, layer_heights, scan_round
from baselines.policy import Briefing
from baselines.steering import Direction, Steering
from osl_env.actions import Action, Hover, Setpoint, Waypoint
from osl_env.errors import InputError
from osl_env.observation import Observation
from osl_env.parameters import FloatArray

if TYPE_CHECKING:
    from baselines.chemotaxis.policy import Chemotaxis

Mode: TypeAlias = Literal["scan", "recruited", "search"]


class Scan:
    """The way points of one UAV's scan, round after round."""

    __slots__ = ("_next", "_round", "_rounds")

    def __init__(self, parameters: Chemotaxis, briefing: Briefing, steering: Steering) -> None:
        """Raises InputError for a layer outside the area."""
        p, b = parameters, briefing
        pattern = Pattern(p.scan_towards, p.lane_shift, p.turn_margin, p.first_side)
        patterns, along = [pattern], 0 if p.scan_towards.endswith("x") else 1
        if p.both_sides and has_other_side(float(b.start[along]), float(b.area[along]), pattern):
            patterns.append(pattern.reversed())
        heights = _heights(p, b)
        rounds = [scan_round(b.start, b.area, shape, heights, b.uav, b.n_uavs) for shape in patterns]
        self._rounds: list[list[Direction]] = [[(x, y, z) for x, y, z in steering.free(r).tolist()] for r in rounds]
        self._round, self._next = 0, 0

    @property
    def goal(self) -> Direction:
        """The way point that it is bound for, m."""
        return self._rounds[self._round][self._next]

    def advance(self) -> None:
        """Go on to the next way point."""
        self._next += 1
        if self._next == len(self._rounds[self._round]):
            self._round, self._next = (self._round + 1) % len(self._rounds), 0


def _heights(parameters: Chemotaxis, briefing: Briefing) -> FloatArray:
    """(layers,) m: the heights to scan. Raises InputError for one outside the area."""
    ceiling = float(briefing.area[2])
    if parameters.layer_heights is None:
        return layer_heights(float(briefing.start[2]), ceiling, parameters.layers)
    for k, height in enumerate(parameters.layer_heights):
        if not 0.0 <= height <= ceiling:
            raise InputError(
                f"policy {parameters.name}: layer_heights.{k} = {height:g}: must lie within the area's height, "
                f"0 to {ceiling:g} m"
            )
    return np.array(parameters.layer_heights)


class Pilot:
    """One UAV's state of an episode."""

    __slots__ = (
        "_by_legs",
        "_counts",
        "_detected",
        "_detour",
        "_held",
        "_parameters",
        "_previous",
        "_recruited_to",
        "_scan",
        "_scanning_since",
        "_steering",
        "_threshold",
        "_window",
        "declaring",
        "mode",
    )

    def __init__(self, parameters: Chemotaxis, briefing: Briefing) -> None:
        """Raises InputError for a layer outside the area."""
        p = self._parameters = parameters
        self.mode: Mode = "scan"
        self.declaring = Declaring(p, briefing)
        self._by_legs = briefing.action == "leg"
        self._counts = briefing.gas_sensor.reports == "hits"
        self._threshold = briefing.threshold if p.threshold is None else p.threshold
        self._steering = Steering(briefing, p.switching_radius, p.obstacle_margin)
        self._scan = Scan(p, briefing, self._steering)
        self._steering.aim(self._scan.goal)
        rng = np.random.default_rng(briefing.seed)
        self._window = Window(p.window, p.rank_rule, p.jitter, p.probe_spread, rng)
        x, y, z = np.asarray(briefing.start, dtype=np.float64).tolist()
        self._previous: Direction = (x, y, z)  # m, at the decision before
        self._scanning_since = -math.inf  # s: what others smelt before does not recruit
        self._recruited_to: Direction = self._previous  # m
        self._detected = 0.0  # s: of the last detection; of the arrival, where another UAV had one
        self._held: Direction | None = None  # m: where it stays to make sure
        self._detour = False  # the search is on its way around an obstacle

    def act(self, observation: Observation) -> Action:
        """The next target."""
        x, y, z = observation.position.tolist()
        position, time = (x, y, z), observation.time
        velocity = self._velocity(observation, position)
        c = self._concentration(observation)
        if c is not None:
            self.declaring.take(observation, position, c)
        self._change_mode(observation, position, velocity, c is not None and c > self._threshold)
        if c is not None and (self.mode == "search" or self._parameters.fill == "scan"):
            self._window.add(x, y, z, c)
        if self.mode == "search":
            target = self._search(position, velocity, time)
        else:
            target = self._steering.towards(position, time, self._parameters.scan_carrot)
        self._previous = position
        if not self._by_legs:
            return Setpoint(np.array(target))
        return Waypoint(np.array(target)) if target != position else Hover()

    def _velocity(self, observation: Observation, position: Direction) -> Direction:
        """v of eq 5, m/s; between legs, where it is zero, the last leg instead, m."""
        if self._by_legs:
            (x, y, z), (a, b, c) = position, self._previous
            return x - a, y - b, z - c
        u, v, w = observation.velocity.tolist()
        return u, v, w

    def _concentration(self, observation: Observation) -> float | None:
        """The last reading as a concentration, or as hits a second; None if there is none."""
        duration, reading = observation.sampling_time, observation.reading
        if duration <= 0.0 or not math.isfinite(reading):
            return None
        return reading / duration if self._counts else reading

    def _change_mode(self, observation: Observation, position: Direction, velocity: Direction, detects: bool) -> None:
        time, steering, p = observation.time, self._steering, self._parameters
        if detects:
            self._detected = time
        if self.mode == "search":
            if time - self._detected >= p.lost_time:
                self.mode, self._scanning_since = "scan", time
                steering.aim(self._scan.goal)
            return
        arrived = steering.reached(position)
        if detects or (arrived and self.mode == "recruited"):
            self.mode, self._detected, self._held, self._detour = "search", time, None, False
            if p.fill == "search":
                self._begin_window(velocity)
            else:
                self._window.head(*velocity)
            return
        place = self._heard(observation) if p.sharing and observation.neighbour_mask.size else None
        if place is not None:
            if self.mode == "scan" or math.dist(place, self._recruited_to) > p.switching_radius:
                steering.aim(place)
                self._recruited_to = place
            self.mode = "recruited"
        elif arrived:
            self._scan.advance()
            steering.aim(self._scan.goal)

    def _heard(self, observation: Observation) -> Direction | None:
        """Where the nearest UAV was that smells gas, m, by what it sent since this one began to scan."""
        table = (observation.neighbour_mask, observation.neighbour_reading, observation.neighbour_sampling_time)
        for k, (known, reading, duration) in enumerate(zip(*(column.tolist() for column in table), strict=True)):
            if not known or duration <= 0.0 or (reading / duration if self._counts else reading) <= self._threshold:
                continue
            if observation.time - observation.neighbour_age[k] > self._scanning_since:
                x, y, z = (observation.position + observation.neighbour_offset[k]).tolist()
                return x, y, z
        return None

    def _search(self, position: Direction, velocity: Direction, time: float) -> Direction:
        """Hold still to make sure of a source, go around an obstacle, or climb."""
        steering, carrot = self._steering, self._parameters.search_carrot
        if self.declaring.suspects:
            self._held = self._held or position
            return self._held
        self._held = None
        if not self._detour:
            target = self._climb(position, velocity)
            if not steering.blocked(position, target):
                return target
            self._detour = steering.aim_beyond(position, target)
            if not self._detour:
                return position
        if steering.reached(position):  # readings from the other side say nothing of this one
            self._detour = False
            self._begin_window(velocity)
        return steering.towards(position, time, carrot)

    def _begin_window(self, velocity: Direction) -> None:
        self._window.clear()
        self._window.head(*velocity)

    def _climb(self, position: Direction, velocity: Direction) -> Direction:
        """Eqs 5 and 8."""
        p, window = self._parameters, self._window
        if not window.full:
            longest = p.scan_carrot if p.drift == "clipped" else math.inf
            return self._steering.ahead(position, velocity, longest, p.bounds_margin)
        direction = window.direction()
        if direction is None:
            return position
        target = self._step(position, direction)
        if window.probing and math.dist(target, position) < p.search_carrot / 2.0:
            return self._step(position, window.turn_back())  # the bounds are in the way of the probe
        return target

    def _step(self, position: Direction, direction: Direction) -> Direction:
        p, (u, v, w) = self._parameters, direction
        reach = p.search_carrot
        return self._steering.ahead(position, (reach * u, reach * v, reach * w), math.inf, p.bounds_margin)
