"""One UAV flown by a network: features in, action out, as in training.

The numbers that the network gives are translated by `osl_env.agent_actions`, which the training environments use too.
No action is ruled out: a hop that would leave the area is shortened to the longest one inside, and hovers if there is
none, as the environments do it. Pilots of one policy decide together, in one forward pass; a row of it does not depend
on the others, so that the actions are those of deciding one at a time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol

import numpy as np
from pydantic import PrivateAttr, ValidationError

from baselines.features import FeatureSpec, SoloFeatures, make_spec, spec_hash, spec_size
from baselines.learned.checkpoint import Checkpoint, ObservationDefinition
from baselines.learned.course import Course, WindFrame
from baselines.learned.dense import Float32Array
from baselines.learned.network import Architecture, Network
from baselines.policy import Briefing, Command, Policy
from osl_env.actions import Action, Hop, Hover, Setpoint, Velocity, Waypoint
from osl_env.agent_actions import (
    BOX_SIZES,
    box_declares,
    box_setpoints,
    box_velocities,
    box_waypoints,
    hover_action,
    n_hop_actions,
)
from osl_env.errors import InputError
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, Parameters, one_line, quantity
from osl_env.radio import Message
from osl_env.streams import Purpose, generator
from osl_env.vehicles.legs import hop_inside, hop_offsets

_WEIGHT_BITS = 32  # one weight in single precision
_PARTICLE_BITS = 4 * 32  # position and weight of one particle in single precision


class Vehicle(Protocol):
    """What a scenario's vehicle and a briefing both tell about legs."""

    @property
    def step_length(self) -> float: ...
    @property
    def hop_lengths(self) -> int: ...
    @property
    def max_samples(self) -> int: ...


class ActionDefinition(Parameters):
    """What a network's outputs mean: it changes with these numbers. None: not used by this kind of agent."""

    step_length: float | None = quantity(None, "m", gt=0)
    hop_lengths: int | None = quantity(None, "", ge=1)
    max_samples: int | None = quantity(None, "", ge=1)
    course: Course | None = None

    @classmethod
    def of(cls, agent: str, vehicle: Vehicle) -> ActionDefinition:
        """The definition for `agent` with a scenario's `vehicle`, or with a Briefing."""
        if agent == "hop":
            return cls(step_length=vehicle.step_length, hop_lengths=vehicle.hop_lengths)
        if agent == "waypoint":
            return cls(max_samples=vehicle.max_samples)
        return cls()

    @classmethod
    def parse(cls, content: Mapping[str, Any], where: str) -> ActionDefinition:
        """The definition that the mapping `content` says. Raises InputError naming `where`."""
        try:
            return cls.model_validate(dict(content))
        except ValidationError as error:
            raise one_line(error, f"{where}: action") from None

    def as_mapping(self) -> dict[str, Any]:
        """As a checkpoint's header holds it."""
        return self.model_dump(mode="json", exclude_none=True)

    def check(self, agent: str, vehicle: Vehicle, where: str) -> None:
        """Raise InputError naming `where` if the outputs would mean something else with `vehicle`."""
        for name, here in ActionDefinition.of(agent, vehicle).as_mapping().items():
            trained = getattr(self, name)
            if trained is not None and trained != here:
                raise InputError(f"{where}: was trained with {name} = {trained:g}, the scenario has {name} = {here:g}")


class Flown(Protocol):
    """What a pilot needs of a network (see `Network`)."""

    @property
    def architecture(self) -> Architecture: ...
    @property
    def n_parameters(self) -> int: ...
    @property
    def has_distribution(self) -> bool: ...
    def start(self, n: int = 1) -> Float32Array: ...
    def greedy(self, inputs: Float32Array, state: Float32Array) -> tuple[Any, Float32Array]: ...
    def drawn(
        self, inputs: Float32Array, state: Float32Array, rngs: list[np.random.Generator]
    ) -> tuple[Any, Float32Array]: ...


