"""Biased random walk: straight runs, and turns that are small when it smells more than before, and large when not.

L. Marques, U. Nunes, A. T. de Almeida: Olfaction-based mobile robot navigation, Thin Solid Films 418, 2002, whose first
strategy is the chemotaxis of bacteria; R. A. Russell and others: A comparison of reactive robot chemotaxis algorithms,
Robotics and Autonomous Systems 45, 2003; after H. C. Berg, D. A. Brown: Chemotaxis in Escherichia coli analysed by
three-dimensional tracking, Nature 239, 1972: a cell runs longer on its way to more of what it likes, and tumbles when
there is less. It measures no wind.

At the end of a run the mean reading of the run is compared with that of the run before:
run:     more: a turn of up to `small_turn` to either side, then `long_run`.
tumble:  not more: a turn of up to `large_turn`, then `short_run`.
roam:    nothing above the sensor's threshold in both: a turn of up to `large_turn`, then `roaming_run`, which ends at
         the first detection; this counts as more.

Read differently: the robots compare single readings, of which most are zero in a plume of filaments: means over a run
bridge the gaps, with a time constant of a run's length / speed. Roaming is ours: in clean air short runs would not get
anywhere. `roaming_run` as long as `short_run` restores the robots' rule, which cannot tell clean air from a fall. A
turn into a wall or an obstacle is drawn again. In the air, our extension, a turn also changes the inclination: runs
climb or sink by at most `steepest`. It keeps no map, hears nobody, and declares by `baselines.nearby_declaration`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pydantic import PrivateAttr

from baselines.driving import Driver, area_scale, concentration
from baselines.nearby_declaration import NearbyParameters
from baselines.policy import Briefing, Command, Policy, register_policy
from baselines.reactive import Verdict, pace, wall_margin
from osl_env.actions import Action
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity
from osl_env.radio import Message

_LONG, _SHORT, _ROAMING = 0.05, 0.02, 0.25  # of the area's scale
_DRAWS = 20  # of a turn, until the run is clear
_PATIENCE = 3.0  # times the decisions that a run should take
_GRACE = 1.0  # s, beyond it: to turn round and to speed up


class Walk:
    """One UAV's state of an episode."""

    __slots__ = (
        "_amount", "_arena", "_counts", "_detected", "_detected_before", "_driver", "_duration", "_generator", "_goal",
        "_grace", "_heading", "_high", "_leg", "_low", "_mean", "_parameters", "_planar", "_reach", "_runs",
        "_steepest", "_threshold", "_tries", "mode", "verdict",
    )  # fmt: skip

    def __init__(self, parameters: BiasedRandomWalk, briefing: Briefing) -> None:
        p, scale = parameters, area_scale(briefing)
        self.verdict, self.mode = Verdict(p, briefing), "roam"
        self._parameters, self._planar, self._arena = p, briefing.planar, briefing.arena
        self._threshold, self._counts = briefing.threshold, briefing.gas_sensor.reports == "hits"
        given = {"run": p.long_run, "tumble": p.short_run, "roam": p.roaming_run}
        shares = {"run": _LONG, "tumble": _SHORT, "roam": _ROAMING}
        self._runs = {mode: shares[mode] * scale if length is None else length for mode, length in given.items()}  # m
        legs = briefing.action == "leg"
        self._driver = Driver(briefing, self._runs["run"], samples=p.samples)
        self._leg = self._runs["run"] if legs else briefing.speed * briefing.decision_period  # m in a decision
        self._grace = 2.0 if legs else _GRACE / briefing.decision_period  # decisions
        self._reach = 1e-6 * scale if legs else self._leg
        area = np.asarray(briefing.area, dtype=np.float64)
        self._low = wall_margin(briefing)
        self._high = area - self._low
        shape = math.atan2(float(area[2]), scale)
        self._steepest = 0.0 if self._planar else shape if p.steepest is None else p.steepest
        self._generator = np.random.default_rng(briefing.seed)
        self._heading = (float(self._generator.uniform(0.0, 2.0 * math.pi)), 0.0)  # rad: azimuth, inclination
        self._goal, self._tries = np.array(briefing.start, dtype=np.float64), 0.0  # m; decisions left of the run
        self._amount, self._duration = 0.0, 0.0  # of this run: concentration times s, s
        self._detected, self._detected_before = False, False  # in this run, in the one before
        self._mean = 0.0  # concentration of the run before

    def act(self, observation: Observation) -> Action:
        """On with the run, or the next one."""
        self.verdict.take(observation)
        detects = self._sniff(observation)
        u = observation.position
        if self.verdict.suspects:
            return self._driver.drive(u, np.zeros(3))
        self._tries -= 1.0
        if self._tries < 0.0 or math.dist(u, self._goal) <= self._reach or (detects and self.mode == "roam"):
            self._turn(u)
        return self._driver.towards(u, self._goal, pace(self._driver, math.dist(u, self._goal)))

    def _sniff(self, observation: Observation) -> bool:
        """Add the last reading to the run's; whether it is a detection."""
        seconds = observation.sampling_time
        if seconds <= 0.0:
            return False
        self._amount += seconds * concentration(self._counts, observation.reading, seconds)
        self._duration += seconds
        detects = observation.reading > self._threshold
        self._detected = self._detected or detects
        return detects

    def _turn(self, u: FloatArray) -> None:
        """Judge the run that ends at `u` (3,), m, and begin the next."""
        mean = self._amount / self._duration if self._duration > 0.0 else 0.0
        if not self._detected and not self._detected_before:
            self.mode = "roam"
        else:
            self.mode = "run" if mean > self._mean else "tumble"
        self._mean, self._amount, self._duration = mean, 0.0, 0.0
        self._detected_before, self._detected = self._detected, False
        small = self.mode == "run"
        for _ in range(_DRAWS):
            heading = self._drawn(small)
            goal = u + self._runs[self.mode] * direction(heading)
            if self._clear(u, goal):
                break
            small = False
        self._heading, self._goal = heading, np.clip(goal, self._low, self._high)
        if self._planar:
            self._goal[2] = u[2]
        self._tries = _PATIENCE * math.dist(u, self._goal) / self._leg + self._grace

    def _drawn(self, small: bool) -> tuple[float, float]:
        """A new heading, rad: a turn of up to `small_turn` from the present one, or of up to `large_turn`."""
        p, g = self._parameters, self._generator
        azimuth, inclination = self._heading
        turn, climb = g.uniform(-1.0, 1.0), g.uniform(-1.0, 1.0)
        if not small:
            return azimuth + turn * p.large_turn, climb * self._steepest
        inclination += climb * p.small_turn
        return azimuth + turn * p.small_turn, min(max(inclination, -self._steepest), self._steepest)

    def _clear(self, u: FloatArray, goal: FloatArray) -> bool:
        n = 2 if self._planar else 3
        inside = bool(np.all((goal >= self._low)[:n] & (goal <= self._high)[:n]))
        return inside and (not self._arena.obstructed or self._arena.clear(u, goal))


