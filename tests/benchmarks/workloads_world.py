"""Workloads of whole worlds in air that goes on: steps, ticks and resets of the filament and the CFD presets."""

from __future__ import annotations

import functools

import numpy as np
from workloads import ACTIONS, Call, Workload, hops, in_turn

from osl_env import World, load_scenario
from osl_env.configuration import config_folder
from osl_env.fields import read_field

FILAMENTS, SWARM = "gaden-100x60x30", "arena-4x6-5"
FILAMENTS_A_WORLD = 2424  # live ones, once the plume has filled the arena: 50/s until they leave, 50 m downwind
_NO_END = {"ending.time_limit": 1e9, "ending.max_decisions": 10**9, "energy.capacity": 1e15}


@functools.cache
def begun(name: str, n_envs: int) -> World:
    """Worlds of the preset `name`, begun, whose episodes do not end; the same ones for all workloads."""
    world = World(load_scenario(name, **_NO_END), n_envs)
    world.reset(np.arange(n_envs))
    return world


def filament_steps(n_envs: int) -> Workload:
    """Random hops: some five ticks of the plume each, with a reading for each UAV at each tick."""
    return Workload(lambda: in_turn(hops(n_envs, 3), begun(FILAMENTS, n_envs).step_hops), "1/s", 3 * n_envs)


def filament_ticks(n_envs: int) -> Workload:
    """A tick of the preset's air and plume, for each filament."""

    def prepare() -> Call:
        world = begun(FILAMENTS, n_envs)
        return lambda: world.run_air(world.surroundings.tick)

    return Workload(prepare, "s", n_envs * FILAMENTS_A_WORLD, 10e-9)


def filament_reset() -> Call:
    world = World(FILAMENTS)
    return lambda: world.reset([0])


def swarm_steps(n_envs: int) -> Workload:
    """Random velocities in the wind field, among obstacles."""

    def prepare() -> Call:
        world = begun(SWARM, n_envs)
        speed = world.scenario.vehicle.speed
        shape = (ACTIONS, *world.motion.shape, 3)
        return in_turn(list(np.random.default_rng(0).uniform(-speed, speed, shape)), world.step_velocities)

    return Workload(prepare, "1/s", n_envs * load_scenario(SWARM).team.n_uavs)


def shipped_field() -> Call:
    path = config_folder() / "fields" / f"{SWARM}.npz"
    return lambda: read_field(path)


WORKLOADS_WORLD = {
    f"{FILAMENTS}, step, 1 world": filament_steps(1),
    f"{FILAMENTS}, step, 32 worlds": filament_steps(32),
    f"{FILAMENTS}, step, 256 worlds": filament_steps(256),
    f"{FILAMENTS}, 256 worlds, a filament": filament_ticks(256),
    f"{FILAMENTS}, reset": Workload(filament_reset, "s"),
    f"{SWARM}, step, 1 world": swarm_steps(1),
    f"{SWARM}, step, 32 worlds": swarm_steps(32),
    f"{SWARM}, load its field": Workload(shipped_field, "s", 1, 0.2),
}
