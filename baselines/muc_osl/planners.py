"""The two planners of the MUC-OSL family: information-driven with a fixed step, and Adap-PP (eqs 21 to 28).

Both look one sample ahead at the 26 neighbours of the UAV's place on a 3D grid, with the exact reductions of
`belief.information`.

Information-driven (Col-Inf, Col-PF): the neighbour with the greatest expected entropy reduction, always `hop_length`
steps. Adap-PP: the direction with the greatest W - E[W'], W = D + h1 H (eqs 21 to 25), h1 = `spread_weight` sqrt(tr
Sigma); W itself is the same for all. Then the length with the least R(l) = D(l) + h2 Z(l) (eqs 27, 28), up to l_max:
that of the briefing, or from zeta (eq 26), the share of the area where the advertised plume of a source at its centre
gives more than `zeta_threshold` hits a second. Hops that an obstacle blocks are no candidates.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np

from baselines.belief.likelihood import HitModel
from baselines.belief.particle_filter import ParticleBelief
from baselines.muc_osl.planning_kernels import STAY, adaptive_leg, best_direction
from baselines.passage import Passage
from baselines.policy import Briefing
from osl_env.actions import HOP_DIRECTIONS, Hop, Hover, Waypoint
from osl_env.parameters import FloatArray, Parameters, quantity

_ZETA_CELLS = 40  # along the longest side of the area, to measure the plume's volume


class PlannerParameters(Parameters):
    """What both planners have."""

    cumulative: float = quantity(0.999, "", gt=0, lt=1)  # the predictive's cumulative probability at dmax (eq 24)
    hovering: bool = False  # staying for another sample is a 27th candidate


class InformationPlannerParameters(PlannerParameters):
    """Parameters of `InformationPlanner`."""

    hop_length: int = quantity(1, "", ge=1)  # grid steps


class AdaptivePlannerParameters(PlannerParameters):
    """Parameters of `AdaptivePlanner`."""

    spread_weight: float = quantity(100.0, "", ge=0)  # c of h1 = c sqrt(tr Sigma), eq 23; the page says 30 to 300
    revisit_weight: float = quantity(1.0, "m", ge=0)  # h2 of eq 27
    step: Literal["briefing", "from_zeta"] = "briefing"  # where l_max comes from
    zeta_threshold: float = quantity(0.1, "1/s", gt=0)  # hit rate that counts as plume in eq 26


class InformationPlanner:
    """Planner: the greatest expected entropy reduction, with a fixed step."""

    __slots__ = ("_area", "_cumulative", "_hop", "_hovering", "_length", "_passage", "_sampling_time")

    def __init__(self, parameters: InformationPlannerParameters, briefing: Briefing) -> None:
        self._length = min(parameters.hop_length, briefing.hop_lengths)
        self._hop = self._length * briefing.step_length
        self._hovering, self._cumulative = parameters.hovering, parameters.cumulative
        self._sampling_time = briefing.hover_time
        self._area = np.array(briefing.area, dtype=np.float64)
        self._passage = Passage(briefing)

    def choose(self, belief: ParticleBelief, position: FloatArray, model: HitModel) -> Hop | Hover:
        """The next leg from `position` (3,), m."""
        direction = best_direction(
            belief.cloud,
            position,
            self._hop,
            self._hovering,
            self._sampling_time,
            model,
            self._cumulative,
            1.0,
            0.0,
            self._area,
            belief.random,
            self._passage.reach(position, self._hop),
        )
        return Hover() if direction == STAY else Hop(direction, self._length)


class AdaptivePlanner:
    """Planner: Adap-PP. Remembers where the UAV has sampled."""

    __slots__ = (
        "_area",
        "_cumulative",
        "_history",
        "_hop",
        "_hop_lengths",
        "_hovering",
        "_longest",
        "_passage",
        "_revisit_weight",
        "_sampling_time",
        "_spread_weight",
        "_visited",
    )

    def __init__(self, parameters: AdaptivePlannerParameters, briefing: Briefing) -> None:
        self._hop, self._sampling_time = briefing.step_length, briefing.hover_time
        self._hovering, self._cumulative = parameters.hovering, parameters.cumulative
        self._spread_weight, self._revisit_weight = parameters.spread_weight, parameters.revisit_weight
        self._area = np.array(briefing.area, dtype=np.float64)
        self._passage = Passage(briefing)
        self._longest = self._hop_lengths = briefing.hop_lengths
        if parameters.step == "from_zeta":
            self._longest = length_from_zeta(plume_share(briefing, parameters.zeta_threshold))
        self._history, self._visited = np.empty((256, 3)), 0

    def choose(self, belief: ParticleBelief, position: FloatArray, model: HitModel) -> Hop | Hover | Waypoint:
        """The next leg from `position` (3,), m, where the UAV has just sampled."""
        direction, length = adaptive_leg(
            belief.cloud,
            belief.gaussian,
            position,
            self._history[: self._visited],
            self._hop,
            self._longest,
            self._hovering,
            self._sampling_time,
            model,
            self._cumulative,
            self._spread_weight,
            self._revisit_weight,
            self._area,
            belief.random,
            self._passage.reach(position, self._hop, self._longest),
        )
        self._remember(position)
        if direction == STAY:
            return Hover()
        if length > self._hop_lengths:  # with `from_zeta`, a leg may be longer than the vehicle's hops
            return Waypoint(position + length * self._hop * HOP_DIRECTIONS[direction])
        return Hop(direction, length)

    def _remember(self, position: FloatArray) -> None:
        if self._visited == len(self._history):
            self._history = np.concatenate([self._history, np.empty_like(self._history)])
        self._history[self._visited] = position
        self._visited += 1


def plume_share(briefing: Briefing, threshold: float) -> float:
    """zeta of eq 26: the share of the area with a hit rate above `threshold`, 1/s, for a source at its centre.

    The wind is not known before take-off, so 1 m/s is assumed, along each of the two horizontal axes in turn.
    """
    area = np.asarray(briefing.area, dtype=np.float64)
    cell = float(area.max()) / _ZETA_CELLS
    axes = [(np.arange(max(1, round(side / cell))) + 0.5) * side / max(1, round(side / cell)) for side in area]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    plume: Any = briefing.plume
    winds = (np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0]))
    shares = [np.mean(plume.field(points, area[None] / 2.0, np.ones(1), wind) > threshold) for wind in winds]
    return float(np.mean(shares))


def length_from_zeta(share: float) -> int:
    """l_max of eq 26 in grid steps: zeta l_max = 0.1 where zeta < 0.1, else 1; at most 100."""
    return 1 if share >= 0.1 else max(1, min(100, math.floor(0.1 / max(share, 1e-3))))
