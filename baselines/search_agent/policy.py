"""One UAV flown by the agent `search`: belief, candidate goals, a scoring rule whose levers the network moves, one leg.

Before its own turn it works out what its lower-numbered mates in radio contact choose, from its own belief: the rule
is deterministic and the mates' goals come with their frames (12 bytes), so that UAVs that have heard the same readings
agree. A mate not heard for `_STALE` s is out of contact, and counts no more.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from pydantic import PrivateAttr, ValidationError

from baselines.belief.likelihood import ReadingTable
from baselines.learned.checkpoint import Checkpoint, ObservationDefinition
from baselines.learned.network import Architecture, Network
from baselines.passage import Passage
from baselines.policy import Belief, Briefing, Policy
from baselines.search_agent.candidates import N_CANDIDATES
from baselines.search_agent.crew import Crew, SearchView, definition_hash
from baselines.search_agent.levers import MACRO_BEATS, N_LEVERS, N_SITUATION
from baselines.search_agent.sight import plan_leg
from osl_env.actions import Action, Waypoint
from osl_env.errors import InputError
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, Parameters, one_line, quantity
from osl_env.radio import Message
from osl_env.streams import Purpose, generator

_STALE = 30.0  # s: a UAV not heard for so long is out of contact
_GOAL = struct.Struct("<3f")
_NUMBER_BITS = 32  # a number in single precision
_PICTURED = 400  # places of a belief for pictures


class SearchAction(Parameters):
    """What ends a search: part of a checkpoint's `action`."""

    certainty: float = quantity(0.98, "", gt=0, lt=1)  # mass within the success radius at which the mean is declared


def observation_definition(view: SearchView) -> ObservationDefinition:
    """The definition of what `view` shows, as a checkpoint's header holds it."""
    features = ({"kind": "search"} | view.model_dump(mode="json"),)
    return ObservationDefinition(features=features, size=N_SITUATION, hash=definition_hash(view))


@dataclass(frozen=True, eq=False)
class SearchBrain:
    """What all pilots of one checkpoint share."""

    where: str  # for messages
    network: Network
    view: SearchView
    action: SearchAction
    max_uavs: int

    @classmethod
    def of(cls, checkpoint: Checkpoint) -> SearchBrain:
        """The brain of a `search` checkpoint. Raises InputError in one line."""
        header = checkpoint.header
        where = f"checkpoint {header.name}"
        try:
            (feature,) = header.observation.features
            view = SearchView.model_validate({key: value for key, value in feature.items() if key != "kind"})
            action = SearchAction.model_validate(header.action)
        except ValidationError as error:
            raise one_line(error, where) from None
        except ValueError:
            raise InputError(f"{where}: observation.features: must be one feature of kind 'search'") from None
        if definition_hash(view) != header.observation.hash:
            raise InputError(
                f"{where}: was trained on another definition of its observation (hash {header.observation.hash!r}, "
                f"here {definition_hash(view)!r}): train it anew"
            )
        network = Network(Architecture.parse(header.architecture, where), checkpoint.arrays, where)
        shape = network.architecture
        if (shape.inputs, shape.outputs, shape.head) != (N_SITUATION, N_LEVERS, "gaussian") or network.state_size:
            raise InputError(
                f"{where}: architecture: the agent 'search' needs {N_SITUATION} inputs and {N_LEVERS} gaussian outputs "
                f"without memory, not {shape.inputs} and {shape.outputs} {shape.head}"
            )
        return cls(where, network, view, action, header.max_uavs)

    def __deepcopy__(self, memo: dict[int, Any]) -> SearchBrain:
        return self


