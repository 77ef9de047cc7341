"""Moth: surge upwind at the smell, then a programme of zigzags that grow, then loops (the silkworm moth, Bombyx mori).

R. Kanzaki, N. Sugi, T. Shibuya: Self-generated zigzag turning of Bombyx mori males during pheromone-mediated upwind
walking, Zoological Science 9, 1992: every stimulus begins a fixed programme anew: a straight surge, turns from side to
side, ever wider, then loops. H. Ishida, K. Hayashi, M. Takakusaki, T. Nakamoto, T. Moriizumi, R. Kanzaki: Odour-source
localization system mimicking behaviour of silkworm moth, Sensors and Actuators A 51, 1996, and L. Marques, U. Nunes,
A. T. de Almeida: Olfaction-based mobile robot navigation, Thin Solid Films 418, 2002, flew it with robots; W. Li,
J. A. Farrell, R. T. Carde: Tracking of fluid-advected odor plumes, Adaptive Behavior 9, 2001, compare counterturning
with a surge that goes on passively.

surge:   upwind until `surge_length` after the last detection.
zigzag:  `zigzag_turns` legs at `zigzag_angle` to the way upwind, from side to side of the line on which the plume was
         lost; the first reaches `zigzag_length` to the side, each `growth` times farther than the one before.
loop:    `loops` circles through the same place, to either side in turn, the first of `loop_radius`, growing alike.
search:  then, and before anything has been smelt, crosswind sweeps over the whole area, each `sweep_spacing` farther
         upwind, and from the downwind end again.

The first turn is to the side where the plume must be: a moth turns to the antenna that is stimulated; with one sensor,
it is the side to which the UAV was moving when it came into the plume, which it remembers.

`surge-cast` (Lochmatter and Martinoli) casts around the place of the last hit, to fixed sides, until one comes. Here
the programme runs on its own counter from wherever the surge ended, goes on upwind while it turns, and loops.

Read differently: lengths, not seconds, set the programme (the moth's are at its own speed). In the air, our extension,
two turns or loops above the line follow two below, by `climb` times their reach; sweeps change their height. Against
the upwind bound a detection begins no surge: the programme goes on until it leads away from there.
It keeps no map, hears nobody, and declares by `baselines.nearby_declaration`, or where its surges end time and again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pydantic import PrivateAttr

from baselines.driving import Driver, area_scale
from baselines.policy import Briefing, Command, Policy, register_policy
from baselines.reactive import Course, Heads, Path, SurgeParameters, Verdict, pieces
from osl_env.actions import Action
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity
from osl_env.radio import Message

_SURGE, _ZIGZAG, _LOOP, _SPACING, _LEG = 0.1, 0.06, 0.06, 0.15, 0.1  # of the area's scale
_CORNERS = 12  # of a loop
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_SLOWEST = 0.1  # of the speed: a surge that gets on no faster runs out all the same


def zigzag(
    length: float, growth: float, turns: int, angle: float, climb: float, upwind: FloatArray, across: FloatArray
) -> FloatArray:
    """Corners of a zigzag from the origin: (turns + 1, 3), m.

    Corner k is `length` growth^(k - 1) to the side `across` (3,) if k is odd, to the other if even, and its legs are at
    `angle`, rad, to `upwind` (3,).
    """
    offset, forward, corners = 0.0, 0.0, [np.zeros(3)]
    for k in range(turns):
        reach = length * growth**k
        aside = reach if k % 2 == 0 else -reach
        forward += abs(aside - offset) / math.tan(angle)
        offset = aside
        height = climb * reach * (1.0 if k % 4 < 2 else -1.0)
        corners.append(forward * upwind + offset * across + np.array([0.0, 0.0, height]))
    return np.array(corners)


def circles(
    radius: float, growth: float, number: int, climb: float, upwind: FloatArray, across: FloatArray
) -> FloatArray:
    """Corners of circles that all begin and end at the origin, to the side `across` (3,) and the other in turn.

    Circle k has the radius `radius` growth^k, m, and sets out along `upwind` (3,): (number * 12 + 1, 3), m.
    """
    corners = [np.zeros((1, 3))]
    angle = 2.0 * math.pi * np.arange(1, _CORNERS + 1)[:, None] / _CORNERS
    for k in range(number):
        size = radius * growth**k
        side = across if k % 2 == 0 else -across
        lift = np.array([0.0, 0.0, climb * (1.0 if k % 4 < 2 else -1.0)])
        corners.append(size * (np.sin(angle) * upwind + (1.0 - np.cos(angle)) * (side + lift)))
    return np.concatenate(corners)


def sweeps(area: FloatArray, begin: FloatArray, upwind: FloatArray, spacing: float, side: float) -> list[FloatArray]:
    """Ends of crosswind lines over the floor of `area` (3,), m, one (2, 3) for each, each `spacing`, m, farther upwind.

    The first goes through `begin` (3,), m, and ends on the side `side` (1: left, -1: right); the last is at the upwind
    end at most.
    """
    across = np.array([-upwind[1], upwind[0], 0.0])
    floor = np.array([area[0], area[1], 0.0])
    corners = floor * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    last = float((corners @ upwind).max())
    lines: list[FloatArray] = []
    along = float(begin @ upwind)
    while along <= last + 1e-9:
        middle, low, high = along * upwind, -math.inf, math.inf
        for axis in (0, 1):
            if abs(across[axis]) > 1e-9:
                ends = sorted((bound - middle[axis]) / across[axis] for bound in (0.0, float(area[axis])))
                low, high = max(low, ends[0]), min(high, ends[1])
        if low < high:
            ends = [low, high] if side > 0 else [high, low]
            lines.append(np.array([middle + end * across for end in ends]))
            side = -side
        along += spacing
    return lines


class Moth:
    """One UAV's state of an episode."""

    __slots__ = (
        "_area", "_course", "_driver", "_heads", "_leg", "_loop_radius", "_parameters", "_path", "_phase", "_planar",
        "_previous", "_side", "_smelt", "_spacing", "_surge", "_surge_left", "_sweep", "_threshold", "_time",
        "_verdict", "_zigzag", "mode",
    )  # fmt: skip

    def __init__(self, parameters: MothSearch, briefing: Briefing) -> None:
        p, scale = parameters, area_scale(briefing)
        self._surge = _SURGE * scale if p.surge_length is None else p.surge_length
        self._zigzag = _ZIGZAG * scale if p.zigzag_length is None else p.zigzag_length
        self._loop_radius = _LOOP * scale if p.loop_radius is None else p.loop_radius
        self._spacing = _SPACING * scale if p.sweep_spacing is None else p.sweep_spacing
        self._leg = _LEG * scale if p.leg_length is None else p.leg_length
        self._parameters, self._threshold = p, briefing.threshold
        self._area, self._planar = np.asarray(briefing.area, dtype=np.float64), briefing.planar
        self._driver = Driver(briefing, self._leg, samples=p.samples)
        self._course, self._path = Course(briefing, p.wind_time), Path(briefing, self._driver, self._leg)
        self._verdict, self._heads, self.mode = Verdict(p, briefing), Heads(p, briefing), "search"
        self._side = 1.0 if briefing.uav % 2 == 0 else -1.0  # to which the plume is: left or right of the way upwind
        self._phase = (briefing.uav + 0.5) / briefing.n_uavs  # of the height, among the team
        self._previous, self._time = np.array(briefing.start, dtype=np.float64), 0.0
        self._surge_left = 0.0  # m
        self._smelt = self._previous  # (3,) m: where it last smelt something
        self._sweep = 0  # lines of the search so far

    def act(self, observation: Observation) -> Action:
        """The next movement."""
        u, detects = observation.position, observation.sampling_time > 0.0 and observation.reading > self._threshold
        self._course.take(observation, detects)
        self._verdict.take(observation)
        if self.mode == "surge":
            flown = math.dist(u, self._previous)
            self._surge_left -= max(flown, _SLOWEST * self._driver.speed * (observation.time - self._time))
        self._previous, self._time = u.copy(), observation.time
        if detects and not self._path.ends(u, self._course.upwind):
            aside = float(self._course.flown @ self._course.across)
            if self.mode != "surge" and abs(aside) > 0.5:
                self._side = math.copysign(1.0, aside)
            self.mode, self._surge_left, self._smelt = "surge", self._surge, u.copy()
        if self._verdict.suspects:
            return self._driver.drive(u, np.zeros(3))
        if self.mode == "surge":
            upwind = self._course.upwind
            if self._surge_left > 1e-9 and not self._path.ends(u, upwind):
                return self._driver.towards(u, u + self._surge_left * upwind)
            self._heads.add(self._smelt)
            self._begin_zigzag(u)
        return self._follow(u)

    @property
    def declared(self) -> FloatArray | None:
        """(3,) m: the source is here."""
        return self._verdict.declared if self._heads.declared is None else self._heads.declared

    def _follow(self, u: FloatArray) -> Action:
        """On with the programme, or to its next part."""
        for _ in range(4):
            action = self._path.follow(u)
            if action is not None:
                return action
            if self.mode == "zigzag":
                self._begin_loops(u)
            else:
                self._begin_sweeps(u)
        return self._driver.drive(u, np.zeros(3))

    def _begin_zigzag(self, u: FloatArray) -> None:
        p, course = self._parameters, self._course
        self.mode = "zigzag"
        across = self._side * course.across
        shape = zigzag(self._zigzag, p.growth, p.zigzag_turns, p.zigzag_angle, p.climb, course.upwind, across)
        self._path.begin(pieces(u + shape, self._leg))

    def _begin_loops(self, u: FloatArray) -> None:
        p, course = self._parameters, self._course
        self.mode = "loop"
        across = self._side * course.across
        self._path.begin(u + circles(self._loop_radius, p.growth, p.loops, p.climb, course.upwind, across)[1:])

    def _begin_sweeps(self, u: FloatArray) -> None:
        """The rest of the area upwind of `u` (3,), m; from the downwind end, if nothing is left."""
        upwind = self._course.upwind
        first = u
        if self.mode == "search" and self._sweep > 0:
            middle = self._area / 2.0
            first = middle - upwind * (float(np.abs(upwind) @ middle) - self._spacing / 2.0)
        self.mode = "search"
        corners = [u]
        for line in sweeps(self._area, first, upwind, self._spacing, self._side):
            height = float(self._area[2]) * (0.05 + 0.9 * ((self._phase + self._sweep * _GOLDEN) % 1.0))
            line[:, 2] = height
            corners.extend(line)
            self._sweep += 1
        self._path.begin(pieces(np.array(corners), self._spacing / 2.0))


