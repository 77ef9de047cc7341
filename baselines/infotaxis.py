"""Infotaxis (Vergassola, Villermaux and Shraiman 2007) and space-aware infotaxis (Loisy and Eloy 2022) in 3D.

Infotaxis: of the 26 neighbours of a 3D grid and staying, go where the next reading is expected to lower the entropy
of the belief most. The belief is the exact one on a grid, or a particle filter's. Search ends by the common
declaration rule, not by running into the source, so the original's gain of finding it at the next place has no part
here.

Space-aware infotaxis: go where E[J] over the outcomes of the next reading is least,

    J = log2( D + 2^(H - 1) - 1/2 )

H in bits the belief's entropy and D the mean distance to the source, both after the reading. The original counts D
in moves on a 2D lattice whose cells are one move apart. Here D is Euclidean, for moves may be diagonal, and in
sides of a cell, which keeps the balance between the two terms; the place of the term for finding the source at once
is taken by the declaration. Ties, and places that all promise nothing, go to the place nearest to the posterior
mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import ConfigDict, Field, PrivateAttr

from baselines.belief.grid_information import expected_log_search_time, poisson_tables
from baselines.belief.grid_searcher import GridParameters, GridSearcher
from baselines.belief.likelihood import AdvertisedPlume, ReadingTable
from baselines.belief.particle_filter import ParticleBelief
from baselines.declaration import DeclarationRule
from baselines.muc_osl.planners import InformationPlanner, InformationPlannerParameters
from baselines.passage import Passage
from baselines.policy import Belief, Briefing, Policy, register_policy
from osl_env.actions import HOP_DIRECTIONS, Action, Hop, Hover
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity
from osl_env.radio import Message

_TIE = 1e-9  # nats a metre: only decides between equals
_NEGLIGIBLE = 1e-6  # mass that expectations may leave out
_N_CANDIDATES = len(HOP_DIRECTIONS) + 1
_PARTICLE_BITS = 4 * 32  # position and weight of one particle in single precision


class InfotaxisParameters(GridParameters):
    """Parameters of both: the grid, the declaration and the step."""

    hop_length: int = quantity(1, "", ge=1)  # grid steps of a hop; not more than the scenario's longest
    hovering: bool = True  # staying for another sample is a candidate


class NeighbourSearch:
    """Infotaxis on the grid belief: one UAV's state of an episode."""

    __slots__ = ("_area", "_hop", "_hovering", "_length", "_passage", "_sampling", "bits", "searcher")

    def __init__(self, parameters: InfotaxisParameters, briefing: Briefing) -> None:
        self.searcher = GridSearcher(parameters, briefing)
        self._length = min(parameters.hop_length, briefing.hop_lengths)
        self._hop = self._length * briefing.step_length
        self._hovering, self._area = parameters.hovering, np.asarray(briefing.area, dtype=np.float64)
        self._sampling, self._passage = (briefing.hover_time,), Passage(briefing)
        self.bits = 0.0

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """Take in the readings and choose the next hop."""
        self.searcher.take(observation, inbox)
        self.bits = self.searcher.processed_bits(_N_CANDIDATES)
        u = observation.position
        candidates = np.concatenate([u + self._hop * HOP_DIRECTIONS, u[None]])
        inside = np.all((candidates >= 0.0) & (candidates <= self._area), axis=1)
        inside &= self._passage.reach(u, self._hop) > 0
        inside[-1] = self._hovering or not inside[:-1].any()
        allowed = np.flatnonzero(inside)
        candidates = candidates[allowed]
        cost = self._cost(candidates) + _TIE * np.linalg.norm(candidates - self.searcher.mean, axis=1)
        best = int(allowed[np.argmin(cost)])
        return Hover() if best == len(HOP_DIRECTIONS) else Hop(best, self._length)

    def _cost(self, candidates: FloatArray) -> FloatArray:
        belief = self.searcher.belief
        return -belief.information(candidates, self._sampling, belief.compressed(negligible=_NEGLIGIBLE))[:, 0]

    def belief(self) -> Belief:
        """The grid belief."""
        return self.searcher.as_belief()

    @property
    def declared(self) -> FloatArray | None:
        """(3,) m, the declared position."""
        return self.searcher.declared


