"""Particle swarm search: each robot is a particle, its velocity the way to a next way point.

    v <- w v + c1 r1 (own best - x) + c2 r2 (best known - x) + c3 (random point - x) + c4 s upwind       (1)
    v <- v (1 - c5 (1 - chi)),  chi = (1 - cos theta) / 2,  theta the angle between v and the wind       (2)

s is `step`, the longest v; r1 and r2 are uniform on [0, 1] per axis. Each term with its source:

- inertia w, own best and best known: J. Kennedy and R. Eberhart (ICNN 1995), on robots that search odours by
  L. Marques, U. Nunes and A. T. de Almeida, "Particle swarm-based olfactory guided search" (Autonomous Robots, 2006).
  Theirs is also that robots avoid each other, and so spread while nobody smells anything: `separation`.
- way points, a new one where the last is reached or takes too long, and the random point, in the whole area, which
  alone with inertia makes the search before anybody has smelt anything: Sniffy Bug, B. P. Duisterhof, S. Li,
  J. Burgues, V. J. Reddi and G. C. H. E. de Croon (IROS 2021). Their published controller has the sum (1) without
  wind, r1 and r2, and with the way left to the last way point for v on the right.
- upwind c4: an upwind term in PSO, of Q. Feng, H. Cai, F. Li et al. (Building and Environment 2018). Here it acts for
  `memory` seconds after a detection.
- (2): the wind utilisation of W. Jatmiko, K. Sekiyama and T. Fukuda (IEEE Computational Intelligence Magazine 2007),
  c5 = 1; with 0 the wind does not slow a flight that goes downwind.
- forgetting: a plume that varies makes old bests worthless, for which Jatmiko et al. spread the swarm anew at times.
  Here a best of age a counts exp(-a / `forgetting`) of its value, and nothing after five such times (ours; inf: never).

"Best known" is what the robot has heard or found itself: place, concentration and time of its best travel in the
payload (20 bytes) and are passed on, so that they cross the network from hop to hop. Frames without one count with
their own place and reading. Values are low-pass means over `filter_time`. A UAV alone has its own best only.
"""

from __future__ import annotations

import math
from typing import ClassVar, NamedTuple

import numpy as np

from baselines.driving import area_scale
from baselines.hearing import CALM, Heard, HearingPilot, HearingPolicy, pack, repulsion, unpack
from baselines.policy import Briefing, register_policy
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity

_FORGOTTEN = 5.0  # forgetting times
_PATIENCE = 1.5  # of the time that a way of `step` takes
_REACHED = 0.1  # of `step`
_STEP = 0.1  # of the area's scale
_PUSH = 2.0  # of the speed, at no distance


class Best(NamedTuple):
    """Where and when how much was smelt."""

    position: FloatArray  # (3,) m
    value: float  # in the sensor's unit, or hits per second
    time: float  # s


def wind_factor(velocity: FloatArray, wind: FloatArray, weight: float) -> float:
    """Factor of (2) for a `velocity` (3,) in `wind` (3,) m/s, with c5 = `weight`; 1 in a calm or at rest."""
    size = math.sqrt(float(velocity @ velocity)) * math.sqrt(float(wind @ wind))
    if size == 0.0 or float(wind @ wind) < CALM * CALM:
        return 1.0
    chi = 0.5 * (1.0 - float(velocity @ wind) / size)
    return 1.0 - weight * (1.0 - chi)


