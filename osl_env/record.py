"""What is kept of one episode: outcome, times, counts, energy and radio traffic, in SI units and plain Python values.

The fields follow the papers' metrics. MUC-OSL's search time of a UAV is its own flying + hovering + turning time;
waiting for slower team mates is not part of it, so the mission clock is kept beside it. A failed episode's search time
is the time limit: the mean of `search_time` is the capped mean search time (capped MST), and its mean over the
successes the paper's MST.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, fields
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from osl_env.errors import InputError
from osl_env.state import DIVERGED, ENERGY_KINDS, FALSE_DECLARATION, LEFT, LOST, SUCCESS

if TYPE_CHECKING:
    from osl_env.world import World

Ending = Literal[
    "success", "false_declaration", "time", "battery", "decisions", "collision", "out_of_bounds", "diverged", "lost"
]


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeRecord:
    """One episode of one policy in one scenario. NaN stands for "did not happen".

    `EpisodeRecord.of` reads all but `parameters` and `decision_seconds` from a World; the runner adds these two.
    """

    # what was run
    scenario: str
    scenario_hash: str
    policy: str
    parameters: dict[str, Any] = field(default_factory=dict)  # the policy's, by name
    seed: int
    n_uavs: int
    clock: str  # "barrier" or "event"
    success_rule: str  # "declare" or "reach"
    time_limit: float  # s of a UAV's search time

    # how it ended
    success: bool
    false_declaration: bool
    ended: Ending
    winner: int  # the UAV that declared or reached the source, right or wrong; -1 none
    declaration_error: float  # m, from the declared position to the nearest source; NaN without a declaration
    search_time: float  # s, the winner's flying + hovering + turning time; the time limit if the episode failed
    mission_time: float  # s on the mission clock
    first_detection_time: float  # s on the mission clock; NaN without a detection
    detections: int  # of the team: samples with at least one hit

    # work done; team sums unless stated
    decisions: int  # the winner's, or the most of any UAV
    path: float  # m, the winner's flown distance, or the mean over the UAVs
    team_path: float  # m
    n_flights: int
    n_hovers: int
    n_turns: int
    collisions: int  # legs or periods that ran into an obstacle
    flying_time: float  # s
    hovering_time: float  # s
    turning_time: float  # s
    waiting_time: float  # s, of those that were done before the slowest

    # MUC-OSL eqs 4 to 9, J, team sums
    energy_flying: float
    energy_hovering: float
    energy_turning: float
    energy_waiting: float
    energy_computing: float
    energy_communicating: float
    messages: int  # radio frames sent
    bytes: int  # sent

    reward: float  # team mean of the undiscounted sum
    decision_seconds: float = field(default=math.nan, compare=False)  # s of wall time a decision; not reproducible

    @property
    def energy(self) -> float:
        """J, all kinds together, of the team (E of MUC-OSL eq 9)."""
        return (
            self.energy_flying
            + self.energy_hovering
            + self.energy_turning
            + self.energy_waiting
            + self.energy_computing
            + self.energy_communicating
        )

    @classmethod
    def of(cls, world: World, env: int, policy: str) -> EpisodeRecord:
        """The record of the finished episode of world `env`, flown by `policy` (a name)."""
        scenario, episode, ledger = world.scenario, world.episode[env], world.ledger[env]
        winner, success = int(episode["winner"]), bool(episode["outcome"] == SUCCESS)
        energy = dict(zip(ENERGY_KINDS, ledger["energy"].sum(axis=0).tolist(), strict=True))
        return cls(
            scenario=scenario.name,
            scenario_hash=scenario.hash,
            policy=policy,
            seed=int(episode["seed"]),
            n_uavs=world.n_uavs,
            clock=scenario.clock,
            success_rule=scenario.ending.success,
            time_limit=scenario.ending.time_limit,
            success=success,
            false_declaration=bool(episode["outcome"] == FALSE_DECLARATION),
            ended=_ending(world, env),
            winner=winner,
            declaration_error=float(episode["declaration_error"]),
            search_time=float(episode["search_time"]) if success else scenario.ending.time_limit,
            mission_time=float(episode["clock"]),
            first_detection_time=float(np.fmin.reduce(world.senses["first_detection_time"][env])),
            detections=int(world.senses["detections"][env].sum()),
            decisions=int(ledger["decisions"][winner] if winner >= 0 else ledger["decisions"].max()),
            path=float(ledger["path"][winner] if winner >= 0 else ledger["path"].mean()),
            team_path=float(ledger["path"].sum()),
            n_flights=int(ledger["flights"].sum()),
            n_hovers=int(ledger["hovers"].sum()),
            n_turns=int(ledger["turns"].sum()),
            collisions=int(ledger["collisions"].sum()),
            flying_time=float(ledger["flying_time"].sum()),
            hovering_time=float(ledger["hovering_time"].sum()),
            turning_time=float(ledger["turning_time"].sum()),
            waiting_time=float(ledger["waiting_time"].sum()),
            **{f"energy_{kind}": joule for kind, joule in energy.items()},
            messages=int(ledger["messages"].sum()),
            bytes=int(ledger["bytes"].sum()),
            reward=float(ledger["total_reward"].mean()),
        )

    def to_dict(self) -> dict[str, Any]:
        """The fields as JSON values: NaN becomes None."""
        return {key: None if _is_nan(value) else value for key, value in asdict(self).items()}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> EpisodeRecord:
        """The record that `to_dict` wrote. Raises InputError if a field is missing, unknown or of the wrong kind."""
        kinds = {entry.name: entry for entry in fields(cls)}
        if unknown := sorted(set(values) - set(kinds)):
            raise InputError(f"episode record: unknown field {unknown[0]!r}")
        if missing := sorted(set(kinds) - set(values)):
            raise InputError(f"episode record: field {missing[0]!r} is missing")
        restored: dict[str, Any] = {key: math.nan if value is None else value for key, value in values.items()}
        for key, value in restored.items():
            if kinds[key].type == "float" and not isinstance(value, int | float):
                raise InputError(f"episode record: {key} = {value!r} is not a number")
        return cls(**restored)


def _ending(world: World, env: int) -> Ending:
    """Why the episode is over. If the UAVs stopped for different reasons: time before decisions before a battery before
    what else ends a flight; "lost" only if a fault has ended them all.
    """
    outcome, ending = world.episode["outcome"][env], world.scenario.ending
    if outcome == SUCCESS:
        return "success"
    if outcome == FALSE_DECLARATION:
        return "false_declaration"
    ledger, motion = world.ledger[env], world.motion[env]
    search_time = ledger["flying_time"] + ledger["hovering_time"] + ledger["turning_time"]
    if np.any(motion["truncated"] & (search_time >= ending.time_limit)):
        return "time"
    if np.any(motion["truncated"]):
        return "decisions"
    if np.any(motion["exhausted"]):
        return "battery"
    fates = motion["fate"]
    if np.all(fates == LOST):
        return "lost"
    return "diverged" if np.any(fates == DIVERGED) else "out_of_bounds" if np.any(fates == LEFT) else "collision"


def _is_nan(value: object) -> bool:
    return isinstance(value, float) and math.isnan(value)
