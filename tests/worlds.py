"""Small worlds for the tests, and ways to fly and to compare them."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np

from osl_env import Scenario, World, load_scenario
from osl_env.observation import Observation
from osl_env.parameters import FloatArray
from osl_env.state import IntArray

# fields that are no more than storage until something is written there: a reset does not clear them
_UNSET = {"senses": ("detection_time", "detection_position", "detection_reading")}

# everything that can make an episode random or late, at once
NOISY: dict[str, Any] = {
    "gas_sensor.false_positive_rate": 0.2,
    "gas_sensor.miss_probability": 0.3,
    "gas_sensor.dead_time": 0.1,
    "anemometer.noise": 0.3,
    "radio.radius": 15.0,
    "radio.latency": 3.0,
    "radio.loss": 0.2,
    "wind.random_direction": True,
}


def small(**changes: Any) -> Scenario:
    """20 x 20 x 10 m with hits everywhere, three UAVs, one minute; `changes` are dotted keys or mappings."""
    settings: dict[str, Any] = {
        "name": "small",
        "arena.size": (20.0, 20.0, 10.0),
        "sources.positions": [(12.0, 13.0, 5.0)],
        "team.n_uavs": 3,
        "team.starts": [(4.0, 4.0, 4.0), (10.0, 6.0, 5.0), (16.0, 4.0, 6.0), (2.0, 18.0, 2.0), (18.0, 18.0, 8.0)],
        "ending.time_limit": 60.0,
        "vehicle.hop_lengths": 2,
    }
    return load_scenario("rate-60x60x30", **(settings | changes))


def flying(**changes: Any) -> Scenario:
    """`small` with a point mass that takes velocities, or another `action`."""
    return small(**{"vehicle": {"kind": "point_mass"}, "action": "velocity"} | changes)


def begun(scenario: Scenario, seeds: int | list[int] = 1) -> World:
    """Worlds of `scenario` reset to `seeds`."""
    numbers = [seeds] if isinstance(seeds, int) else seeds
    world = World(scenario, len(numbers))
    world.reset(np.array(numbers))
    return world


def random_commands(world: World, rng: np.random.Generator) -> tuple[Any, ...]:
    """Random commands, without declarations, for all UAVs of all worlds."""
    shape = world.motion.shape
    vehicle, mode = world.scenario.vehicle, world.scenario.action
    if mode == "hop":
        return (rng.integers(0, 26 * vehicle.hop_lengths + 1, shape),)
    if mode == "waypoint":
        return rng.uniform(0, world.scenario.arena.size, (*shape, 3)), rng.integers(1, 4, shape)
    if mode == "setpoint":  # some of them outside the area
        return (rng.uniform(-2.0, np.add(world.scenario.arena.size, 2.0), (*shape, 3)),)
    return (rng.uniform(-vehicle.speed, vehicle.speed, (*shape, 3)),)


def advance(world: World, commands: tuple[Any, ...]) -> None:
    """Step `world` with `commands` for its action mode."""
    step = {
        "hop": world.step_hops,
        "waypoint": world.step_waypoints,
        "velocity": world.step_velocities,
        "setpoint": world.step_setpoints,
    }
    step[world.scenario.action](*commands)


def fly(world: World, seed: int = 0, steps: int = 1000) -> int:
    """Fly random commands until all episodes are over, or for `steps`; how many steps it took."""
    rng = np.random.default_rng(seed)
    for step in range(steps):
        if not world.running.any():
            return step
        advance(world, random_commands(world, rng))
    return steps


def hover(world: World, declare: int = -1) -> IntArray:
    """Hop actions (n_envs, n_uavs) that hover; UAV `declare` of every world declares its place."""
    actions = np.full(world.motion.shape, 26 * world.scenario.vehicle.hop_lengths)
    if declare >= 0:
        actions[:, declare] += 1
    return actions


def row_bytes(world: World, env: int) -> dict[str, bytes]:
    """Everything that makes up the episode of world `env`, bit for bit, by name."""
    state: dict[str, bytes] = {}
    for group in ("motion", "ledger", "senses", "episode", "team"):
        array = getattr(world, group)[env]
        for name in array.dtype.names:
            if name not in _UNSET.get(group, ()):
                state[f"{group}.{name}"] = np.ascontiguousarray(array[name]).tobytes()
    state["rewards"] = world.rewards[env].tobytes()
    state["source_position"] = world.source_position[env].tobytes()
    state["observation"] = world.physical[env].tobytes()
    state["flat"] = world.layout.flat(world)[env].tobytes()
    return state


def differences(first: World, row: int, second: World, other: int) -> list[str]:
    """The names of what differs between two worlds' rows; [] if they are the same episode in the same state."""
    left, right = row_bytes(first, row), row_bytes(second, other)
    return [name for name in left if left[name] != right[name]]


def observed(observation: Observation) -> dict[str, Any]:
    """An Observation's fields by name, as plain values that compare with ==."""
    values = {name: getattr(observation, name) for name in Observation.__slots__}
    return {name: np.asarray(value).tolist() for name, value in values.items()}


def standard_error(samples: FloatArray) -> float:
    """Of the mean of independent `samples`."""
    return float(np.std(samples, ddof=1) / np.sqrt(len(samples)))


def trajectory_digest() -> str:
    """A digest of every bit of a few noisy episodes, the same in every process."""
    digest = hashlib.sha256()
    for changes in ({}, NOISY, NOISY | {"clock": "event"}):
        in_legs = [small(**changes), small(**changes, action="waypoint")]
        for scenario in (*in_legs, flying(**changes), flying(**changes, action="setpoint")):
            world = begun(scenario, [1, 2**40])
            fly(world, seed=3, steps=25)
            for env in range(2):
                digest.update(b"".join(row_bytes(world, env).values()))
    return digest.hexdigest()
