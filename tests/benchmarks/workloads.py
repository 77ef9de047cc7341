"""What is measured, by the timed tests and by the table of `compare.py`, and the targets that were set."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

import osl_env
from baselines import Briefing, make_policy
from baselines.belief.grid import GridBelief
from baselines.belief.likelihood import hit_model
from osl_env import World, load_scenario
from osl_env.actions import HOP_DIRECTIONS, Hop, Hover, Waypoint
from training.flight import run_batch

SCENARIO = "rate-100x60x30"
ACTIONS = 16  # batches of random actions, made beforehand and used in turn
Call = Callable[[], object]


@dataclass(frozen=True)
class Workload:
    """One figure: `prepare` gives a call that does `count` units of work; the target is in the figure's unit."""

    prepare: Callable[[], Call]
    unit: str  # "1/s": units of work a second, more is better; "s": seconds a unit, less is better
    count: int = 1
    target: float | None = None

    def figure(self, seconds: float) -> float:
        """The figure, if a call takes `seconds`."""
        return self.count / seconds if self.unit == "1/s" else seconds / self.count


def in_turn(entries: list[Any], use: Callable[[Any], object]) -> Call:
    """A call that uses the next of `entries`, over and over."""
    place = 0

    def call() -> None:
        nonlocal place
        use(entries[place])
        place = (place + 1) % len(entries)

    return call


def endless() -> Any:
    return load_scenario(SCENARIO, **{"ending.time_limit": 1e9, "ending.max_decisions": 10**9, "energy.capacity": 1e15})


def hops(*shape: int) -> list[Any]:
    world = World(SCENARIO)
    choices = 26 * world.scenario.vehicle.hop_lengths + 1  # no declarations: the worlds go on
    return list(np.random.default_rng(0).integers(0, choices, (ACTIONS, *shape)))


def bare_world(n_envs: int) -> Workload:
    def prepare() -> Call:
        world = World(endless(), n_envs)
        world.reset(np.arange(n_envs))
        return in_turn(hops(n_envs, 3), world.step_hops)

    return Workload(prepare, "1/s", 3 * n_envs, 50e6 if n_envs == 1024 else None)


def vector_view(n_envs: int) -> Workload:
    def prepare() -> Call:
        env = osl_env.make_vec(endless(), n_envs)
        env.reset(seed=0)
        return in_turn(hops(n_envs, 3), env.step)

    return Workload(prepare, "1/s", 3 * n_envs, 20e6 if n_envs == 1024 else None)


def sb3_collection(n_worlds: int, target: float, *features: dict[str, Any]) -> Workload:
    """Steps of `UavVecEnv` with random hops, declarations included, so that worlds end and begin all the time."""

    def prepare() -> Call:
        from baselines.features import make_spec
        from training.sb3_vec_env import UavVecEnv

        env = UavVecEnv(SCENARIO, n_worlds, make_spec([{"kind": "raw"}, *features]))
        env.reset()
        rng = np.random.default_rng(0)
        return in_turn([rng.integers(0, env.action_space.n, env.num_envs) for _ in range(ACTIONS)], env.step)

    return Workload(prepare, "1/s", 3 * n_worlds, target)


def sb3_cart_poles(n_envs: int) -> Workload:
    """SB3's own loop over environments, monitored as SB3 wants it."""

    def prepare() -> Call:
        from stable_baselines3.common.env_util import make_vec_env

        env = make_vec_env("CartPole-v1", n_envs)
        env.reset()
        return in_turn(list(np.random.default_rng(0).integers(0, 2, (ACTIONS, n_envs))), env.step)

    return Workload(prepare, "1/s", n_envs)


def ppo_learning() -> Call:
    """One rollout of 16 steps of 1024 worlds, and one epoch of learning on it, with two layers of 32."""
    import torch
    from stable_baselines3 import PPO

    from training.sb3_vec_env import UavVecEnv

    torch.set_num_threads(1)
    env = UavVecEnv(SCENARIO, 1024)
    network = {"net_arch": [32, 32]}
    model = PPO("MlpPolicy", env, n_steps=16, batch_size=12288, n_epochs=1, policy_kwargs=network, device="cpu")
    return lambda: model.learn(16 * env.num_envs, reset_num_timesteps=False)


