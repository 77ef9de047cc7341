"""The loop that flies policies through a batch of episodes, and makes their records.

A batch is one World, and one policy object for each UAV. The loop: every UAV that decides now broadcasts, the radio
delivers, it acts, and it may declare; then all worlds step at once. An episode is a function of (scenario, policy,
parameters, seed) alone: the size of the batch changes nothing but the wall time.
"""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from baselines import Briefing, Policy
from osl_env.actions import HOP_DIRECTIONS, Action, Hop, Hover, Setpoint, Velocity, Waypoint
from osl_env.errors import InputError
from osl_env.observation import Observation
from osl_env.parameters import FloatArray
from osl_env.radio import Message
from osl_env.record import EpisodeRecord
from osl_env.scenario import Scenario
from osl_env.world import World
from training.store import parameters_of


class Turn(NamedTuple):
    """One UAV that decides now."""

    env: int
    uav: int
    policy: Policy
    observation: Observation
    inbox: Sequence[Message] = ()


@dataclass
class Flight:
    """A batch of finished episodes: the worlds as they ended and each UAV's policy, [env][uav]."""

    world: World
    team: list[list[Policy]]
    decision_seconds: FloatArray  # (n_envs,) s of wall time a decision


def decide(turns: Sequence[Turn]) -> list[Action]:
    """The actions of all UAVs that decide now, over all worlds: a batched policy decides at once for all its copies."""
    pilots = [turn.policy for turn in turns]
    return type(pilots[0]).act_batch(pilots, [turn.observation for turn in turns], [turn.inbox for turn in turns])


def run_batch(policy: Policy, scenario: Scenario, seeds: Sequence[int]) -> list[EpisodeRecord]:
    """One episode of `scenario` for each of `seeds`, side by side. Raises InputError for an invalid action."""
    flight = fly(policy, scenario, seeds)
    parameters = parameters_of(policy)
    return [
        replace(
            EpisodeRecord.of(flight.world, env, policy.name),
            scenario_hash=scenario.hash,
            parameters=parameters,
            decision_seconds=float(flight.decision_seconds[env]),
        )
        for env in range(len(seeds))
    ]


def fly(
    policy: Policy,
    scenario: Scenario,
    seeds: Sequence[int],
    *,
    max_decisions: float = math.inf,
    watch: Callable[[World], None] | None = None,
    watch_team: Callable[[World, list[list[Policy]]], None] | None = None,
) -> Flight:
    """Fly the episodes with `seeds` to their end, or at most `max_decisions` decisions each.

    `watch` is called after the reset and after each step, and so is `watch_team`, with the policies, [env][uav]; they
    must not change anything.
    """
    _check_fit(policy, scenario)
    scenario = _as_flown_by(policy, scenario)
    world = World(scenario, len(seeds))
    world.reset(np.array(seeds, dtype=np.int64))
    n_uavs = scenario.team.n_uavs
    team = [[copy.deepcopy(policy) for _ in range(n_uavs)] for _ in seeds]
    for env, seed in enumerate(seeds):
        for uav, pilot in enumerate(team[env]):
            pilot.reset(Briefing.of(scenario, uav, seed, world.motion["position"][env, uav]))
    seconds, decisions = np.zeros(len(seeds)), np.zeros(len(seeds))
    bits = np.zeros((len(seeds), n_uavs))
    watchers = [watch] if watch else []
    if watch_team:
        watchers.append(lambda world: watch_team(world, team))
    for look in watchers:
        look(world)
    while world.running.any() and decisions.max() < max_decisions * n_uavs:
        turns = _turns(world, team)
        if not turns:  # on the event clock: those that were done have ended, the others are still flying
            _step(world, turns, [], np.full((world.n_envs, n_uavs, 3), np.nan))
            continue
        elapsed = _decide_and_step(world, turns, bits)
        count = np.bincount([turn.env for turn in turns], minlength=len(seeds))
        decisions += count
        seconds += elapsed * count / len(turns)
        for look in watchers:
            look(world)
    return Flight(world, team, seconds / np.maximum(decisions, 1))


def _turns(world: World, team: list[list[Policy]]) -> list[Turn]:
    deciding = world.running[:, None] & world.motion["active"] & world.motion["ready"]
    return [
        Turn(int(env), int(uav), team[env][uav], world.observation(int(env), int(uav)))
        for env, uav in zip(*np.nonzero(deciding), strict=True)
    ]


def _decide_and_step(world: World, turns: list[Turn], bits: FloatArray) -> float:
    """One decision of all `turns`; the wall time that the policies took, s.

    `bits` (n_envs, n_uavs): what each policy has processed and not yet paid for, from one decision to the next.
    """
    began = time.perf_counter()
    payloads: list[list[bytes | None]] = [[None] * world.n_uavs for _ in range(world.n_envs)]
    for turn in turns:
        payloads[turn.env][turn.uav] = turn.policy.broadcast(turn.observation)
    elapsed = time.perf_counter() - began
    inboxes = world.exchange(payloads, bits)
    turns = [Turn(env, uav, policy, seen, inboxes[env][uav]) for env, uav, policy, seen, _ in turns]
    began = time.perf_counter()
    actions = decide(turns)
    declarations = _declared(world, turns) if world.scenario.ending.success == "declare" else None
    for turn in turns:
        bits[turn.env, turn.uav] = turn.policy.computed_bits
    elapsed += time.perf_counter() - began
    _step(world, turns, actions, declarations)
    return elapsed


