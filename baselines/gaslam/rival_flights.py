"""How GaSLAM's rivals fly: readings into the maps, goals one after another, and a verdict when the budget ends."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

import numpy as np

from baselines.gaslam.budget import Budget
from baselines.gaslam.declaration import Guesses
from baselines.gaslam.flying import Flying
from baselines.gaslam.gaseous import gaseous
from baselines.gaslam.information import around, choose, most_informative
from baselines.gaslam.mapping import Mapping, MappingParameters, length_scale
from baselines.gaslam.survey import Survey
from baselines.passage import Passage
from baselines.policy import Belief, Briefing
from osl_env.actions import Action
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity
from osl_env.state import BoolArray

if TYPE_CHECKING:
    from baselines.gaslam.rivals import BoustrophedonSTE, KernelPeak, RahbarSTE


class FlightParameters(MappingParameters):
    """Parameters of a flight; mixed into the parameters of the policies."""

    arrival_radius: float = quantity(0.1, "m", gt=0)  # at a goal, in the paper's volume
    goal_time: float = quantity(1.0, "s", ge=0)  # between two estimates at least
    samples: int = quantity(1, "", ge=1)  # at the end of a leg


class Flight(ABC):
    """One UAV's state of an episode."""

    def __init__(self, parameters: FlightParameters, briefing: Briefing) -> None:
        """Raises InputError for cells that the area cannot have."""
        self.mapping = Mapping(parameters, briefing)
        self._scale = length_scale(briefing, parameters)
        self._flying = Flying(briefing, self._scale * parameters.arrival_radius, parameters.samples)
        self._budget = Budget(briefing)
        self._begun = False
        self.mode = "survey"
        self.declared: FloatArray | None = None  # (3,) m
        self.bits = 0.0

    def act(self, observation: Observation) -> Action:
        """Take in what is new, choose a goal where the last is reached, and fly there."""
        self.mapping.take(observation)
        self._budget.take(observation)
        x, y, z = observation.position.tolist()
        position = (x, y, z)
        self.bits = 0.0
        if not self._begun or self._flying.arrived(position):
            goal = self._next_goal(observation)
            if goal is not None:
                self._begun = True
                x, y, z = goal.tolist()
                self._flying.aim((x, y, z))
        target = self._flying.target(observation, position)
        if self._budget.ends(observation, self._flying.duration(position, target)):
            self.declared = self._verdict()
        return self._flying.command(observation, position, target)

    @abstractmethod
    def _next_goal(self, observation: Observation) -> FloatArray | None:
        """The next goal, (3,) m; None to stay with the last."""

    @abstractmethod
    def _verdict(self) -> FloatArray | None:
        """What to declare, (3,) m; None for nothing."""

    def belief(self) -> Belief:
        """The posterior of the last estimate, and the final map."""
        return self.mapping.belief()


class PeakFlight(Flight):
    """A survey, and the peak of its map."""

    def __init__(self, parameters: KernelPeak, briefing: Briefing) -> None:
        """Raises InputError for cells that the area cannot have."""
        super().__init__(parameters, briefing)
        self._all = parameters.used_cells == "all"
        self._floor = briefing.threshold if parameters.minimum_gas is None else parameters.minimum_gas
        self._survey = Survey(parameters, briefing, self.mapping.cells.size, self._scale, parameters.samples)

    def _next_goal(self, observation: Observation) -> FloatArray:
        return self._survey.next_goal()

    def _peak(self) -> FloatArray | None:
        """The middle of the cell where the map is highest, (3,) m; None where no gas was found."""
        kernel = self.mapping.kernel
        use: BoolArray = kernel.weight > 0.0 if self._all else kernel.measured
        if not gaseous(kernel.mean, self._floor, use).any():
            return None
        return np.array(self.mapping.cells.centres[int(np.argmax(np.where(use, kernel.mean, -math.inf)))])

    def _verdict(self) -> FloatArray | None:
        return self._peak()

    def belief(self) -> Belief:
        """A source somewhere in the cell of the peak, anywhere before there is one; and the final map."""
        prior, peak = self.mapping.belief(), self._peak()
        if peak is None:
            return prior
        return Belief(peak, np.diag(self.mapping.cells.size**2 / 12.0), gas_map=prior.gas_map)


class _EstimatingFlight(Flight):
    """A flight that estimates the source term, and votes."""

    def __init__(self, parameters: BoustrophedonSTE | RahbarSTE, briefing: Briefing) -> None:
        super().__init__(parameters, briefing)
        self._guesses = Guesses(parameters)
        self._goal_time = parameters.goal_time
        self._estimate_from = -math.inf  # s: not before
        self._rng = np.random.default_rng(briefing.seed)

    def _estimate(self, observation: Observation) -> bool:
        """Sample the posterior anew and note its guess, if it is time to."""
        if observation.time < self._estimate_from:
            return False
        m = self.mapping
        self.bits = m.estimate(self._rng)
        self._estimate_from = observation.time + self._goal_time
        if m.posterior is not None:
            self._guesses.take(m.guess, m.posterior.entropy, m.alpha)
        if self._guesses.recording:
            self.mode = "record"
        return True

    def _verdict(self) -> FloatArray | None:
        """The voted source, else the last guess if any gas was found, else nothing."""
        m = self.mapping
        voted = self._guesses.vote(m.bins)
        if voted is None and m.posterior is not None and m.kernel_gas.any():
            voted = m.guess
        return None if voted is None else np.clip(voted, m.cells.low, m.cells.high)


class SurveyFlight(_EstimatingFlight):
    """A survey with source term estimation."""

    def __init__(self, parameters: BoustrophedonSTE, briefing: Briefing) -> None:
        """Raises InputError for cells that the area cannot have."""
        super().__init__(parameters, briefing)
        self._survey = Survey(parameters, briefing, self.mapping.cells.size, self._scale, parameters.samples)

    def _next_goal(self, observation: Observation) -> FloatArray:
        self._estimate(observation)
        return self._survey.next_goal()


class InformedFlight(_EstimatingFlight):
    """A flight to where a reading is expected to teach most."""

    def __init__(self, parameters: RahbarSTE, briefing: Briefing) -> None:
        """Raises InputError for cells that the area cannot have."""
        super().__init__(parameters, briefing)
        self._parameters = parameters
        self._passage = Passage(briefing)
        self.mode = "explore"

    def _next_goal(self, observation: Observation) -> FloatArray | None:
        if not self._estimate(observation):
            return None
        p, m, here = self._parameters, self.mapping, observation.position
        places = around(p, here, m.cells.low, m.cells.high, self._scale)
        places = places[self._passage.free(places)]
        candidate = places[self._best(places)] if len(places) else here
        if m.posterior is None:
            return np.array(candidate)
        place = here + p.exploration * (candidate - here) + (1.0 - p.exploration) * (m.guess - here)
        return np.clip(place, m.cells.low, m.cells.high)

    def _best(self, places: FloatArray) -> int:
        """Which of the candidates (m, 3), m, is expected to teach most."""
        p, m = self._parameters, self.mapping
        nats = np.zeros(len(places))
        if m.posterior is not None:
            speed = p.source_term.minimum_speed
            nats = most_informative(p, m.posterior.chain, places, m.wind, speed, m.sigma_e)
        return choose(nats, self._rng)
