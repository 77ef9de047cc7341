"""Spiral surge: find the plume on a wide spiral, surge upwind at a hit, and cast on a narrow spiral when it is lost.

A. T. Hayes, A. Martinoli, R. M. Goodman: Distributed odor source localization, IEEE Sensors Journal 2 (3), 2002; Swarm
robotic odor localization: off-line optimization and validation with real robots, Robotica 21 (4), 2003. Their names:

search:  plume finding on an outward spiral, `spiral_gap1` (SpiralGap1) between two arms.
surge:   a hit samples the wind, and the UAV goes `step_size` (StepSize) upwind. Another hit on the way begins the
         distance anew, but not the direction.
cast:    then an outward spiral of `spiral_gap2` (SpiralGap2) around the place where the surge ended, until a hit, or
         for `cast_time` (CastTime); then plume finding again.
source:  a surge from the head of a plume leads out of it, and the spiral leads back: `source_count` (SrcDecCount)
         differences one after the other, between where two surges last smelt something, of at most `source_distance`
         (SrcDecThresh) declare the source there. So does the rule of the other reactive searchers here
         (`baselines.nearby_declaration`).

The robots are independent. With `attraction`, after the simple signals of the papers' swarms, one that is finding the
plume and hears of another's hit goes there and casts.

Read differently: the paper's odour is a packet or none; here a reading above the sensor's threshold is a hit, each for
itself: the surge bridges the gaps. The wind is the mean of about `wind_time`. The paper's robots are on the ground. In
the air, our extension, the arms of a spiral lie above and below its centre in turn, by up to `climb` times the radius.
Arms outside the area are left out; a spiral that has left it for good begins anew where the UAV is. Against the upwind
bound a hit begins no surge: the spiral goes on until it leads away from there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pydantic import PrivateAttr

from baselines.driving import Driver, area_scale
from baselines.policy import Briefing, Command, Policy, register_policy
from baselines.reactive import Course, Heads, Path, SurgeParameters, Verdict
from osl_env.actions import Action
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity
from osl_env.radio import Message

_GAP1, _GAP2, _STEP, _LEG = 0.2, 0.1, 0.1, 0.1  # of the area's scale
_CAST_TURNS = 3.0  # of a cast without a `cast_time`
_PLACES = 3.0  # of a spiral, in the length of a gap
_SLOWEST = 0.1  # of the speed: a surge that gets on no faster runs out all the same


def spiral(centre: FloatArray, gap: float, turns: float, phase: float = 0.0, sense: float = 1.0) -> FloatArray:
    """An outward spiral of Archimedes around `centre` (3,), m: (n, 3) places, m, at equal lengths of `gap` / 3.

    Two arms are `gap`, m, apart. It leaves the centre at the angle `phase`, rad, and turns `turns` times, to the left
    for `sense` 1 and to the right for -1.
    """
    length = math.pi * gap * turns**2  # for large angles; an Archimedean spiral's length is gap angle^2 / (4 pi)
    along = np.arange(1, max(2, math.ceil(_PLACES * length / gap) + 1)) * gap / _PLACES
    angle = np.sqrt(4.0 * math.pi * along / gap)
    radius = gap * angle / (2.0 * math.pi)
    bearing = phase + sense * angle
    places: FloatArray = centre + np.stack([radius * np.cos(bearing), radius * np.sin(bearing), 0.0 * radius], axis=1)
    return places


class Robot:
    """One UAV's state of an episode."""

    __slots__ = (
        "_cast_ends", "_course", "_direction", "_driver", "_gap1", "_gap2", "_generator", "_heads", "_parameters",
        "_path", "_previous", "_reach", "_smelt", "_step", "_surge_left", "_threshold", "_time", "_verdict", "mode",
    )  # fmt: skip

    def __init__(self, parameters: SpiralSurge, briefing: Briefing) -> None:
        p, scale = parameters, area_scale(briefing)
        self._gap1 = _GAP1 * scale if p.spiral_gap1 is None else p.spiral_gap1
        self._gap2 = _GAP2 * scale if p.spiral_gap2 is None else p.spiral_gap2
        self._step = _STEP * scale if p.step_size is None else p.step_size
        self._parameters, self._threshold = p, briefing.threshold
        leg = _LEG * scale if p.leg_length is None else p.leg_length
        self._driver = Driver(briefing, leg, samples=p.samples)
        self._course, self._path = Course(briefing, p.wind_time), Path(briefing, self._driver, leg)
        self._verdict, self._heads = Verdict(p, briefing), Heads(p, briefing)
        self._generator = np.random.default_rng(briefing.seed)
        self._reach = float(np.linalg.norm(np.asarray(briefing.area)[:2]))  # m: no spiral need be wider
        self._previous, self._time = np.array(briefing.start, dtype=np.float64), 0.0
        self._direction = self._course.upwind  # of the surge
        self._surge_left = 0.0  # m
        self._cast_ends = math.inf  # s
        self._smelt = self._previous  # (3,) m: where it last smelt something
        self.mode = "search"
        self._begin_spiral(self._previous, self._gap1, math.ceil(self._reach / self._gap1))

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """The next movement."""
        u, detects = observation.position, observation.sampling_time > 0.0 and observation.reading > self._threshold
        self._course.take(observation, detects)
        self._verdict.take(observation)
        if self.mode == "surge":
            flown = math.dist(u, self._previous)
            self._surge_left -= max(flown, _SLOWEST * self._driver.speed * (observation.time - self._time))
        self._previous, self._time = u.copy(), observation.time
        if detects and not self._path.ends(u, self._course.upwind):
            self._hit(u)
        if self._verdict.suspects:
            return self._driver.drive(u, np.zeros(3))
        if self._parameters.attraction and self.mode == "search":
            self._join(u, inbox)
        return self._go_on(observation)

    @property
    def declared(self) -> FloatArray | None:
        """(3,) m: the source is here."""
        return self._verdict.declared if self._heads.declared is None else self._heads.declared

    def _hit(self, u: FloatArray) -> None:
        """Begin a surge, or its distance anew."""
        if self.mode != "surge":
            self.mode, self._direction = "surge", self._course.upwind
        self._surge_left, self._smelt = self._step, u.copy()

    def _join(self, u: FloatArray, inbox: Sequence[Message]) -> None:
        """Cast where the nearest of those that smell something is."""
        places = [message.position for message in inbox if message.reading > self._threshold]
        if places:
            self._cast(np.asarray(min(places, key=lambda place: math.dist(u, place))), self._time)

    def _go_on(self, observation: Observation) -> Action:
        u = observation.position
        if self.mode == "surge":
            if self._surge_left > 1e-9 and not self._path.ends(u, self._direction):
                return self._driver.towards(u, u + self._surge_left * self._direction)
            self._heads.add(self._smelt)
            self._cast(u, observation.time)
        action = self._path.follow(u)
        if action is None or (self.mode == "cast" and observation.time > self._cast_ends):
            self.mode = "search"
            self._begin_spiral(u, self._gap1, math.ceil(self._reach / self._gap1))
            action = self._path.follow(u)
        return self._driver.drive(u, np.zeros(3)) if action is None else action

    def _cast(self, centre: FloatArray, time: float) -> None:
        """A narrow spiral around `centre`: so many turns, or, with a `cast_time`, as many as it has time for."""
        cast_time = self._parameters.cast_time
        widest = math.ceil(self._reach / self._gap2)
        turns = _CAST_TURNS
        if cast_time is not None:
            turns = min(widest, math.sqrt(cast_time * self._driver.speed / (math.pi * self._gap2)) + 1.0)
        self.mode = "cast"
        self._cast_ends = math.inf if cast_time is None else time + cast_time
        self._begin_spiral(centre, self._gap2, turns)

    def _begin_spiral(self, centre: FloatArray, gap: float, turns: float) -> None:
        phase = self._generator.uniform(0.0, 2.0 * math.pi)
        sense = 1.0 if self._generator.random() < 0.5 else -1.0
        places = spiral(centre, gap, turns, phase, sense)
        radius = np.linalg.norm(places - centre, axis=1)
        places[:, 2] += self._parameters.climb * radius * np.sin(math.pi * radius / gap)
        self._path.begin(places)