def _declared(world: World, turns: list[Turn]) -> FloatArray:
    """What is declared: (n_envs, n_uavs, 3) m, NaN where nothing is."""
    declarations = np.full((world.n_envs, world.n_uavs, 3), np.nan)
    for turn in turns:
        declared = turn.policy.declaration()
        if declared is not None:
            declarations[turn.env, turn.uav] = _point(turn.policy, "declaration()", declared)
    return declarations


def _step(world: World, turns: list[Turn], actions: list[Action], declarations: FloatArray | None) -> None:
    if world.scenario.action == "velocity":
        velocities = np.zeros((world.n_envs, world.n_uavs, 3))
        for turn, action in zip(turns, actions, strict=True):
            if not isinstance(action, Velocity):
                raise _invalid(turn.policy, action, "must be a Velocity")
        _fill(velocities, turns, [action[0] for action in actions])
        world.step_velocities(velocities, declarations)
        return
    if world.scenario.action == "setpoint":
        setpoints = world.motion["position"].copy()
        for turn, action in zip(turns, actions, strict=True):
            if not isinstance(action, Setpoint):
                raise _invalid(turn.policy, action, "must be a Setpoint")
        _fill(setpoints, turns, [action[0] for action in actions])
        world.step_setpoints(setpoints, declarations)
        return
    targets = world.motion["position"].copy()
    samples = np.ones((world.n_envs, world.n_uavs), dtype=np.int64)
    for turn, action in zip(turns, actions, strict=True):
        targets[turn.env, turn.uav], samples[turn.env, turn.uav] = _leg(turn, action, world.scenario.vehicle)
    world.step_waypoints(targets, samples, declarations)


def _fill(commands: FloatArray, turns: list[Turn], values: Sequence[Any]) -> None:
    """Enter the `values` of `turns` into `commands` (n_envs, n_uavs, 3): all at once, if all are what they must be."""
    try:
        points = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        points = np.empty(0)
    if points.shape != (len(turns), 3) or not np.isfinite(points).all():
        rows = [_point(turn.policy, "act()", value) for turn, value in zip(turns, values, strict=True)]
        points = np.array(rows).reshape(-1, 3)
    commands[[turn.env for turn in turns], [turn.uav for turn in turns]] = points


def _leg(turn: Turn, action: Action, vehicle: Any) -> tuple[FloatArray, int]:
    """Where the leg of `action` ends, (3,) m, and how many samples are taken there."""
    position = turn.observation.position
    match action:
        case Hop(direction, length):
            _check_whole(turn.policy, action, "direction", direction, 0, len(HOP_DIRECTIONS) - 1)
            _check_whole(turn.policy, action, "length", length, 1, vehicle.hop_lengths)
            return position + length * vehicle.step_length * HOP_DIRECTIONS[direction], 1
        case Hover(samples):
            _check_whole(turn.policy, action, "samples", samples, 1, vehicle.max_samples)
            return position, samples
        case Waypoint(target, samples):
            _check_whole(turn.policy, action, "samples", samples, 1, vehicle.max_samples)
            return _point(turn.policy, "act()", target), samples
        case _:
            raise _invalid(turn.policy, action, "must be a Hop, Hover or Waypoint")


def _check_whole(policy: Policy, action: Action, name: str, value: Any, low: int, high: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not low <= value <= high:
        raise _invalid(policy, action, f"{name} must be a whole number from {low} to {high}")


def _point(policy: Policy, method: str, value: Any) -> FloatArray:
    """`value` as (3,) finite numbers."""
    try:
        point = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        point = np.empty(0)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise InputError(f"policy {policy.name}: {method} gave {value!r}: must be three finite numbers")
    return point


def _invalid(policy: Policy, action: object, limit: str) -> InputError:
    return InputError(f"policy {policy.name}: act() gave {action!r}: {limit}")


def _check_fit(policy: Policy, scenario: Scenario) -> None:
    told = scenario.told_plume.measures if scenario.reports == "hits" else scenario.reports
    if told not in policy.plume_quantities:
        understood = " or ".join(policy.plume_quantities)
        raise InputError(
            f"policy {policy.name} cannot search in scenario {scenario.name}: "
            f"its sensor gives {scenario.reports} of a plume of {told}, the policy understands {understood}"
        )


def _as_flown_by(policy: Policy, scenario: Scenario) -> Scenario:
    """`scenario` with the action that carries the policy's commands; its own `action` is for learned agents.

    Reward shaping knows the hidden source, so it is switched off in every evaluation. Raises InputError if the vehicle
    can fly none of what the policy commands.
    """
    flown = scenario.vehicle.commands
    for command in policy.vehicle_commands:
        action = "waypoint" if command == "leg" else command
        if action in flown:
            return scenario.override(action=action, reward={"shaping": 0.0})
    raise InputError(
        f"policy {policy.name} cannot search in scenario {scenario.name}: it commands"
        f" {' or '.join(policy.vehicle_commands)}, vehicle {scenario.vehicle.kind!r} takes {', '.join(flown)}"
    )
