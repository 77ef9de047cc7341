"""An episode is a function of (scenario, seed, actions): never of the batch, the row or the process."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from worlds import NOISY, advance, begun, differences, flying, random_commands, row_bytes, small, trajectory_digest

from osl_env import Scenario, World

SEEDS = [3, 2**62, 0, 77, 12345]
CASES: dict[str, dict[str, Any]] = {
    "hop": {"action": "hop"},
    "hop noisy": {"action": "hop"} | NOISY,
    "hop event noisy": {"action": "hop", "clock": "event"} | NOISY,
    "waypoint noisy": {"action": "waypoint"} | NOISY,
    "waypoint event": {"action": "waypoint", "clock": "event"},
    "velocity": {"action": "velocity"},
    "velocity noisy": {"action": "velocity"} | NOISY,
    "setpoint": {"action": "setpoint"},
    "setpoint noisy": {"action": "setpoint", "arena.bounds": "end", "arena.margin": 0.5} | NOISY,
    "random places": {
        "sources.region": [[0, 0, 0], [20, 20, 10]],
        "sources.number": 2,
        "team.region": [[0, 0, 0], [9, 9, 9]],
    },
    "reach": {"ending.success": "reach", "reward": {"shaping": 1.0, "energy": -1.0, "detection": 2.0}},
    "short battery": {"energy.capacity": 9000.0} | NOISY,
}


def scenario(case: str) -> Scenario:
    changes: dict[str, Any] = {"action": "hop", "ending.time_limit": 40.0}
    return flying(**changes | CASES[case])


def row_of(commands: tuple[Any, ...], env: int) -> tuple[Any, ...]:
    return tuple(np.ascontiguousarray(array[env : env + 1]) for array in commands)


def talk(world: World, step: int) -> list[Any]:
    payloads = [[bytes([step % 256, uav]) * uav for uav in range(world.n_uavs)] for _ in range(world.n_envs)]
    inboxes = world.exchange(payloads, np.full(world.motion.shape, 1e5))
    return [[[(m[0], m[1], m[2].tolist(), *m[3:]) for m in box] for box in team] for team in inboxes]


@pytest.mark.parametrize("case", CASES)
def test_row_i_of_a_batch_is_a_batch_of_one_bit_for_bit(case: str) -> None:
    batch = begun(scenario(case), SEEDS)
    singles = [begun(scenario(case), seed) for seed in SEEDS]
    rng, step = np.random.default_rng(0), 0
    while batch.running.any():
        inboxes = talk(batch, step)
        commands = random_commands(batch, rng)
        advance(batch, commands)
        for env, single in enumerate(singles):
            assert talk(single, step)[0] == inboxes[env]
            advance(single, row_of(commands, env))
            assert differences(batch, env, single, 0) == [], (step, env)
        step += 1
    assert step >= 3


@pytest.mark.parametrize("case", CASES)
def test_the_same_seed_twice_is_the_same_episode(case: str) -> None:
    worlds = [begun(scenario(case), SEEDS) for _ in range(2)]
    rngs = [np.random.default_rng(1) for _ in range(2)]
    while worlds[0].running.any():
        for world, rng in zip(worlds, rngs, strict=True):
            advance(world, random_commands(world, rng))
    for env in range(len(SEEDS)):
        assert differences(worlds[0], env, worlds[1], env) == []


@pytest.mark.parametrize("case", CASES)
def test_a_used_world_begins_as_a_new_one(case: str) -> None:
    used = begun(scenario(case), [8, 9])
    rng = np.random.default_rng(2)
    for step in range(7):
        talk(used, step)
        advance(used, random_commands(used, rng))
    used.reset(np.array(SEEDS[:2]))
    fresh = begun(scenario(case), SEEDS[:2])
    for step in range(8):
        for env in range(2):
            left, right = row_bytes(used, env), row_bytes(fresh, env)
            changed = [name for name in left if left[name] != right[name]]
            # what the last step gave is only defined after a step
            assert [name for name in changed if step or not name.startswith(("rewards", "team."))] == []
        assert talk(used, step) == talk(fresh, step)
        commands = random_commands(fresh, rng)
        advance(used, commands)
        advance(fresh, commands)


@pytest.mark.parametrize("case", CASES)
def test_resets_of_other_rows_change_nothing(case: str) -> None:
    """Row 0 flies on while the others are reset all the time; row 1, reset once, is a new episode."""
    batch, alone, later = begun(scenario(case), [1, 2, 3]), begun(scenario(case), 1), begun(scenario(case), 50)
    rng = np.random.default_rng(3)
    batch.reset(np.array([0, 50, 0]), np.array([False, True, False]))
    for step in range(12):
        assert talk(batch, step)[:2] == [talk(alone, step)[0], talk(later, step)[0]]
        commands = random_commands(batch, rng)
        advance(batch, commands)
        advance(alone, row_of(commands, 0))
        advance(later, row_of(commands, 1))
        for count in range(3):
            batch.reset(np.array([0, 0, step * 3 + count]), np.array([False, False, True]))
        assert differences(batch, 0, alone, 0) == []
        assert differences(batch, 1, later, 0) == []


def test_frames_on_their_way_survive_resets_of_other_rows() -> None:
    """Radio latency of many steps, while another row is reset many times a step: the queue must not run over."""
    settings = {"radio.latency": 6.0, "ending.time_limit": 100.0}
    batch, alone = begun(small(**settings), [1, 2]), begun(small(**settings), 1)
    hovering = np.full((2, 3), 52)
    for step in range(20):
        batch.step_hops(hovering)
        alone.step_hops(hovering[:1])
        for count in range(4):
            batch.reset(np.array([0, 100 * step + count]), np.array([False, True]))
        assert differences(batch, 0, alone, 0) == [], step
    assert alone.observation(0, 0).neighbour_mask.all()


def test_large_batches_are_no_different() -> None:
    """Over the boundaries of the blocks in which a batch is stepped."""
    n = 900
    batch, rng = begun(small(), list(range(n))), np.random.default_rng(4)
    rows = [0, 1, 150, 255, 256, 511, 640, 899]
    singles = [begun(small(), row) for row in rows]
    for _ in range(12):
        commands = random_commands(batch, rng)
        advance(batch, commands)
        for row, single in zip(rows, singles, strict=True):
            advance(single, row_of(commands, row))
            assert differences(batch, row, single, 0) == []


def test_another_process_flies_the_same_episodes() -> None:
    code = "import worlds; print(worlds.trajectory_digest())"
    path = os.pathsep.join(entry for entry in sys.path if entry)
    run = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == trajectory_digest()


def test_seeds_matter() -> None:
    first, second = begun(small(), list(range(40))), begun(small(), list(range(100, 140)))
    assert not np.array_equal(first.senses["reading"], second.senses["reading"])


def test_actions_of_ended_worlds_and_of_uavs_in_flight_do_not_matter() -> None:
    worlds = [begun(small(clock="event", **{"ending.time_limit": 20.0}), [1, 2]) for _ in range(2)]
    rng, noise = np.random.default_rng(5), np.random.default_rng(6)
    while worlds[0].running.any():
        (actions,) = random_commands(worlds[0], rng)
        ignored = ~(worlds[0].motion["ready"] & worlds[0].motion["active"] & worlds[0].running[:, None])
        worlds[0].step_hops(actions)
        worlds[1].step_hops(np.where(ignored, noise.integers(0, 53, actions.shape), actions))
    for env in range(2):
        assert differences(worlds[0], env, worlds[1], env) == []