@register_policy
class MothSearch(SurgeParameters, Policy):
    """The silkworm moth's programme. A length of None is a share of the area's scale (`area_scale`)."""

    name: ClassVar[str] = "moth"
    summary: ClassVar[str] = "the silkworm moth's programme: surge upwind, zigzag ever wider, loop"
    vehicle_commands: ClassVar[tuple[Command, ...]] = ("velocity", "setpoint", "leg")
    plume_quantities: ClassVar[tuple[str, ...]] = ("hit_rate", "concentration")

    surge_length: float | None = quantity(None, "m", gt=0)  # after the last detection; None: 0.1
    zigzag_length: float | None = quantity(None, "m", gt=0)  # of the first turn, to the side; None: 0.06
    zigzag_turns: int = quantity(5, "", ge=1)
    zigzag_angle: float = quantity(math.radians(80.0), "rad", gt=0, le=math.pi / 2)  # to the way upwind
    growth: float = quantity(1.5, "", ge=1)  # from turn to turn, and from loop to loop
    loops: int = quantity(4, "", ge=0)
    loop_radius: float | None = quantity(None, "m", gt=0)  # of the first; None: 0.06
    sweep_spacing: float | None = quantity(None, "m", gt=0)  # None: 0.15
    climb: float = quantity(0.5, "", ge=0)  # of a turn's or loop's reach; without effect on the ground
    wind_time: float = quantity(2.0, "s", ge=0)  # time constant of the wind's mean
    leg_length: float | None = quantity(None, "m", gt=0)  # where legs are flown; None: 0.1
    samples: int = quantity(2, "", ge=1)  # at the end of each leg

    _moth: Moth | None = PrivateAttr(default=None)

    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`."""
        self._moth = Moth(self, briefing)

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """The next movement; nothing is heard."""
        if self._moth is None:
            raise RuntimeError("moth: reset(briefing) comes before the first decision")
        return self._moth.act(observation)

    def declaration(self) -> FloatArray | None:
        """(3,) m, once either rule holds."""
        return self._moth.declared if self._moth else None

    @property
    def mode(self) -> str:
        """search, surge, zigzag or loop."""
        return self._moth.mode if self._moth else ""
