"""The one interface of all policies, scripted or learned: a policy is one UAV's controller.

It knows its Briefing (what was told before take-off), its Observations and what the radio brings, and nothing else:
it never sees the world. Two beats make a decision: `broadcast(observation)`, then `act(observation, inbox)`; then the
runner asks for a `declaration()`. Policies are made by name (`make_policy`), copied for each UAV and reset for each
episode.

Third parties register a policy class under the entry point group `osl_env.policies`.
"""

from __future__ import annotations

import difflib
import importlib
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
from pydantic import ValidationError

from osl_env.actions import Action
from osl_env.arena import Arena
from osl_env.configuration import config_folder
from osl_env.errors import InputError
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, Parameters, one_line
from osl_env.radio import Message, Radio
from osl_env.scenario import Scenario
from osl_env.sensors import RangeSensors
from osl_env.streams import policy_seed

Command: TypeAlias = Literal["leg", "velocity", "setpoint"]


def _kind_of(action: str) -> Command:
    """What a scenario's action asks of a policy: hops and way points are legs."""
    return "velocity" if action == "velocity" else "setpoint" if action == "setpoint" else "leg"


@dataclass(frozen=True, slots=True)
class Briefing:
    """What one UAV is told before take-off. Models are the advertised ones: the truth may differ (`advertised`)."""

    uav: int  # this UAV's number, 0 .. n_uavs - 1
    n_uavs: int
    seed: int  # for the policy's own draws
    start: FloatArray  # (3,) m
    area: FloatArray  # (3,) m: the search volume is [0, Lx] x [0, Ly] x [0, Lz]
    arena: Arena  # the map, obstacles included: the team has it
    action: Command  # what the policy's actions must be in this scenario
    decision_period: float  # s, the shortest time between two decisions: of a velocity or setpoint, else one sample
    lookahead: float  # m: a setpoint farther away is flown to at full speed, and no faster
    planar: bool  # a robot on the ground: nothing vertical in what it is told counts
    step_length: float  # m, grid step of a hop
    hop_lengths: int  # the longest hop, in grid steps (the area's l_max)
    speed: float  # m/s, cruise
    hover_time: float  # s a sample
    turn_time: float  # s a turn
    max_samples: int  # the most samples of one leg
    plume: Any  # advertised PlumeModel (HitRatePlume for hits)
    gas_sensor: Any  # advertised sensor
    range_sensors: RangeSensors  # `count` rays, horizontal, evenly spread, the first along +x; 0: none
    radio: Radio
    energy_capacity: float  # J
    time_limit: float  # s of search time
    max_decisions: int  # kmax
    declares: bool  # the source must be declared; else it is enough to come within the success radius
    success_radius: float  # m: a declared position (or a UAV) this near to a source is right
    n_sources: int

    @property
    def threshold(self) -> float:
        """A reading above it is a detection: 0 hits, or the sensor's threshold in the plume's unit."""
        return 0.0 if self.gas_sensor.reports == "hits" else float(self.gas_sensor.threshold)

    @classmethod
    def of(cls, scenario: Scenario, uav: int, seed: int, start: FloatArray) -> Briefing:
        """The briefing of UAV `uav` that starts at `start` in the episode with `seed` of `scenario`."""
        vehicle = scenario.vehicle
        return cls(
            uav=uav,
            n_uavs=scenario.team.n_uavs,
            seed=policy_seed(seed, uav),
            start=np.array(start, dtype=np.float64),
            area=np.array(scenario.arena.size, dtype=np.float64),
            arena=scenario.arena,
            action=_kind_of(scenario.action),
            decision_period=scenario.decision_time,
            lookahead=vehicle.lookahead,
            planar=vehicle.is_planar,
            step_length=vehicle.step_length,
            hop_lengths=vehicle.hop_lengths,
            speed=vehicle.speed,
            hover_time=vehicle.hover_time,
            turn_time=vehicle.turn_time,
            max_samples=vehicle.max_samples,
            plume=scenario.advertised_plume or scenario.plume,
            gas_sensor=scenario.gas_sensor,
            range_sensors=scenario.range_sensors,
            radio=scenario.radio,
            energy_capacity=scenario.energy.capacity,
            time_limit=scenario.ending.time_limit,
            max_decisions=scenario.ending.max_decisions,
            declares=scenario.ending.success == "declare",
            success_radius=scenario.ending.success_radius,
            n_sources=scenario.sources.count,
        )


@dataclass(frozen=True, slots=True)
class GasMap:
    """Mean concentrations on a grid of cells."""

    low: FloatArray  # (3,) m, the grid's low corner
    spacing: FloatArray  # (3,) m, sides of a cell
    values: FloatArray  # (nx, ny, nz), in the sensor's unit


@dataclass(frozen=True, slots=True)
class Belief:
    """What a policy believes about the source and the gas, for metrics and pictures."""

    mean: FloatArray  # (3,) m
    covariance: FloatArray  # (3, 3) m^2
    particles: FloatArray | None = None  # (n, 3) m
    weights: FloatArray | None = None  # (n,), sum 1
    gas_map: GasMap | None = None