def parallel_step() -> Call:
    env = osl_env.parallel_env(endless())
    env.reset(seed=0)
    return in_turn([{f"uav_{i}": int(hop) for i, hop in enumerate(row)} for row in hops(3)], env.step)


def team_step() -> Call:
    env = gym.make("osl_env/Team-v0", scenario=endless()).unwrapped
    env.reset(seed=0)
    return in_turn(hops(3), env.step)


def recorded(name: str, n_uavs: int, decisions: int) -> tuple[Any, list[Any]]:
    """The briefing of UAV 0 and the (observation, inbox) of its first `decisions`, in an episode flown by `name`."""
    scenario = load_scenario(SCENARIO, action="waypoint", **{"team.n_uavs": n_uavs})
    world = World(scenario)
    world.reset([3])
    team = [make_policy(name) for _ in range(n_uavs)]
    briefings = [Briefing.of(scenario, i, 3, world.motion["position"][0, i]) for i in range(n_uavs)]
    for pilot, briefing in zip(team, briefings, strict=True):
        pilot.reset(briefing)
    seen = []
    while world.running[0] and len(seen) < decisions:
        observations = [world.observation(0, i) for i in range(n_uavs)]
        inboxes = world.exchange([[pilot.broadcast(o) for pilot, o in zip(team, observations, strict=True)]])[0]
        seen.append((observations[0], inboxes[0]))
        targets, samples = world.motion["position"].copy(), np.ones((1, n_uavs), np.int64)
        for i, pilot in enumerate(team):
            match pilot.act(observations[i], inboxes[i]):
                case Hop(direction, length):
                    targets[0, i] += length * scenario.vehicle.step_length * HOP_DIRECTIONS[direction]
                case Hover(count):
                    samples[0, i] = count
                case Waypoint(position, count):
                    targets[0, i], samples[0, i] = position, count
        world.step_waypoints(targets, samples)
    return briefings[0], seen


def decisions_of(name: str, n_uavs: int, target: float | None = None, decisions: int = 40) -> Workload:
    def prepare() -> Call:
        briefing, seen = recorded(name, n_uavs, decisions)
        pilot = make_policy(name)

        def replay() -> None:
            pilot.reset(briefing)
            for observation, inbox in seen:
                pilot.broadcast(observation)
                pilot.act(observation, inbox)

        return replay

    return Workload(prepare, "s", decisions, target)


def belief_update() -> Call:
    scenario = load_scenario(SCENARIO)
    belief = GridBelief(np.array(scenario.arena.size), cell=2.0)
    briefing = Briefing.of(scenario, 0, 1, np.array([10.0, 10.0, 5.0]))
    belief.use_model(hit_model(briefing.plume, briefing.gas_sensor, np.array([0.0, -1.0, 0.0])))
    place, reading, duration = np.array([[[50.0, 30.0, 15.0]]]), np.array([[0.0]]), np.array([[1.0]])
    return lambda: belief.update(place, reading, duration)


def import_in_a_new_process() -> Call:
    return lambda: subprocess.run([sys.executable, "-c", "import osl_env"], check=True)


def runs_of_muc_osl() -> Call:
    policy, scenario = make_policy("muc-osl"), load_scenario(SCENARIO)
    return lambda: run_batch(policy, scenario, range(20))


