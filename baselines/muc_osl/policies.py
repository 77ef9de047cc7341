"""MUC-OSL and the algorithms it is compared with: two estimators and two planners, composed.

name                   estimator            planner
col-inf                TraditionalFilter    InformationPlanner    particles and measurements shared
col-pf                 ColPF                InformationPlanner
adap-pp                TraditionalFilter    AdaptivePlanner       measurements shared
muc-osl                ColPF                AdaptivePlanner
col-inf-roughened, adap-pp-roughened: as col-inf and adap-pp, with roughening after resampling.

A decision (MUC-OSL's loop): take the own reading and the frames heard into the belief, plan the next leg, and declare
if the rule of `baselines.declaration` holds. The frame sent carries the belief of the iteration before, as eq 10 wants
it. Parameters are the fields of estimator, planner and declaration, side by side: `make_policy("muc-osl",
particles=160)`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Protocol

from pydantic import PrivateAttr

from baselines.belief.likelihood import AdvertisedPlume, HitModel, ReadingTable
from baselines.belief.particle_filter import ParticleBelief
from baselines.declaration import DeclarationParameters, DeclarationRule
from baselines.muc_osl.col_pf import ColPF, ColPFParameters
from baselines.muc_osl.planners import (
    AdaptivePlanner,
    AdaptivePlannerParameters,
    InformationPlanner,
    InformationPlannerParameters,
)
from baselines.muc_osl.planning_kernels import STAY
from baselines.muc_osl.traditional import TraditionalFilter, TraditionalFilterParameters
from baselines.policy import Belief, Briefing, Policy, register_policy
from osl_env.actions import Action
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity
from osl_env.radio import Message

_PARTICLE_BITS = 4 * 32  # position and weight of one particle in single precision


class Estimator(Protocol):
    """Keeps one UAV's belief. Made of (parameters, briefing) for each episode."""

    belief: ParticleBelief

    def message(self) -> bytes | None:
        """The payload for the neighbours."""

    def update(self, readings: FloatArray, inbox: Sequence[Message], model: HitModel) -> None:
        """Take in `readings` (1 + F, 6) and the F frames of `inbox`."""


class Planner(Protocol):
    """Chooses one UAV's legs. Made of (parameters, briefing) for each episode."""

    def choose(self, belief: ParticleBelief, position: FloatArray, model: HitModel) -> Action:
        """The next leg from `position` (3,), m."""


class SearchState:
    """One UAV's state of an episode."""

    __slots__ = ("declaration", "declared", "estimator", "planner", "plume", "processed_bits", "readings")

    def __init__(
        self, estimator: Estimator, planner: Planner, declaration: DeclarationRule, briefing: Briefing
    ) -> None:
        self.estimator, self.planner, self.declaration = estimator, planner, declaration
        self.plume = AdvertisedPlume(briefing)
        self.readings = ReadingTable()
        self.declared: FloatArray | None = None
        self.processed_bits = 0.0


class SearchPolicy(DeclarationParameters, Policy):
    """Base: an estimator and a planner make a searcher. Subclasses name the two and mix in their parameters."""

    estimator_class: ClassVar[Any]
    planner_class: ClassVar[Any]

    _state: SearchState | None = PrivateAttr(default=None)

    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`. Raises InputError for a plume that gives no hits."""
        estimator = self.estimator_class(self, briefing)
        planner = self.planner_class(self, briefing)
        self._state = SearchState(estimator, planner, DeclarationRule(self), briefing)

    def _search(self) -> SearchState:
        state = self._state
        if state is None:
            raise RuntimeError(f"{self.name}: reset(briefing) comes before the first decision")
        return state

    def broadcast(self, observation: Observation) -> bytes | None:
        """The belief of the iteration before."""
        return self._search().estimator.message()

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """Update on everything new, plan, and see whether to declare."""
        state = self._search()
        estimator, declaration = state.estimator, state.declaration
        model = state.plume.measure(observation.wind)
        readings = state.readings.gather(observation, inbox)
        estimator.update(readings, inbox, model)
        declaration.hear(observation.reading)
        for message in inbox:
            declaration.hear(message.reading)
        belief = estimator.belief
        state.declared = declaration.decide(belief.mean, belief.spread, observation.position)
        state.processed_bits = float(_PARTICLE_BITS * belief.count * (len(readings) + STAY))
        return state.planner.choose(belief, observation.position, model)

    def belief(self) -> Belief | None:
        """The particles and their Gaussian."""
        return self._search().estimator.belief.as_belief()

    def declaration(self) -> FloatArray | None:
        """The belief's mean, (3,) m, once the rule holds."""
        return self._search().declared

    @property
    def computed_bits(self) -> float:
        """Bits of the particles gone through: once for every reading and for every candidate position (eq 7's N_c)."""
        return self._search().processed_bits


@register_policy
class ColInf(TraditionalFilterParameters, InformationPlannerParameters, SearchPolicy):
    """Col-Inf: traditional particle filter, particles and measurements shared; information-driven, fixed step."""

    name: ClassVar[str] = "col-inf"
    summary: ClassVar[str] = "Col-Inf: traditional particle filter, information-driven steps"
    estimator_class: ClassVar[Any] = TraditionalFilter
    planner_class: ClassVar[Any] = InformationPlanner

    share_particles: bool = True


@register_policy
class ColPFSearch(ColPFParameters, InformationPlannerParameters, SearchPolicy):
    """Col-PF: collaborative particle filter; information-driven, fixed step."""

    name: ClassVar[str] = "col-pf"
    summary: ClassVar[str] = "Col-PF: collaborative particle filter, information-driven steps"
    estimator_class: ClassVar[Any] = ColPF
    planner_class: ClassVar[Any] = InformationPlanner


@register_policy
class AdapPP(TraditionalFilterParameters, AdaptivePlannerParameters, SearchPolicy):
    """Adap-PP: traditional particle filter, measurements shared; adaptive path planning."""

    name: ClassVar[str] = "adap-pp"
    summary: ClassVar[str] = "Adap-PP: traditional particle filter, adaptive path planning"
    estimator_class: ClassVar[Any] = TraditionalFilter
    planner_class: ClassVar[Any] = AdaptivePlanner


@register_policy
class MucOsl(ColPFParameters, AdaptivePlannerParameters, SearchPolicy):
    """MUC-OSL: collaborative particle filter and adaptive path planning."""

    name: ClassVar[str] = "muc-osl"
    summary: ClassVar[str] = "MUC-OSL: collaborative particle filter, adaptive path planning"
    estimator_class: ClassVar[Any] = ColPF
    planner_class: ClassVar[Any] = AdaptivePlanner


@register_policy
class ColInfRoughened(ColInf):
    """Col-Inf with roughening after resampling."""

    name: ClassVar[str] = "col-inf-roughened"
    summary: ClassVar[str] = "Col-Inf with a roughened particle filter"

    roughening: float = quantity(0.5, "", ge=0)


@register_policy
class AdapPPRoughened(AdapPP):
    """Adap-PP with roughening after resampling."""

    name: ClassVar[str] = "adap-pp-roughened"
    summary: ClassVar[str] = "Adap-PP with a roughened particle filter"

    roughening: float = quantity(0.5, "", ge=0)
