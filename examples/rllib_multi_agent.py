"""RLlib: PPO with one policy for all UAVs on the PettingZoo environment.

    python -m venv rllib && rllib/bin/pip install "osl-env[rllib]"    # of its own: Ray pins Gymnasium 1.2.2
    rllib/bin/python examples/rllib_multi_agent.py --steps 100000

RLlib's own wrapper, `ParallelPettingZooEnv`, needs the small correction below. Ray reports its usage over the network
unless RAY_USAGE_STATS_ENABLED=0 is set.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import ray
import tyro
from as_checkpoint import score, write_checkpoint
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv
from ray.tune.registry import register_env
from torch import nn

import osl_env

# success by reaching the source: easier to learn than to declare it, which is the default rule
SCENARIO = osl_env.load_scenario("rate-60x60x30-random", **{"ending.success": "reach"})


class Team(ParallelPettingZooEnv):
    """The team as RLlib takes it, with ends that RLlib (2.60) understands.

    The library's wrapper says that an episode is over if all UAVs end by the same flag. If in the last step one's
    battery is empty and another's time is up, it goes on stepping an environment that is over, and fails. And where all
    are truncated, RLlib makes them terminated as well, and bootstraps no value. Here the last step is over for
    `__all__` whatever the flags, and truncated UAVs are told so by `__all__` alone.
    """

    def step(self, action_dict: dict[str, Any]) -> tuple[dict[str, Any], ...]:
        """One decision of every UAV that still flies."""
        observations, rewards, terminated, truncated, infos = self.par_env.step(action_dict)
        over = not self.par_env.agents
        cut = over and any(truncated.values())
        if cut:
            truncated = dict.fromkeys(truncated, False)
        terminated["__all__"], truncated["__all__"] = over and not cut, cut
        return observations, rewards, terminated, truncated, infos


def make_config(seed: int, batch: int) -> PPOConfig:
    """PPO for one policy that all UAVs share, sampling in this process; `env_runners` is where to ask for more."""
    return (
        PPOConfig()
        .environment("team")
        .env_runners(num_env_runners=0, rollout_fragment_length="auto")
        .multi_agent(policies={"uav"}, policy_mapping_fn=lambda agent, episode, **_: "uav")
        .rl_module(model_config=DefaultModelConfig(fcnet_hiddens=[64, 64], fcnet_activation="tanh"))
        .training(lr=1e-3, gamma=0.99, train_batch_size_per_learner=batch, minibatch_size=min(512, batch), num_epochs=5)
        .debugging(seed=seed)
    )


def main(steps: int = 100_000, episodes: int = 20, seed: int = 0, folder: Path = Path("results/rllib/ppo")) -> None:
    """Train on `steps` steps of one team, write a checkpoint and score it.

    Args:
        steps: Steps of the team.
        episodes: Episodes of the evaluation.
        seed: Of weights and episodes.
        folder: Where the checkpoint is written.
    """
    ray.init(include_dashboard=False, log_to_driver=False)
    register_env("team", lambda _: Team(osl_env.parallel_env(SCENARIO)))
    learner = make_config(seed, min(2000, steps)).build_algo()
    done = 0
    while done < steps:
        result = learner.train()
        done = int(result["num_env_steps_sampled_lifetime"])
        runners = result["env_runners"]
        if "episode_return_mean" in runners:  # summed over the UAVs
            print(f"{done} steps: mean return of the team {runners['episode_return_mean']:.1f}")
    layers = [each for each in learner.get_module("uav").modules() if isinstance(each, nn.Linear)]
    write_checkpoint(folder, layers, "tanh", SCENARIO, "ppo")  # the module that samples has the actor's layers only
    learner.stop()
    ray.shutdown()
    score(folder, SCENARIO, episodes)


if __name__ == "__main__":
    tyro.cli(main)