class Particle(HearingPilot):
    """One particle."""

    __slots__ = ("_area", "_due", "_generator", "_p", "_separation", "_velocity", "goal", "known", "own", "step")

    def __init__(self, parameters: ParticleSwarm, briefing: Briefing) -> None:
        self.step = _STEP * area_scale(briefing) if parameters.step is None else parameters.step  # m
        super().__init__(briefing, parameters, self.step)
        self._p, self._generator = parameters, np.random.default_rng(briefing.seed)
        self._area = np.asarray(briefing.area, dtype=np.float64)
        self._separation = self.radius(0.3, 0.05) if parameters.separation is None else parameters.separation
        self._velocity = np.zeros(3)  # m, the way to the next way point
        self.goal, self._due = np.array(briefing.start, dtype=np.float64), -math.inf
        self.own: Best | None = None
        self.known: Best | None = None

    def _worth(self, best: Best | None, now: float) -> float:
        if best is None:
            return 0.0
        ages = max(0.0, now - best.time) / self._p.forgetting
        return best.value * math.exp(-ages) if ages < _FORGOTTEN else 0.0

    def payload(self, observation: Observation) -> bytes | None:
        """Place, value and time of the best known, 20 bytes; nothing if nothing is known."""
        self._note(observation)
        known = self.known
        return None if known is None else pack(*known.position.tolist(), known.value, known.time)

    def _note(self, observation: Observation) -> None:
        """Keep the present place if it is the best, and drop what has been forgotten."""
        now, here = observation.time, self.senses.concentration
        if here > 0.0 and self.senses.smelt(now, self._p.memory) and here >= self._worth(self.own, now):
            self.own = Best(observation.position.copy(), here, now)
        self.own = self.own if self._worth(self.own, now) > 0.0 else None
        self.known = self.known if self._worth(self.known, now) > 0.0 else None
        if self._worth(self.own, now) > self._worth(self.known, now):
            self.known = self.own

    def wish(self, observation: Observation, others: list[Heard]) -> FloatArray:
        """To the way point, away from who is too near."""
        now, position = observation.time, observation.position
        self._note(observation)
        knew = self.known is not None
        for other in others:
            best = self._told(other)
            if self._worth(best, now) > self._worth(self.known, now):
                self.known = best
        way = self.goal - position
        distance = math.sqrt(float(way @ way))
        first = self.known is not None and not knew
        if first or now >= self._due or distance < _REACHED * self.step or self.briefing.action == "leg":
            self._aim(observation)
            self._due = now + _PATIENCE * self.step / self.speed
            way = self.goal - position
            distance = math.sqrt(float(way @ way))
        self.mode = "explore" if self.known is None else "seek"
        full = self.leg if self.briefing.action == "leg" else _REACHED * self.step  # slows down before the way point
        wished = way * (self.speed / max(distance, full))
        return wished + _PUSH * self.speed * repulsion(others, self._separation)

    def _told(self, other: Heard) -> Best | None:
        numbers = unpack(other.payload, 5)
        if numbers is not None:
            place = np.clip(np.array(numbers[:3]), 0.0, self._area)
            return Best(place, max(numbers[3], 0.0), min(numbers[4], other.time))
        above = other.concentration > (0.0 if self.counts else self.briefing.threshold)
        return Best(other.position.copy(), other.concentration, other.time) if above else None

    def _aim(self, observation: Observation) -> None:
        """A new way point by (1) and (2)."""
        p, x, draw = self._p, observation.position, self._generator.uniform
        r1, r2, point = draw(size=3), draw(size=3), draw(0.0, self._area)
        v = p.inertia * self._velocity + (p.exploring if self.known is None else p.randomness) * (point - x)
        if self.own is not None:
            v += p.cognitive * r1 * (self.own.position - x)
        if self.known is not None:
            v += p.social * r2 * (self.known.position - x)
        upwind = self.senses.upwind
        if upwind is not None and self.senses.smelt(observation.time, p.memory):
            v += p.wind_weight * self.step * upwind
        if self.briefing.planar:
            v[2] = 0.0
        size = math.sqrt(float(v @ v))
        v *= min(1.0, self.step / size) if size > 0.0 else 1.0
        if self.known is not None:
            v *= wind_factor(v, self.senses.wind, p.wind_use)
        self._velocity, self.goal = v, np.clip(x + v, 0.0, self._area)


@register_policy
class ParticleSwarm(HearingPolicy):
    """Particle swarm search with plume-aware velocities."""

    name: ClassVar[str] = "particle-swarm"
    summary: ClassVar[str] = "particle swarm: way points from inertia, own best, best heard, chance and the wind"

    inertia: float = quantity(0.5, "", ge=0, lt=1)  # w
    cognitive: float = quantity(1.0, "", ge=0)  # c1
    social: float = quantity(1.0, "", ge=0)  # c2
    randomness: float = quantity(0.05, "", ge=0)  # c3 once a best is known
    exploring: float = quantity(0.5, "", ge=0)  # c3 before
    wind_weight: float = quantity(0.7, "", ge=0)  # c4
    wind_use: float = quantity(0.5, "", ge=0, le=1)  # c5
    step: float | None = quantity(None, "m", gt=0)  # longest way; None: 0.1 of the area's scale
    forgetting: float = quantity(60.0, "s", gt=0, infinite=True)
    memory: float = quantity(20.0, "s", gt=0)  # the upwind term acts so long after a detection
    separation: float | None = quantity(None, "m", ge=0)  # None: 0.3 of the radio's radius, or 0.05 of the area's scale
    filter_time: float | None = quantity(3.0, "s", gt=0)  # shorter than the others': a best is a place

    def pilot(self, briefing: Briefing) -> Particle:
        """A particle for an episode with `briefing`."""
        return Particle(self, briefing)
