"""TorchRL: multi-agent PPO on the PettingZoo environment; the critic sees what one UAV sees (IPPO) or all (MAPPO).

    pip install "osl-env[torchrl]"
    python examples/torchrl_multi_agent.py --steps 100000 --centralised

Three things that this environment needs, and others too:
- UAVs end one by one, so `done_on_any=False` (the episode goes on) and `use_mask=True` (the ended are marked);
- rows of ended UAVs are zeros and must not be learned from: they are dropped after the advantages are computed;
- each UAV has its own done and terminated flags; a UAV whose time is up is truncated, and its value bootstrapped.
"""

from __future__ import annotations

from pathlib import Path

import torch
import tyro
from as_checkpoint import score, write_checkpoint
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule
from torch import nn
from torch.distributions import Categorical
from torchrl.collectors import Collector
from torchrl.envs.libs.pettingzoo import PettingZooWrapper
from torchrl.modules import ProbabilisticActor
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

import osl_env

# success by reaching the source: easier to learn than to declare it, which is the default rule
SCENARIO = osl_env.load_scenario("rate-60x60x30-random", **{"ending.success": "reach"})
EPOCHS = 5  # over each batch
UAV = "uav"  # TorchRL groups uav_0, uav_1, .. under this name: tensors (steps, n_uavs, ..)


def main(
    steps: int = 100_000, centralised: bool = False, episodes: int = 20, seed: int = 0,
    folder: Path = Path("results/torchrl/ippo"),
) -> None:  # fmt: skip
    """Train on `steps` steps of one team, write a checkpoint and score it.

    Args:
        steps: Steps of the team.
        centralised: The critic sees the team's state (MAPPO) instead of the UAV's own observation (IPPO).
        episodes: Episodes of the evaluation.
        seed: Of weights and episodes.
        folder: Where the checkpoint is written.
    """
    torch.manual_seed(seed)
    team = osl_env.parallel_env(SCENARIO)
    env = PettingZooWrapper(team, use_mask=True, done_on_any=False, return_state=True, seed=seed)
    n_inputs, n_actions = team.observation_space("uav_0").shape[0], int(team.action_space("uav_0").n)
    actor, network = make_actor(n_inputs, n_actions, env)
    critic = make_critic(team.state_space.shape[0] if centralised else n_inputs, centralised)

    gae = GAE(gamma=0.99, lmbda=0.95, value_network=critic)
    loss = ClipPPOLoss(actor, critic, clip_epsilon=0.2, entropy_coeff=0.01, normalize_advantage=True)
    for part in (gae, loss):  # where the UAVs' own numbers are
        part.set_keys(value=(UAV, "state_value"), advantage=(UAV, "advantage"), value_target=(UAV, "value_target"))
        part.set_keys(reward=(UAV, "reward"), done=(UAV, "done"), terminated=(UAV, "terminated"))
    loss.set_keys(action=(UAV, "action"), sample_log_prob=(UAV, "action_log_prob"))
    optimiser = torch.optim.Adam(loss.parameters(), lr=1e-3)

    batch_size = min(1000, steps)
    collector = Collector(
        env, actor, frames_per_batch=batch_size, total_frames=steps, auto_register_policy_transforms=False
    )
    for batch in collector:
        learn(batch, gae, loss, optimiser)
        report(batch)
    write_checkpoint(folder, [each for each in network if isinstance(each, nn.Linear)], "tanh", SCENARIO, "ippo")
    score(folder, SCENARIO, episodes)


def mlp(n_inputs: int, n_outputs: int) -> nn.Sequential:
    """Two hidden layers; one network for all UAVs, applied along the last dimension."""
    return nn.Sequential(nn.Linear(n_inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, n_outputs))


def make_actor(n_inputs: int, n_actions: int, env: PettingZooWrapper) -> tuple[ProbabilisticActor, nn.Sequential]:
    """The actor and its network: own observation -> distribution over hops."""
    network = mlp(n_inputs, n_actions)
    logits = TensorDictModule(network, in_keys=[(UAV, "observation")], out_keys=[(UAV, "logits")])
    actor = ProbabilisticActor(
        logits,
        spec=env.full_action_spec_unbatched,
        in_keys={"logits": (UAV, "logits")},
        out_keys=[(UAV, "action")],
        distribution_class=Categorical,
        return_log_prob=True,
        log_prob_key=(UAV, "action_log_prob"),
    )
    return actor, network


def make_critic(n_inputs: int, centralised: bool) -> TensorDictModule:
    """The critic: a value for each UAV, of its own observation or of the team's state (see `learn`)."""
    seen = "team_state" if centralised else "observation"
    return TensorDictModule(mlp(n_inputs, 1), in_keys=[(UAV, seen)], out_keys=[(UAV, "state_value")])


def learn(batch: TensorDictBase, gae: GAE, loss: ClipPPOLoss, optimiser: torch.optim.Optimizer) -> None:
    """One round of PPO on a batch (steps,) of consecutive steps."""
    n_uavs = batch[UAV, "mask"].shape[-1]
    for frame in (batch, batch["next"]):  # the state for each UAV, as the critic of the team takes it
        frame[UAV, "team_state"] = frame["state"].unsqueeze(-2).expand(-1, n_uavs, -1)
    with torch.no_grad():
        gae(batch)
    flying = batch[UAV, "mask"]  # (steps, n_uavs): who was still flying before the step
    rows = batch[UAV].select(
        "observation", "team_state", "action", "action_log_prob", "state_value", "advantage", "value_target"
    )[flying]
    for _ in range(EPOCHS):
        for chosen in torch.randperm(len(rows)).split(256):
            losses = loss(TensorDict({UAV: rows[chosen]}, batch_size=[len(chosen)]))
            total = losses["loss_objective"] + losses["loss_critic"] + losses["loss_entropy"]
            optimiser.zero_grad()
            total.backward()
            nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
            optimiser.step()


def report(batch: TensorDictBase) -> None:
    """Print how the episodes went that ended within `batch`."""
    over = batch["next", "done"].squeeze(-1)
    if over.any():
        last = batch["next", UAV, "info"][over]
        success, minutes = last["success"].amax(dim=-1).mean(), last["clock"].amax(dim=-1).mean() / 60
        print(f"{int(over.sum())} episodes: success rate {100 * success:.0f} %, mean mission time {minutes:.1f} min")


if __name__ == "__main__":
    tyro.cli(main)
