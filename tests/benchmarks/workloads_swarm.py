"""Workloads of large teams: a decision of all robots without and with their policies, and who hears whom against all
pairs.

A decision is a step of the world, an observation for each robot, and the messages to each. Its target is 0.1 s of the
mission, 20 times in the large arena and 200 times in the small one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from workloads import ACTIONS, Call, Workload, in_turn

from baselines import Briefing, Policy, make_policy
from osl_env import World, load_scenario
from osl_env.cells import MOST_RUNS, make_cells, runs_near, sort_into_cells
from osl_env.parameters import FloatArray
from training.flight import _decide_and_step, _turns

PERIOD = 0.1  # s, of a decision
RADIUS, DENSITY = 6.0, 0.05  # m; robots in each m^2: five or six in range of each
_NO_END = {
    "ending.time_limit": 1e9,
    "ending.max_decisions": 10**9,
    "ending.success_radius": 1e-9,
    "energy.capacity": 1e15,
}
_CORNER = (5.2, 1.5, 0.5)  # m: middle and side of a square in the small arena that is free of obstacles
_MANY = {"plume.filament_rate": 25.0}  # some 2000 filaments live at once in the large arena


def together(n_uavs: int, x: float, y: float, side: float) -> list[tuple[float, float, float]]:
    """Starts of robots that all hear each other: a lattice in a square around (x, y), m."""
    across = int(np.ceil(np.sqrt(n_uavs)))
    return [
        (x + side * (i % across / across - 0.5), y + side * (i // across / across - 0.5), 0.1) for i in range(n_uavs)
    ]


def swarm_decision(name: str, n_uavs: int, factor: float | None, **changes: Any) -> Workload:
    """Random velocities; without a policy. The target is `factor` times as fast as the mission."""

    def prepare() -> Call:
        world = World(load_scenario(name, **_NO_END, **{"team.n_uavs": n_uavs}, **changes))
        world.reset([0])
        slow = 0.05 * world.scenario.vehicle.speed  # so that robots stay as near to each other as they are
        silence = [[None] * n_uavs]

        def decide(velocities: FloatArray) -> None:
            world.step_velocities(velocities)
            for uav in range(n_uavs):
                world.observation(0, uav)
            world.exchange(silence)

        shape = (ACTIONS, 1, n_uavs, 3)
        return in_turn(list(np.random.default_rng(0).uniform(-slow, slow, shape)), decide)

    return Workload(prepare, "s", 1, None if factor is None else PERIOD / factor)


def swarm_flight(name: str, n_uavs: int, factor: float, **changes: Any) -> Workload:
    """A decision of robots that fly `swarm`, as the runner flies them."""

    def prepare() -> Call:
        scenario = load_scenario(name, **_NO_END, **{"team.n_uavs": n_uavs}, **changes)
        world = World(scenario)
        world.reset([0])
        team: list[list[Policy]] = [[make_policy("swarm") for _ in range(n_uavs)]]
        for uav, pilot in enumerate(team[0]):
            pilot.reset(Briefing.of(scenario, uav, 0, world.motion["position"][0, uav]))
        bits = np.zeros((1, n_uavs))
        return lambda: _decide_and_step(world, _turns(world, team), bits)

    return Workload(prepare, "s", 1, PERIOD / factor)


@njit(cache=True)
def _count_in_cells(places: FloatArray, radius: float) -> int:
    n, found = len(places), 0
    cells, runs = make_cells(n), np.empty((MOST_RUNS, 2), np.int64)
    for i in range(n):
        cells.names[i] = i
        for axis in range(3):
            cells.points[i, axis] = places[i, axis]
    sort_into_cells(cells, n, radius)
    for i in range(n):
        x, y, z = places[i, 0], places[i, 1], places[i, 2]
        for r in range(runs_near(cells, x, y, z, runs)):
            for k in range(runs[r, 0], runs[r, 1]):
                dx, dy, dz = x - cells.places[k, 0], y - cells.places[k, 1], z - cells.places[k, 2]
                found += dx * dx + dy * dy + dz * dz <= radius * radius
    return found


@njit(cache=True)
def _count_in_pairs(places: FloatArray, radius: float) -> int:
    found = 0
    for i in range(len(places)):
        for j in range(len(places)):
            dx, dy, dz = places[i, 0] - places[j, 0], places[i, 1] - places[j, 1], places[i, 2] - places[j, 2]
            found += dx * dx + dy * dy + dz * dz <= radius * radius
    return found


def who_is_in_range(n_uavs: int, count: Any) -> Workload:
    """The pairs in range, by `count`; seconds for each robot."""

    def prepare() -> Call:
        side = np.sqrt(n_uavs / DENSITY)
        places = np.random.default_rng(0).uniform(0.0, (side, side, 0.0), (n_uavs, 3))
        return lambda: count(places, RADIUS)

    return Workload(prepare, "s", n_uavs)


LARGE, SMALL = "arena-30x40", "arena-4x6-10"
_TOGETHER = {n: {"team.starts": together(n, *at)} for n, at in ((60, (20, 15, 2)), (15, _CORNER), (30, _CORNER))}
WORKLOADS_SWARM = {
    f"{LARGE}, 60 robots, spread": swarm_decision(LARGE, 60, 20.0, **_MANY),
    f"{LARGE}, 60 robots, together": swarm_decision(LARGE, 60, 20.0, **_MANY, **_TOGETHER[60]),
    f"{SMALL}, 15 robots, spread": swarm_decision(SMALL, 15, 200.0),
    f"{SMALL}, 15 robots, together": swarm_decision(SMALL, 15, 200.0, **_TOGETHER[15]),
    f"{SMALL}, 30 robots, together": swarm_decision(SMALL, 30, None, **_TOGETHER[30]),
    f"{LARGE}, 60 robots that fly swarm": swarm_flight(LARGE, 60, 20.0, **_MANY),
    f"{LARGE}, 60 robots that fly swarm, together": swarm_flight(LARGE, 60, 20.0, **_MANY, **_TOGETHER[60]),
    f"{SMALL}, 15 robots that fly swarm": swarm_flight(SMALL, 15, 200.0),
    **{f"in range: a robot of {n}, cells": who_is_in_range(n, _count_in_cells) for n in (60, 256, 1024)},
    **{f"in range: a robot of {n}, all pairs": who_is_in_range(n, _count_in_pairs) for n in (60, 256, 1024)},
}
