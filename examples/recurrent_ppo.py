"""sb3-contrib: RecurrentPPO, a policy with a memory, on the raw observations of a team.

    pip install "osl-env[train]"
    python examples/recurrent_ppo.py --steps 1000000

The task is partially observed: one reading says little, their sequence a lot. Here an LSTM has to remember; the
alternative is to hand the policy a memory, as features (see `sb3_ppo.py` and `baselines/features`).
"""

from __future__ import annotations

from pathlib import Path

import tyro
from sb3_contrib import RecurrentPPO

import osl_env
from baselines import make_policy
from baselines.features import RawFeatures
from training import evaluate
from training.sb3_vec_env import UavVecEnv

# success by reaching the source: easier to learn than to declare it, which is the default rule
SCENARIO = osl_env.load_scenario("rate-60x60x30-random", **{"ending.success": "reach"})
FEATURES = (RawFeatures(neighbours=2),)  # of a team of three
TEST_SEEDS = 50_000  # episodes that no training begins with


def main(
    steps: int = 1_000_000, worlds: int = 64, episodes: int = 50, seed: int = 0,
    path: Path = Path("results/sb3/recurrent.zip"),
) -> None:  # fmt: skip
    """Train, save, load and score.

    Args:
        steps: Decisions of UAVs to learn from.
        worlds: Worlds that the environment steps at once.
        episodes: Episodes of the evaluation.
        seed: Of weights and episodes.
        path: Where the zip is written.
    """
    env = UavVecEnv(SCENARIO, worlds, features=FEATURES, seed=seed)
    model = RecurrentPPO(
        "MlpLstmPolicy",
        env,
        n_steps=64,  # also the length of the sequences that the LSTM is trained on
        batch_size=16 * env.num_envs,
        n_epochs=4,
        policy_kwargs={"lstm_hidden_size": 64, "net_arch": [64]},
        seed=seed,
        device="cpu",
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    model.learn(steps).save(path)

    policy = make_policy("sb3", path=path)  # the LSTM's state begins at zero in each episode, and is kept through it
    records = evaluate(policy, SCENARIO, seeds=range(TEST_SEEDS, TEST_SEEDS + episodes))
    rate, minutes = 100 * records.values("success_rate").mean(), records.values("capped_search_time").mean() / 60
    print(f"success rate {rate:.0f} %, capped mean search time {minutes:.1f} min")


if __name__ == "__main__":
    tyro.cli(main)