def naive_numpy(n_envs: int) -> Workload:
    """Hops, eq 1, Poisson hits and time in plain numpy arrays, nothing else: what one would write in an afternoon."""

    def prepare() -> Call:
        rng, area, source = np.random.default_rng(0), np.array([100.0, 60.0, 30.0]), np.array([80.0, 49.8, 21.9])
        position, clock = rng.uniform(0, area, (n_envs, 3, 3)), np.zeros(n_envs)
        table = np.concatenate(
            [np.repeat(HOP_DIRECTIONS, 3, axis=0) * np.tile([[1], [2], [3]], (26, 1)), np.zeros((1, 3))]
        )
        lengths = np.linalg.norm(table, axis=1)

        def step(actions: Any) -> Any:
            position[:] = np.clip(position + table[actions], 0, area)
            offset = position - source
            distance = np.maximum(np.linalg.norm(offset, axis=-1), 0.5)
            rate = 2.5 / distance * np.exp(-offset[..., 1] / 2.0 - distance * np.sqrt(26.0 / 100.0))
            clock[:] += (lengths[actions] + 1.0).max(axis=1)
            return rng.poisson(rate), position / area, clock

        return in_turn(hops(n_envs, 3), step)

    return Workload(prepare, "1/s", 3 * n_envs)


def cart_pole(n_envs: int) -> Workload:
    def prepare() -> Call:
        env: Any = gym.make_vec("CartPole-v1", num_envs=n_envs, vectorization_mode="vector_entry_point")
        env.reset(seed=0)
        return in_turn(list(np.random.default_rng(0).integers(0, 2, (ACTIONS, n_envs))), env.step)

    return Workload(prepare, "1/s", n_envs)


WORKLOADS: dict[str, Workload] = {
    "world step, 1 world": bare_world(1),
    "world step, 64 worlds": bare_world(64),
    "world step, 1024 worlds": bare_world(1024),
    "world step, 8192 worlds": bare_world(8192),
    "vector view, 1024 worlds": vector_view(1024),
    "SB3 collection, 1024 worlds": sb3_collection(1024, 1e6),
    "SB3 collection with beliefs": sb3_collection(1024, 1e6 / 3.0, {"kind": "belief"}),
    "SB3 collection with team and hits": sb3_collection(1024, 1e6, {"kind": "team"}, {"kind": "hits"}),
    "PPO, collecting and learning": Workload(ppo_learning, "1/s", 16 * 3 * 1024, 100e3),
    "ParallelEnv.step": Workload(parallel_step, "s", 1, 10e-6),
    "Team-v0 step": Workload(team_step, "s"),
    "muc-osl decision, 160 particles": decisions_of("muc-osl", 3, 130e-6),
    "infotaxis decision": decisions_of("infotaxis", 1),
    "team-infotaxis decision": decisions_of("team-infotaxis", 3, 5e-3),
    "grid belief update, 22,500 cells": Workload(belief_update, "s", 1, 100e-6),
    "200 runs of muc-osl (from 20)": Workload(runs_of_muc_osl, "s", 1, 12.0),
    "import osl_env, warm": Workload(import_in_a_new_process, "s", 1, 1.0),
}
RIVALS: dict[str, Workload] = {
    "naive numpy, 1024 worlds": naive_numpy(1024),
    "Gymnasium CartPole, 1024 worlds": cart_pole(1024),
    "SB3's loop of CartPoles, 256 worlds": sb3_cart_poles(256),
}


def bytes_per_agent(n_envs: int = 1024, n_uavs: int = 3) -> float:
    """Bytes of all of a World's arrays for each UAV; the target is 1000."""
    world = World(load_scenario(SCENARIO, **{"team.n_uavs": n_uavs}), n_envs)
    arrays = {id(value): value.nbytes for value in vars(world).values() if isinstance(value, np.ndarray)}
    return sum(arrays.values()) / (n_envs * n_uavs)


def seconds_a_call(call: Call, budget: float = 1.0) -> float:
    """The least wall time of a call, s: the first compiles and is not counted; repeated for about `budget` s."""
    call()
    began = time.perf_counter()
    call()
    once = max(time.perf_counter() - began, 1e-7)
    number = max(1, int(0.02 / once))
    times = []
    for _ in range(max(3, int(budget / (once * number)))):
        began = time.perf_counter()
        for _ in range(number):
            call()
        times.append((time.perf_counter() - began) / number)
    return min(times)