def observation_of(spec: FeatureSpec) -> ObservationDefinition:
    """The definition of `spec` as a checkpoint's header holds it."""
    features = tuple(feature.model_dump(mode="json") for feature in spec)
    return ObservationDefinition(features=features, size=spec_size(spec), hash=spec_hash(spec))


@dataclass(frozen=True, eq=False)
class Brain:
    """What all pilots of one policy share: the network and the meaning of what goes in and out."""

    where: str  # for messages
    agent: Literal["hop", "waypoint", "velocity", "setpoint", "course"]
    network: Flown
    spec: FeatureSpec
    action: ActionDefinition
    max_uavs: int

    @classmethod
    def of(cls, checkpoint: Checkpoint) -> Brain:
        """The brain of a checkpoint of any kind of agent but `search`. Raises InputError in one line."""
        header = checkpoint.header
        if header.agent == "search":
            raise InputError(f"checkpoint {header.name}: agent = 'search' is flown by another pilot")
        where = f"checkpoint {header.name}"
        spec = make_spec(list(header.observation.features), f"{where}: observation.features")
        if spec_hash(spec) != header.observation.hash:
            raise InputError(
                f"{where}: was trained on another definition of its observation (hash {header.observation.hash!r}, "
                f"here {spec_hash(spec)!r}): train it anew"
            )
        network = Network(Architecture.parse(header.architecture, where), checkpoint.arrays, where)
        action = ActionDefinition.parse(header.action, where)
        return cls(where, header.agent, network, spec, action, header.max_uavs).checked()

    def checked(self) -> Brain:
        """This brain. Raises InputError if network, features and actions do not fit each other."""
        architecture = self.network.architecture
        if architecture.inputs != spec_size(self.spec):
            raise InputError(
                f"{self.where}: the network takes {architecture.inputs} numbers, its observation has "
                f"{spec_size(self.spec)}"
            )
        if self.agent == "course":
            outputs = self.course.n_actions
        else:
            outputs = n_hop_actions(self.action.hop_lengths or 1) if self.agent == "hop" else BOX_SIZES[self.agent]
        discrete = self.agent in ("hop", "course")
        if architecture.outputs != outputs or (architecture.head in ("logits", "values")) != discrete:
            raise InputError(
                f"{self.where}: agent = {self.agent!r} needs {outputs} outputs, the network has {architecture.outputs} "
                f"({architecture.head})"
            )
        return self

    @property
    def course(self) -> Course:
        """Of the agent `course`. Raises InputError if the checkpoint does not say it."""
        if self.action.course is None:
            raise InputError(f"{self.where}: action: agent = 'course' needs the key course")
        return self.action.course

    def __deepcopy__(self, memo: dict[int, Any]) -> Brain:
        return self

    def check_fit(self, briefing: Briefing) -> None:
        """Raise InputError if this network must not fly what `briefing` says."""
        if briefing.n_uavs > self.max_uavs:
            raise InputError(
                f"{self.where}: knows teams of at most {self.max_uavs} UAVs, the scenario has {briefing.n_uavs}"
            )
        self.action.check(self.agent, briefing, self.where)


class _Flight:
    """One UAV's state of an episode."""

    __slots__ = ("area", "bits", "briefing", "declared", "features", "offsets", "rng", "state")

    def __init__(self, brain: Brain, briefing: Briefing) -> None:
        self.briefing = briefing
        self.features = SoloFeatures(brain.spec, briefing)
        self.state = brain.network.start()
        self.rng = generator(briefing.seed, Purpose.POLICY)
        self.declared: FloatArray | None = None
        self.area = np.array(briefing.area, dtype=np.float64)
        self.offsets = hop_offsets(briefing.step_length, briefing.hop_lengths)
        self.bits = 0.0


