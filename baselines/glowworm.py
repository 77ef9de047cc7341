"""Glowworm swarm optimisation (GSO): robots go to brighter neighbours, the brightest upwind.

K. N. Krishnanand and D. Ghose, "Glowworm swarm based optimization algorithm for multimodal functions with collective
robotics applications", Multiagent and Grid Systems 2 (2006), and "Glowworm swarm optimization for simultaneous capture
of multiple local optima of multimodal functions", Swarm Intelligence 3 (2009):

    luciferin         l_i <- (1 - rho) l_i + gamma J(x_i)
    neighbours        N_i = { j : |x_j - x_i| < r_i and l_j > l_i }
    choice            P(j) = (l_j - l_i) / sum over k in N_i of (l_k - l_i); a step s towards the chosen one
    decision range    r_i <- min(r_s, max(0, r_i + beta (n_t - |N_i|)))

with rho = 0.4, gamma = 0.6, beta = 0.08, n_t = 5. It has no rule for a glowworm without brighter neighbours: it stays.
For odour, J. Thomas and D. Ghose ("Strategies for locating multiple odor sources using glowworm swarm optimization",
IICAI 2009, and gso-project.webnode.page) give it two modes: one that has luciferin but no neighbour goes upwind, and
one that has none searches in a spiral; and they found the largest concentration of the last seconds to be a better
luciferin in a turbulent plume than the decaying one. Here `luciferin: maximum` is theirs, `leader: stay` the original.

Read differently: J is the mean reading of an iteration (`iteration` s of flight at full speed, or one leg) in units of
the gas sensor's scale; l starts at 0 and not at 5, so that "no luciferin" has a meaning; beta is a share of r_s, r_s
the radio's radius (0.3 of the area's scale if that is infinite); a glowworm is lit for `memory` iterations after its
last detection, then its luciferin is 0; an unlit one without a brighter neighbour casts diagonally in place of the
spiral. Robots have a size: they keep `separation` from each other, a repulsion in place of the original's leapfrogging.

A UAV alone goes upwind while it is lit and casts otherwise. In a calm a lit leader stays. Foreign frames without a
payload glow as their reading would in the long run (gamma / rho J).
"""

from __future__ import annotations

import math
from typing import ClassVar, Literal

import numpy as np

from baselines.hearing import DiagonalCast, Heard, HearingPilot, HearingPolicy, pack, repulsion, unpack
from baselines.policy import Briefing, register_policy
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity

_SLANT = math.radians(20.0)  # of the cast
_PUSH = 2.0  # of the speed, at no distance


def luciferin(before: float, fitness: float, decay: float, gain: float) -> float:
    """l after an iteration: (1 - rho) l + gamma J."""
    return (1.0 - decay) * before + gain * fitness


def decision_range(before: float, limit: float, gain: float, wanted: int, neighbours: int) -> float:
    """r after an iteration, m: min(r_s, max(0, r + beta (n_t - n)))."""
    return min(limit, max(0.0, before + gain * (wanted - neighbours)))