@register_policy
class SpiralSurge(SurgeParameters, Policy):
    """Hayes, Martinoli and Goodman's spiral surge. A length of None is a share of the area's scale (`area_scale`)."""

    name: ClassVar[str] = "spiral-surge"
    summary: ClassVar[str] = "find the plume on a wide spiral, surge upwind at a hit, cast on a narrow spiral when lost"
    vehicle_commands: ClassVar[tuple[Command, ...]] = ("velocity", "setpoint", "leg")
    plume_quantities: ClassVar[tuple[str, ...]] = ("hit_rate", "concentration")

    spiral_gap1: float | None = quantity(None, "m", gt=0)  # between arms while finding the plume; None: 0.2
    spiral_gap2: float | None = quantity(None, "m", gt=0)  # between arms of a cast; None: 0.1
    step_size: float | None = quantity(None, "m", gt=0)  # of a surge after the last hit; None: 0.1
    cast_time: float | None = quantity(None, "s", gt=0)  # None: as long as three turns take
    attraction: bool = False  # go where another robot smells something
    wind_time: float = quantity(2.0, "s", ge=0)  # time constant of the wind's mean
    climb: float = quantity(0.5, "", ge=0)  # of a spiral's radius; without effect on the ground
    leg_length: float | None = quantity(None, "m", gt=0)  # where legs are flown; None: 0.1
    samples: int = quantity(2, "", ge=1)  # at the end of each leg

    _robot: Robot | None = PrivateAttr(default=None)

    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`."""
        self._robot = Robot(self, briefing)

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """The next movement; what is heard counts only with `attraction`."""
        if self._robot is None:
            raise RuntimeError("spiral-surge: reset(briefing) comes before the first decision")
        return self._robot.act(observation, inbox)

    def declaration(self) -> FloatArray | None:
        """(3,) m, once either rule holds."""
        return self._robot.declared if self._robot else None

    @property
    def mode(self) -> str:
        """search, surge or cast."""
        return self._robot.mode if self._robot else ""