def direction(heading: tuple[float, float]) -> FloatArray:
    """(3,) of length 1: the direction of an azimuth and an inclination, rad."""
    azimuth, inclination = heading
    level = math.cos(inclination)
    return np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.sin(inclination)])


@register_policy
class BiasedRandomWalk(NearbyParameters, Policy):
    """Run and tumble like E. coli. A length of None is a share of the area's scale (`area_scale`)."""

    name: ClassVar[str] = "biased-random-walk"
    summary: ClassVar[str] = "run and tumble: small turns and long runs where it smells more than before"
    vehicle_commands: ClassVar[tuple[Command, ...]] = ("velocity", "setpoint", "leg")
    plume_quantities: ClassVar[tuple[str, ...]] = ("hit_rate", "concentration")

    long_run: float | None = quantity(None, "m", gt=0)  # None: 0.05
    short_run: float | None = quantity(None, "m", gt=0)  # None: 0.02
    roaming_run: float | None = quantity(None, "m", gt=0)  # in clean air; None: 0.25
    small_turn: float = quantity(math.radians(5.0), "rad", ge=0, le=math.pi)  # Russell and others
    large_turn: float = quantity(math.pi, "rad", ge=0, le=math.pi)  # Russell and others
    steepest: float | None = quantity(None, "rad", ge=0, le=math.pi / 2)  # None: atan(height / the area's scale)
    samples: int = quantity(2, "", ge=1)  # at the end of each leg, where legs are flown

    _walk: Walk | None = PrivateAttr(default=None)

    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`."""
        self._walk = Walk(self, briefing)

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """The next movement; nothing is heard."""
        if self._walk is None:
            raise RuntimeError("biased-random-walk: reset(briefing) comes before the first decision")
        return self._walk.act(observation)

    def declaration(self) -> FloatArray | None:
        """(3,) m, the UAV's own place, once the rule holds."""
        return self._walk.verdict.declared if self._walk else None

    @property
    def mode(self) -> str:
        """run, tumble or roam."""
        return self._walk.mode if self._walk else ""