class _Flight:
    """One UAV's state of an episode."""

    def __init__(self, brain: SearchBrain, briefing: Briefing) -> None:
        self.brain, self.uav = brain, briefing.uav
        self.crew = Crew(brain.view, briefing)
        starts = np.tile(np.asarray(briefing.start, dtype=np.float64), (1, briefing.n_uavs, 1))
        self.crew.reset(np.array([0]), starts)
        self.crew.mates["known"] = False
        self.crew.mates["known"][0, briefing.uav] = True
        self.heard_at = np.full(briefing.n_uavs, -np.inf)  # s, mission clock
        self.readings, self.passage = ReadingTable(), Passage(briefing)
        self.rng = generator(briefing.seed, Purpose.POLICY)
        self.beats = 0  # since the take-off
        self.declared: FloatArray | None = None
        self.bits = 0.0

    def listen(self, observation: Observation, inbox: Sequence[Message]) -> None:
        """Take in the own reading and all that was heard; a new beat begins."""
        crew, mates = self.crew, self.crew.mates[0]
        positions = mates["position"].copy()
        positions[self.uav] = observation.position
        for message in inbox:
            positions[message.sender] = message.position
            self.heard_at[message.sender] = message.time
        newcomers = ~mates["known"] & (self.heard_at > -np.inf)
        mates["position"][newcomers] = positions[newcomers]  # where it flew before it was heard is not known
        crew.fly(positions[None])
        for message in inbox:
            told = len(message.payload) == _GOAL.size
            mates["goal"][message.sender] = _GOAL.unpack(message.payload) if told else message.position
        mates["known"] = observation.time - self.heard_at <= _STALE
        mates["known"][self.uav] = True
        rows = self.readings.gather(observation, inbox)
        order = np.argsort([self.uav, *(message.sender for message in inbox)], kind="stable")
        rows = rows[order]  # the same order for all: the same readings make the same belief, to the last bit
        crew.measure_wind(observation.wind[None])
        positions, hits, seconds = (np.ascontiguousarray(part[None]) for part in (rows[:, :3], rows[:, 3], rows[:, 4]))
        crew.take(positions, hits, seconds, np.array([observation.time]))
        self.declared = crew.situations["mean"][0].copy() if crew.certain(self.brain.action.certainty)[0] else None
        self.bits = float(_NUMBER_BITS * crew.belief.n_cells * len(rows))

    def decide(self, *, learned: bool, stochastic: bool) -> Action:
        """Move the levers if it is time, let the mates before this UAV choose, then choose."""
        crew, brain = self.crew, self.brain
        if learned and self.beats % MACRO_BEATS == 0:
            network, situation = brain.network, crew.describe()
            state = network.start()
            levers, _ = network.drawn(situation, state, [self.rng]) if stochastic else network.greedy(situation, state)
            crew.set_levers(levers)
            self.bits += float(_NUMBER_BITS * network.n_parameters)
        self.beats += 1
        for uav in np.flatnonzero(crew.mates["known"][0]).tolist():
            if uav <= self.uav:
                crew.decide(uav)
                self.bits += float(_NUMBER_BITS * N_CANDIDATES * brain.view.places)
        own = crew.mates[0, self.uav]
        if self.passage.obstructed:
            self._go_around(own)
        return Waypoint(own["place"].copy(), max(round(float(own["seconds"] / crew.settings["sample"][0])), 1))

    def _go_around(self, own: Any) -> None:
        """Let the planned leg go towards the first place on the way to the goal, if an obstacle is in the way."""
        crew, position = self.crew, own["position"].copy()
        via = self.passage.towards(position, own["goal"].copy())
        samples, _ = plan_leg(position, own["heading"], via, crew.settings[0], own["place"])
        own["seconds"] = samples * crew.settings["sample"][0]


class SearchPilot(Policy):
    """Flies one UAV with a SearchBrain; made by `pilot`, and not registered itself."""

    name: ClassVar[str] = "search-pilot"

    stochastic: bool = False  # draw the levers from the network's distribution, instead of its mean
    learned: bool = True  # False: all levers at 0

    _brain: SearchBrain = PrivateAttr()
    _flight: _Flight | None = PrivateAttr(default=None)

    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`. Raises InputError if the network must not fly it."""
        if briefing.n_uavs > self._brain.max_uavs:
            raise InputError(
                f"{self._brain.where}: knows teams of at most {self._brain.max_uavs} UAVs, the scenario has "
                f"{briefing.n_uavs}"
            )
        self._flight = _Flight(self._brain, briefing)

    def _present(self) -> _Flight:
        if self._flight is None:
            raise RuntimeError(f"{self._brain.where}: reset(briefing) comes before the first decision")
        return self._flight

    def broadcast(self, observation: Observation) -> bytes | None:
        """The present goal: 3 single-precision numbers."""
        flight = self._present()
        return _GOAL.pack(*flight.crew.mates["goal"][0, flight.uav].tolist())

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """Update on everything new and fly a leg."""
        flight = self._present()
        flight.listen(observation, inbox)
        return flight.decide(learned=self.learned, stochastic=self.stochastic)

    def belief(self) -> Belief | None:
        """The grid belief's moments, and its support for pictures."""
        flight = self._present()
        situation = flight.crew.situations[0]
        return Belief(situation["mean"].copy(), situation["covariance"].copy(), flight.crew.support(0))

    def declaration(self) -> FloatArray | None:
        """The belief's mean, (3,) m, once it is certain enough."""
        return self._flight.declared if self._flight else None

    @property
    def computed_bits(self) -> float:
        """Bits of the cells for every reading, of the places for every turn worked out, of the network's weights."""
        return self._flight.bits if self._flight else 0.0


def pilot(checkpoint: Checkpoint, stochastic: bool) -> SearchPilot:
    """The pilot that flies `checkpoint`. Raises InputError in one line if it does not fit this version."""
    made = SearchPilot(stochastic=stochastic)
    made._brain = SearchBrain.of(checkpoint)
    return made
