"""Stable-Baselines3: PPO on one UAV through `gym.make`, then on teams through the native VecEnv.

    pip install "osl-env[train]"
    python examples/sb3_ppo.py --steps 1000000

In `UavVecEnv` every UAV is a slot and all share one policy; its worlds are stepped by one kernel call. What is saved
is flown and scored as any policy of the package is. This shows the interfaces: the recipes that make strong agents are
in `configs/training`, for `osl train`.
"""

from __future__ import annotations

from pathlib import Path

import gymnasium as gym
import tyro
from stable_baselines3 import PPO

import osl_env
from baselines import make_policy
from baselines.features import BeliefFeatures, RawFeatures
from training import evaluate
from training.sb3_vec_env import UavVecEnv

# an episode succeeds where a UAV comes near the source: easier to learn than to declare it, which is the default rule
SCENARIO = osl_env.load_scenario("rate-60x60x30-random", **{"ending.success": "reach"})
ALONE = osl_env.load_scenario(SCENARIO, **{"team.n_uavs": 1})
# what a UAV of a team observes: its own vector with two teammates, and its own particle belief about the source
FEATURES = (RawFeatures(neighbours=2), BeliefFeatures(particles=64))
TEST_SEEDS = 50_000  # episodes that no training begins with


def main(
    steps: int = 1_000_000, worlds: int = 128, episodes: int = 50, seed: int = 0, folder: Path = Path("results/sb3")
) -> None:
    """Train, save, load and score a policy for one UAV (a twentieth of the steps) and one for the team.

    Args:
        steps: Decisions of UAVs to learn from.
        worlds: Worlds that the team's environment steps at once.
        episodes: Episodes of the evaluation.
        seed: Of weights and episodes.
        folder: Where the two zips are written.
    """
    folder.mkdir(parents=True, exist_ok=True)

    solo = PPO("MlpPolicy", gym.make("osl_env/Solo-v0", scenario=SCENARIO), n_steps=512, seed=seed, device="cpu")
    solo.learn(steps // 20).save(folder / "solo.zip")
    score("one UAV", ALONE, episodes, path=folder / "solo.zip")

    env = UavVecEnv(SCENARIO, worlds, features=FEATURES, seed=seed)
    # as many minibatches as one of 16 steps of all slots each: SB3's default of 64 would make thousands of them
    team = PPO("MlpPolicy", env, n_steps=64, batch_size=16 * env.num_envs, n_epochs=5, seed=seed, device="cpu")
    team.learn(steps).save(folder / "team.zip")
    score("team", SCENARIO, episodes, path=folder / "team.zip", features=[each.model_dump() for each in FEATURES])


def score(title: str, scenario: osl_env.Scenario, episodes: int, **parameters: object) -> None:
    """Fly the saved model through `episodes` and print success rate and search time, failures at the time limit."""
    policy = make_policy("sb3", **parameters)  # warns: SB3's zips are unpickled, so load only your own
    records = evaluate(policy, scenario, seeds=range(TEST_SEEDS, TEST_SEEDS + episodes))
    rate, minutes = 100 * records.values("success_rate").mean(), records.values("capped_search_time").mean() / 60
    print(f"{title}: success rate {rate:.0f} %, capped mean search time {minutes:.1f} min")


if __name__ == "__main__":
    tyro.cli(main)
