"""What one UAV that searches by an exact grid belief keeps during an episode.

Every reading that it takes or hears goes into its own belief: nothing is shared but what the radio brings. A frame
carries one reading, so UAVs in contact from the start hold the same belief up to the order of rounding.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from baselines.belief.grid import GridBelief
from baselines.belief.likelihood import AdvertisedPlume, HitModel, ReadingTable
from baselines.declaration import DeclarationParameters, DeclarationRule
from baselines.policy import Belief, Briefing
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity
from osl_env.radio import Message

_CELL_BITS = 32  # a cell's probability in single precision
_PICTURED = 500  # points of a belief for pictures


class GridParameters(DeclarationParameters):
    """Parameters of searchers with an exact grid belief."""

    cell: float = quantity(2.0, "m", gt=0)  # side of a cell
    sharing: bool = True  # use the readings of others heard by radio


class GridSearcher:
    """A grid belief with what feeds it and the rule that ends the search. Made for each episode."""

    __slots__ = (
        "_model",
        "_plume",
        "_readings",
        "_rule",
        "_sharing",
        "belief",
        "covariance",
        "declared",
        "mean",
        "spread",
        "work",
    )

    def __init__(self, parameters: GridParameters, briefing: Briefing) -> None:
        self._plume, self._readings = AdvertisedPlume(briefing), ReadingTable()
        self._rule, self._sharing = DeclarationRule(parameters), parameters.sharing
        self._model: HitModel | None = None
        self.belief = GridBelief(briefing.area, cell=parameters.cell)
        self.declared: FloatArray | None = None  # (3,) m
        self.work = 0  # readings gone through at this decision, of all cells each
        self._summarise()

    def _summarise(self) -> None:
        mean, covariance = self.belief.moments()
        self.mean, self.covariance = mean[0], covariance[0]  # (3,) m, (3, 3) m^2
        self.spread = math.sqrt(float(np.trace(self.covariance)))  # m

    @property
    def heard(self) -> bool:
        """Whether anything has been detected, by this UAV or by one that it heard."""
        return self._rule.heard

    def take(self, observation: Observation, inbox: Sequence[Message]) -> FloatArray:
        """Condition on the new readings and see whether to declare; gives the readings' rows (see `ReadingTable`)."""
        model = self._plume.measure(observation.wind)
        if model is not self._model:
            self.belief.use_model(model)
            self._model = model
        rows = self._readings.gather(observation, inbox if self._sharing else ())
        self.belief.update(rows[None, :, :3], rows[None, :, 3], rows[None, :, 4])
        for hits in rows[:, 3].tolist():
            self._rule.hear(hits)
        self._summarise()
        self.work = len(rows)
        self.declared = self._rule.decide(self.mean, self.spread, observation.position)
        return rows

    def processed_bits(self, n_candidates: int) -> float:
        """Bits of the cells gone through at this decision, for `n_candidates` positions looked at (eq 7's N_c)."""
        return float(_CELL_BITS * self.belief.n_cells * (self.work + n_candidates))

    def as_belief(self) -> Belief:
        """Moments, and the heaviest points for pictures."""
        points = self.belief.compressed(heavy=1.0, negligible=1e-3)
        heaviest = np.argsort(-points[0], kind="stable")[:_PICTURED]
        weights = points[0, heaviest] / points[0, heaviest].sum()
        return Belief(self.mean.copy(), self.covariance.copy(), points[1:4, heaviest].T.copy(), weights)