class Pilot(Policy):
    """Flies one UAV with a Brain; made by `LearnedPolicy` and `Sb3Policy`, and not registered itself."""

    name: ClassVar[str] = "pilot"

    stochastic: bool = False  # draw actions from the network's distribution, instead of the most probable

    _brain: Brain = PrivateAttr()
    _flight: _Flight | None = PrivateAttr(default=None)

    @classmethod
    def of(cls, brain: Brain, stochastic: bool) -> Pilot:
        """A pilot with `brain`. Raises InputError for `stochastic` where the network gives no distribution."""
        if stochastic and not brain.network.has_distribution:
            raise InputError(f"{brain.where}: stochastic: the network gives values, not a distribution to draw from")
        pilot = cls(stochastic=stochastic)
        pilot._brain = brain
        return pilot

    @property
    def vehicle_commands(self) -> tuple[Command, ...]:  # type: ignore[override]  # by the network's actions
        """The one kind of command that it gives: legs, velocities or setpoints."""
        agent = self._brain.agent
        return (agent,) if agent in ("velocity", "setpoint") else ("leg",)

    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`. Raises InputError if the network must not fly it."""
        self._brain.check_fit(briefing)
        self._flight = _Flight(self._brain, briefing)

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """The network's action."""
        return self.act_batch([self], [observation], [inbox])[0]

    @classmethod
    def act_batch(
        cls, pilots: Sequence[Policy], observations: Sequence[Observation], inboxes: Sequence[Sequence[Message]]
    ) -> list[Action]:
        """The actions of pilots of the same policy, in one forward pass."""
        crew = [pilot for pilot in pilots if isinstance(pilot, Pilot)]
        flights = [pilot._present() for pilot in crew]
        brain, stochastic = crew[0]._brain, crew[0].stochastic
        turns = list(zip(flights, observations, inboxes, strict=True))
        rows = np.stack([flight.features.update(observation, inbox) for flight, observation, inbox in turns])
        if brain.agent == "course":
            rows = WindFrame(brain.spec).turned(rows)
        state: Float32Array = np.concatenate([flight.state for flight in flights])
        if stochastic:
            actions, state = brain.network.drawn(rows, state, [flight.rng for flight in flights])
        else:
            actions, state = brain.network.greedy(rows, state)
        heard = [1 + len(inbox) for inbox in inboxes]
        for row, flight in enumerate(flights):
            flight.state = state[row : row + 1]
            flight.bits = _bits(brain, heard[row])
        return [_command(brain, flight, seen, actions[row]) for row, (flight, seen, _) in enumerate(turns)]

    def _present(self) -> _Flight:
        if self._flight is None:
            raise RuntimeError(f"{self._brain.where}: reset(briefing) comes before the first decision")
        return self._flight

    def declaration(self) -> FloatArray | None:
        """(3,) m, the UAV's own place, if the last action declares."""
        return self._flight.declared if self._flight else None

    @property
    def computed_bits(self) -> float:
        """Bits of the weights gone through once, and of a belief's particles once for each reading (eq 7's N_c)."""
        return self._flight.bits if self._flight else 0.0


def _bits(brain: Brain, n_readings: int) -> float:
    particles = sum(getattr(feature, "particles", 0) for feature in brain.spec)
    return float(_WEIGHT_BITS * brain.network.n_parameters + _PARTICLE_BITS * particles * n_readings)


def _command(brain: Brain, flight: _Flight, observation: Observation, action: Any) -> Action:
    """The command that the network's `action` means, and the declaration that goes with it."""
    position, told = observation.position, flight.briefing
    if brain.agent == "hop":
        lengths = brain.action.hop_lengths or 1
        hover = hover_action(lengths)
        flight.declared = position.copy() if action > hover else None
        hop = hop_inside(position, flight.area, flight.offsets, int(action), lengths, hover)
        return Hover(1) if hop >= hover else Hop(hop // lengths, hop % lengths + 1)
    if brain.agent == "course":
        state = position[None], observation.wind[None], np.array([observation.reading])
        values = brain.course.boxes(np.array([action]), *state, flight.area, told.max_samples)[0]
    else:
        values = np.asarray(action, dtype=np.float64)
    flight.declared = position.copy() if box_declares(values) else None
    if brain.agent == "velocity":
        return Velocity(box_velocities(values, told.speed))
    if brain.agent == "setpoint":
        return Setpoint(box_setpoints(values, position, told.lookahead))
    target, samples = box_waypoints(values, flight.area, told.max_samples)
    return Waypoint(target, int(samples))
