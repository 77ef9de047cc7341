"""Gymnasium: one UAV in `gym.make`, then a thousand UAVs in one native vector environment.

    python examples/gymnasium_loop.py --steps 2000

The actions are random, drawn from those that stay inside the area; put your agent in their place.
"""

from __future__ import annotations

import time

import gymnasium as gym
import numpy as np
import tyro

import osl_env  # registers the ids with Gymnasium

SCENARIO = "rate-60x60x30-random"  # `osl list scenarios` shows the others


def one_uav(steps: int, seed: int) -> None:
    """Fly one UAV for `steps` decisions, through as many episodes as it takes."""
    env = gym.make("osl_env/Solo-v0", scenario=SCENARIO)
    _, info = env.reset(seed=seed)  # observation: a float32 vector in [-1, 1], tabulated in the README
    env.action_space.seed(seed)
    episode_return = 0.0
    for _ in range(steps):
        mask = env.get_wrapper_attr("action_masks")().astype(np.int8)
        mask[-1] = 0  # the last action declares "the source is here" and ends the episode
        action = env.action_space.sample(mask)
        _, reward, terminated, truncated, info = env.step(action)
        episode_return += float(reward)
        if terminated or truncated:
            print(f"episode over after {info['clock']:.0f} s: return {episode_return:.2f}, success {info['success']}")
            _, info = env.reset()  # without a seed: the episode that follows the last one, itself reproducible
            episode_return = 0.0
    env.close()


def many_uavs(steps: int, seed: int, n_worlds: int = 1024) -> None:
    """Fly `n_worlds` teams of three side by side for `steps` decisions in all: one kernel call a step."""
    worlds = osl_env.make_vec(SCENARIO, n_worlds)
    worlds.reset(seed=seed)  # world i gets seed + i
    _, n_uavs, n_actions = worlds.action_masks().shape
    rng = np.random.default_rng(seed)
    began, rounds, finished = time.perf_counter(), -(-steps // (n_worlds * n_uavs)), 0
    for _ in range(rounds):
        actions = rng.integers(0, n_actions - 1, (n_worlds, n_uavs))  # all but the last one, which declares
        _, _, terminated, truncated, _ = worlds.step(actions)  # an ended world begins anew with the next step
        finished += int((terminated | truncated).sum())
    speed = rounds * n_worlds * n_uavs / (time.perf_counter() - began)
    print(f"{n_worlds} worlds of {n_uavs} UAVs: {finished} episodes, {speed / 1e6:.1f} M decisions/s with compiling")
    worlds.close()


def main(steps: int = 1000, seed: int = 0) -> None:
    """Fly random hops through both interfaces, `steps` decisions in the first and a thousand times as many in the
    second.
    """
    one_uav(steps, seed)
    many_uavs(1000 * steps, seed)


if __name__ == "__main__":
    tyro.cli(main)
