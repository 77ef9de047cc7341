"""Biasing expansion swarm (BESA): a radio network of robots that expands, biased to where it smells most.

X. Cui, C. T. Hardin, R. K. Ragade and A. S. Elmaghraby, "A swarm approach for emission sources localization",
ICTAI 2004, and "A swarm-based fuzzy logic control mobile sensor network for hazardous contaminants localization",
MASS 2004. Their robots move on a grid and exchange place and concentration over an ad hoc network. Cohesion keeps the
network whole, separation keeps robots apart, so that by itself the swarm expands to cover as much as its radio allows;
the measured concentrations bias the moves by a hypothetical gravity, weighted by the inverse of the distance.

The papers' full text was not at hand: what follows is our reading of what is known of them. At each move a robot
scores the 8 neighbours of its cell (26 in 3D) and its own:

    score = expansion min(d / L, 1) + bias B.m / max(|B|, 1) + wander noise + persistence m_before.m
    B     = sum over j heard of  w_j (L / r_ij) e_ij,   w_j = max(C_j - C_i, 0) / max over all of C

d is the move's distance to the nearest robot, L the longest link, r_ij and e_ij distance and direction to j, m the unit
vector of the move, C low-pass readings. Only those who smell more attract (the largest concentration then leads, and
expands), and B is cut at 1. Noise is uniform on [0, 1); persistence acts while nothing attracts. Allowed moves:

- separation: not nearer to any robot than `separation` L, unless farther than now;
- cohesion: links are kept with those heard for whom no third robot heard is nearer to both than they are to each other
  (the relative neighbourhood graph, G. Toussaint, Pattern Recognition 1980; connected if the radio network is).
  With each of them at most L away, the move ends within L / 2 of the middle between the two, which keeps the link
  whatever the other does by the same rule (H. Ando, Y. Oasa, I. Suzuki and M. Yamashita, IEEE Trans. Robotics and
  Automation 15, 1999); from one farther away it does not lead away. To stay is always allowed.

Moves begin at common times, every `step` / speed seconds: the rule of the middle needs that. Obstacles that turn a
robot aside, lost frames and late ones may break links. L is 0.9 of the radio's radius, or 0.25 of the area's scale if
it is infinite. Wind plays no part. A UAV alone wanders.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from baselines.driving import area_scale
from baselines.hearing import Heard, HearingPilot, HearingPolicy, pack, unpack
from baselines.policy import Briefing, register_policy
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity
from osl_env.state import BoolArray

_SLACK = 1e-9  # m
_LINK = (0.9, 0.25)  # L: of the radio's radius, of the area's scale
_STEP = (0.15, 0.05)  # the grid's: of L, of the area's scale at most
_EVEN = 0.01  # of a decision: move times are compared with it


def gravity(
    own: float, concentrations: FloatArray, distances: FloatArray, directions: FloatArray, link: float
) -> FloatArray:
    """B (3,): the bias of a robot that smells `own` by those at `distances` (n,) m, `directions` (n, 3).

    Zero if nobody smells more. A robot at the same place attracts as one a thousandth of a link away.
    """
    most = max(own, float(concentrations.max(initial=0.0)))
    if most <= 0.0:
        return np.zeros(3)
    weights = np.maximum(concentrations - own, 0.0) / most
    pull: FloatArray = (weights * link / np.maximum(distances, 1e-3 * link)) @ directions
    return pull


def linked(offsets: FloatArray) -> BoolArray:
    """(n,): with which of the robots at `offsets` (n, 3) m the relative neighbourhood graph links the one at 0."""
    to_own = np.linalg.norm(offsets, axis=1)
    between = np.linalg.norm(offsets[:, None] - offsets[None], axis=2)  # [j, k]
    # equal distances count as not nearer: among robots in a tie every link stays
    least = to_own[:, None] - _SLACK
    nearer: BoolArray = (to_own[None] < least) & (between < least)
    return np.logical_not(nearer.any(axis=1))


def allowed(moves: FloatArray, offsets: FloatArray, link: float, separation: float) -> BoolArray:
    """(m,): which of `moves` (m, 3) m separation and cohesion with the robots at `offsets` (n, 3) m allow."""
    now = np.linalg.norm(offsets, axis=1)  # (n,)
    then = np.linalg.norm(moves[:, None] - offsets[None], axis=2)  # (m, n)
    good: BoolArray = np.all((then >= separation) | (then > now), axis=1)
    keeps = linked(offsets)
    to_middle = np.linalg.norm(moves[:, None] - 0.5 * offsets[None], axis=2)
    holds = np.where(now <= link, to_middle <= 0.5 * link + _SLACK, then <= now + _SLACK)
    good &= np.all(holds | ~keeps, axis=1)
    good |= ~moves.any(axis=1)
    return good


class Expander(HearingPilot):
    """One robot of the swarm."""

    __slots__ = ("_before", "_generator", "_p", "_period", "_target", "_turn", "link", "moves", "step")

    def __init__(self, parameters: BiasingExpansion, briefing: Briefing) -> None:
        link = parameters.link
        radio = briefing.radio.radius
        self.link = link if link is not None else _LINK[0] * radio if 0.0 < radio < math.inf else (
            _LINK[1] * area_scale(briefing))  # fmt: skip
        most = _STEP[1] * area_scale(briefing)
        self.step = min(_STEP[0] * self.link, most) if parameters.step is None else parameters.step
        super().__init__(briefing, parameters, self.step)
        self._p, self._generator = parameters, np.random.default_rng(briefing.seed)
        heights = (0.0,) if briefing.planar else (-1.0, 0.0, 1.0)
        steps = np.array(list(itertools.product((-1.0, 0.0, 1.0), (-1.0, 0.0, 1.0), heights)))
        # all moves are `step` long: the diagonals of a grid would take longer than the time between two moves
        self.moves = steps * (self.step / np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), 1.0))
        self._period = self.step / self.speed
        self._target, self._before, self._turn = np.array(briefing.start, dtype=np.float64), np.zeros(3), -1

    def payload(self, observation: Observation) -> bytes:
        """The low-pass concentration, 4 bytes."""
        return pack(self.senses.concentration)

    def wish(self, observation: Observation, others: list[Heard]) -> FloatArray:
        """To the chosen cell."""
        turn = math.floor(observation.time / self._period + _EVEN)
        if self.briefing.action == "leg" or turn != self._turn:
            self._turn = turn
            move = self._choose(observation.position, others)
            self._target, self._before = observation.position + move, move / self.step
        way = self._target - observation.position
        # slower over the last decision's way, so as not to pass the cell
        reach = self.leg if self.briefing.action == "leg" else self.speed * self.briefing.decision_period
        return way * (self.speed / max(reach, math.sqrt(float(way @ way))))

    def _choose(self, position: FloatArray, others: Sequence[Heard]) -> FloatArray:
        p, moves = self._p, self.moves
        noise = p.wander * self._generator.random(len(moves))
        offsets = np.array([other.distance * other.direction for other in others]).reshape(-1, 3)
        distances = np.array([other.distance for other in others])
        directions = np.array([other.direction for other in others]).reshape(-1, 3)
        smelt = np.array([self._told(other) for other in others])
        pull = gravity(self.senses.concentration, smelt, distances, directions, self.link)
        strength = math.sqrt(float(pull @ pull))
        toward = moves / self.step
        score = noise + p.bias * (toward @ pull) / max(strength, 1.0)
        if strength == 0.0:
            score = score + p.persistence * (toward @ self._before)
        if len(others):
            nearest = np.linalg.norm(moves[:, None] - offsets[None], axis=2).min(axis=1)
            score = score + p.expansion * np.minimum(nearest / self.link, 1.0)
        good = allowed(moves, offsets, self.link, p.separation * self.link)
        area = self.briefing.area
        axes = slice(0, 2 if self.briefing.planar else 3)
        ends = position + moves
        good &= np.all((ends[:, axes] >= 0.0) & (ends[:, axes] <= area[axes]), axis=1) | ~moves.any(axis=1)
        good &= self.briefing.arena.clear_from(position, np.clip(ends, 0.0, area)) | ~moves.any(axis=1)
        self.mode = "bias" if strength > 0.0 else "expand"
        chosen: FloatArray = moves[int(np.argmax(np.where(good, score, -math.inf)))]
        return chosen

    def _told(self, other: Heard) -> float:
        numbers = unpack(other.payload, 1)
        return other.concentration if numbers is None else max(numbers[0], 0.0)


@register_policy
class BiasingExpansion(HearingPolicy):
    """Biasing expansion swarm."""

    name: ClassVar[str] = "biasing-expansion"
    summary: ClassVar[str] = "biasing expansion swarm: a radio network that expands, drawn to who smells most; no wind"

    expansion: float = quantity(1.0, "", ge=0)
    bias: float = quantity(2.0, "", ge=0)
    wander: float = quantity(0.3, "", ge=0)
    persistence: float = quantity(0.5, "", ge=0)
    separation: float = quantity(0.3, "", ge=0, lt=1)  # of the longest link
    link: float | None = quantity(None, "m", gt=0)  # L; None: 0.9 of the radio's radius, or 0.25 of the area's scale
    step: float | None = quantity(None, "m", gt=0)  # a move; None: 0.15 L, at most 0.05 of the area's scale

    def pilot(self, briefing: Briefing) -> Expander:
        """A robot for an episode with `briefing`."""
        return Expander(self, briefing)