class SpaceAwareSearch(NeighbourSearch):
    """Space-aware infotaxis on the grid belief."""

    __slots__ = ()

    def _cost(self, candidates: FloatArray) -> FloatArray:
        belief = self.searcher.belief
        points = belief.compressed(negligible=_NEGLIGIBLE)
        out = np.empty(len(candidates))
        tables = poisson_tables(self._sampling)
        expected_log_search_time(
            points, candidates, belief.models[0], tables.probability, tables.n_outcomes, float(belief.size.mean()), out
        )
        return out


class ParticleSearch:
    """Infotaxis on a particle filter's belief: one UAV's state of an episode."""

    __slots__ = ("_filter", "_planner", "_plume", "_readings", "_roughening", "_rule", "_sharing", "bits", "declared")

    def __init__(self, parameters: Infotaxis, briefing: Briefing) -> None:
        self._filter = ParticleBelief(parameters.particles, briefing.area, briefing.seed)
        planner = InformationPlannerParameters(hop_length=parameters.hop_length, hovering=parameters.hovering)
        self._planner = InformationPlanner(planner, briefing)
        self._plume, self._readings = AdvertisedPlume(briefing), ReadingTable()
        self._rule, self._roughening, self._sharing = (
            DeclarationRule(parameters),
            parameters.roughening,
            parameters.sharing,
        )
        self.declared: FloatArray | None = None
        self.bits = 0.0

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """Take in the readings and choose the next hop."""
        model = self._plume.measure(observation.wind)
        rows = self._readings.gather(observation, inbox if self._sharing else ())
        self._filter.update(rows, model, roughening=self._roughening)
        for hits in rows[:, 3].tolist():
            self._rule.hear(hits)
        self.declared = self._rule.decide(self._filter.mean, self._filter.spread, observation.position)
        self.bits = float(_PARTICLE_BITS * self._filter.count * (len(rows) + _N_CANDIDATES))
        return self._planner.choose(self._filter, observation.position, model)

    def belief(self) -> Belief:
        """The particles."""
        return self._filter.as_belief()


class NeighbourPolicy(InfotaxisParameters, Policy):
    """What the policies that hop to a neighbour do with their state."""

    _search: NeighbourSearch | ParticleSearch | None = PrivateAttr(default=None)

    def _state(self) -> NeighbourSearch | ParticleSearch:
        search = self._search
        if search is None:
            raise RuntimeError(f"{self.name}: reset(briefing) comes before the first decision")
        return search

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """Update on everything new, and hop or hover."""
        return self._state().act(observation, inbox)

    def belief(self) -> Belief | None:
        """The belief about the source."""
        return self._state().belief()

    def declaration(self) -> FloatArray | None:
        """The belief's mean, (3,) m, once the rule holds."""
        return self._state().declared

    @property
    def computed_bits(self) -> float:
        """Bits of the belief gone through: once for every reading and for every candidate position."""
        return self._state().bits


@register_policy
class Infotaxis(NeighbourPolicy):
    """Infotaxis, alone (`sharing=False`) or with the readings of others; on the grid or on particles."""

    name: ClassVar[str] = "infotaxis"
    summary: ClassVar[str] = "Infotaxis: the greatest expected drop of entropy (Vergassola et al. 2007)"

    model_config = ConfigDict(populate_by_name=True)

    representation: Literal["grid", "particles"] = Field("grid", alias="belief")  # `belief` itself is a method's name
    particles: int = quantity(1000, "", ge=2)
    roughening: float = quantity(0.5, "", ge=0)  # of the particles, after resampling

    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`. Raises InputError for a plume that gives no hits."""
        self._search = (
            NeighbourSearch(self, briefing) if self.representation == "grid" else ParticleSearch(self, briefing)
        )


@register_policy
class SpaceAwareInfotaxis(NeighbourPolicy):
    """Space-aware infotaxis on the grid belief."""

    name: ClassVar[str] = "space-aware-infotaxis"
    summary: ClassVar[str] = "Infotaxis that also minds the distance (Loisy and Eloy 2022)"

    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`. Raises InputError for a plume that gives no hits."""
        self._search = SpaceAwareSearch(self, briefing)