class Policy(Parameters):
    """Base of the policies: frozen parameters (fields) beside private episode state, and the defaults.

    A subclass declares its parameters as fields and its state as private attributes (leading underscore) that `reset`
    sets. `name` is its registered name; `vehicle_commands` says in order of preference what it can command: legs,
    velocities, setpoints. The first that the scenario's vehicle can fly is flown (`Briefing.action`).
    """

    name: ClassVar[str]
    summary: ClassVar[str] = ""  # one line for `osl list`
    vehicle_commands: ClassVar[tuple[Command, ...]] = ("leg",)
    plume_quantities: ClassVar[tuple[str, ...]] = ("hit_rate",)  # the kinds of reading that it understands

    @abstractmethod
    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`; forgets everything of the one before."""

    def broadcast(self, observation: Observation) -> bytes | None:
        """The payload of this decision's radio frame; None for none (position and reading are always sent)."""
        return None

    @abstractmethod
    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """The command for the next leg or period, given the frames heard since the last decision."""

    @classmethod
    def act_batch(
        cls, pilots: Sequence[Policy], observations: Sequence[Observation], inboxes: Sequence[Sequence[Message]]
    ) -> list[Action]:
        """`act` of every copy of one policy that decides now; a network overrides this to decide in one pass.

        The actions must be those that `act` gives one at a time, bit for bit: an episode does not depend on its batch.
        """
        return [pilot.act(seen, inbox) for pilot, seen, inbox in zip(pilots, observations, inboxes, strict=True)]

    def belief(self) -> Belief | None:
        """The present belief about the source, if the policy holds one."""
        return None

    def declaration(self) -> FloatArray | None:
        """(3,) m, once the policy declares that the source is there; asked after each `act`."""
        return None

    @property
    def mode(self) -> str:
        """What the policy is doing at present, in a word, if it works in phases; for pictures and records."""
        return ""

    @property
    def computed_bits(self) -> float:
        """Bits processed at the last decision (N_c of MUC-OSL eq 7)."""
        return 0.0


# name -> module that registers it, imported when first asked for: `osl list` need not compile anything
_MODULES: dict[str, str] = {
    "muc-osl": "baselines.muc_osl.policies",
    "col-inf": "baselines.muc_osl.policies",
    "col-pf": "baselines.muc_osl.policies",
    "adap-pp": "baselines.muc_osl.policies",
    "col-inf-roughened": "baselines.muc_osl.policies",
    "adap-pp-roughened": "baselines.muc_osl.policies",
    "infotaxis": "baselines.infotaxis",
    "space-aware-infotaxis": "baselines.infotaxis",
    "team-infotaxis": "baselines.team_infotaxis",
    "random-walk": "baselines.random_walk",
    "lawnmower": "baselines.lawnmower",
    "surge-cast": "baselines.surge_cast",
    "chemotaxis": "baselines.chemotaxis.policy",
    "gaslam": "baselines.gaslam.policy",
    "kernel-peak": "baselines.gaslam.rivals",
    "boustrophedon-ste": "baselines.gaslam.rivals",
    "rahbar-ste": "baselines.gaslam.rivals",
    "swarm": "baselines.swarm.policy",
    "plume-finding": "baselines.swarm.policy",
    "spiral-surge": "baselines.spiral_surge",
    "biased-random-walk": "baselines.biased_random_walk",
    "moth": "baselines.moth",
    "biasing-expansion": "baselines.biasing_expansion",
    "particle-swarm": "baselines.particle_swarm",
    "glowworm": "baselines.glowworm",
    "fluxotaxis": "baselines.fluxotaxis",
    "entrotaxis": "baselines.cognitive",
    "infotaxis-renyi": "baselines.cognitive",
    "infotaxis-bhattacharyya": "baselines.cognitive",
    "checkpoint": "baselines.learned.policies",
}
SHIPPED_CHECKPOINTS = ("rppo-raw", "ppo-belief")  # learned; known where their checkpoint is there
_MODULES |= {
    name: "baselines.learned.policies"
    for name in SHIPPED_CHECKPOINTS
    if (config_folder() / "checkpoints" / name / "checkpoint.yaml").is_file()
}
_REGISTRY: dict[str, type[Policy]] = {}


def register_policy(policy: type[Policy]) -> type[Policy]:
    """Class decorator: make `policy` known under its `name`."""
    _REGISTRY[policy.name] = policy
    return policy


def _plugins() -> dict[str, Any]:
    return {entry.name: entry for entry in entry_points(group="osl_env.policies")}


def policy_names() -> list[str]:
    """The names that `make_policy` takes, installed third-party ones included."""
    return sorted({*_MODULES, *_REGISTRY, *_plugins()})


def policy_class(name: str) -> type[Policy]:
    """The class registered under `name`. Raises InputError for an unknown name."""
    if name in _MODULES:
        importlib.import_module(_MODULES[name])
    elif name not in _REGISTRY and name in (plugins := _plugins()):
        _REGISTRY[name] = plugins[name].load()
    if name not in _REGISTRY:
        near = difflib.get_close_matches(name, policy_names(), n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise InputError(f"unknown policy {name!r}: {hint}allowed are {', '.join(policy_names())}")
    return _REGISTRY[name]


def make_policy(name: str, **parameters: Any) -> Policy:
    """The policy registered under `name` with `parameters` in place of its defaults.

    `NAME*3+NAME` is a mixed team (`baselines.mixed`), whose parameters begin with a member's name: `swarm.k1`.
    Raises InputError for an unknown name or parameter, or a value out of its limits.
    """
    if "+" in name or "*" in name:
        from baselines.mixed import members_of, mixed_team  # which builds on this module

        return mixed_team(name, members_of(name), parameters)
    try:
        return policy_class(name)(**parameters)
    except ValidationError as error:
        raise one_line(error, f"policy {name}") from None