class Glow(HearingPilot):
    """One glowworm."""

    __slots__ = ("_cast", "_chosen", "_generator", "_lit", "_next", "_p", "_readings", "_recent", "level", "limit",
                 "range")  # fmt: skip

    def __init__(self, parameters: Glowworm, briefing: Briefing) -> None:
        super().__init__(briefing, parameters)
        self._p, self._generator = parameters, np.random.default_rng(briefing.seed)
        self.limit = self.radius(1.0, 0.3) if parameters.sensor_range is None else parameters.sensor_range  # r_s, m
        self.range, self.level = self.limit, 0.0
        self._cast = DiagonalCast(briefing, self.fence, _SLANT, self.leg)
        self._readings: list[float] = []  # of this iteration
        self._recent: list[float] = []  # J of the last `memory` iterations
        self._chosen: FloatArray | None = None  # (3,) m: where the chosen neighbour was
        self._next, self._lit = -math.inf, 0  # s; iterations

    def payload(self, observation: Observation) -> bytes:
        """The luciferin, 4 bytes."""
        return pack(self.level)

    def wish(self, observation: Observation, others: list[Heard]) -> FloatArray:
        """Towards the chosen neighbour, upwind, or casting."""
        self._readings.append(self.senses.fresh)
        if self.senses.detected >= observation.time:
            self._lit = self._p.memory + 1
        if self.briefing.action == "leg" or observation.time >= self._next - 1e-9:
            self._next = observation.time + self._p.iteration
            self._iterate(others)
        push = _PUSH * repulsion(others, self._p.separation * self.limit)
        return self.speed * (self._direction(observation) + push)

    def _iterate(self, others: list[Heard]) -> None:
        fitness = sum(self._readings) / len(self._readings) / float(self.briefing.gas_sensor.scale)
        self._readings.clear()
        self._recent = [*self._recent, fitness][-self._p.memory :]
        if self._p.luciferin == "maximum":
            self.level = max(self._recent)
        else:
            self.level = luciferin(self.level, fitness, self._p.luciferin_decay, self._p.luciferin_gain)
        self._lit -= 1
        if self._lit <= 0:
            self.level = 0.0  # what is left of an old smell must not lead anybody
        brighter = [(other, excess) for other in others if (excess := self._glow(other) - self.level) > 0.0
                    and other.distance < self.range]  # fmt: skip
        self._chosen = None
        if brighter:
            excesses = np.array([excess for _, excess in brighter])
            choice = self._generator.choice(len(brighter), p=excesses / excesses.sum())
            self._chosen = brighter[choice][0].position.copy()
        gain = self._p.range_gain * self.limit
        self.range = decision_range(self.range, self.limit, gain, self._p.wanted_neighbours, len(brighter))

    def _glow(self, other: Heard) -> float:
        numbers = unpack(other.payload, 1)
        if numbers is not None:
            return numbers[0]
        fitness = other.concentration / float(self.briefing.gas_sensor.scale)
        return fitness if self._p.luciferin == "maximum" else fitness * self._p.luciferin_gain / self._p.luciferin_decay

    def _direction(self, observation: Observation) -> FloatArray:
        if self._chosen is not None:
            self.mode = "chemotaxis"
            way = self._chosen - observation.position
            distance = math.sqrt(float(way @ way))
            return way / distance if distance > 1e-6 else np.zeros(3)
        upwind = self.senses.upwind
        if self._lit > 0:
            self.mode = "upwind" if self._p.leader == "upwind" else "stay"
            return np.zeros(3) if self._p.leader == "stay" or upwind is None else upwind
        self.mode = "cast"
        return self._cast.direction(observation.position, upwind)


@register_policy
class Glowworm(HearingPolicy):
    """Glowworm swarm optimisation."""

    name: ClassVar[str] = "glowworm"
    summary: ClassVar[str] = (
        "glowworm swarm: towards brighter neighbours within an adaptive range, the brightest upwind"
    )

    iteration: float = quantity(2.0, "s", gt=0)  # with velocities; a leg is an iteration
    luciferin_decay: float = quantity(0.4, "", gt=0, le=1)  # rho
    luciferin_gain: float = quantity(0.6, "", gt=0)  # gamma
    luciferin: Literal["decay", "maximum"] = "decay"
    memory: int = quantity(10, "", ge=1)  # iterations: lit after a detection, and what `maximum` looks back on
    range_gain: float = quantity(0.08, "", gt=0)  # beta, of r_s a neighbour
    wanted_neighbours: int = quantity(5, "", ge=1)  # n_t
    sensor_range: float | None = quantity(None, "m", gt=0)  # r_s; None: the radio's radius, or 0.3 of the area's scale
    separation: float = quantity(0.15, "", ge=0, lt=1)  # of r_s
    leader: Literal["upwind", "stay"] = "upwind"  # what a lit glowworm does that sees none brighter

    def pilot(self, briefing: Briefing) -> Glow:
        """A glowworm for an episode with `briefing`."""
        return Glow(self, briefing)
