"""A plain network from any library as a checkpoint of this package: flown without that library, scored like all others.

Used by `torchrl_multi_agent.py` and `rllib_multi_agent.py`. A network that takes the flat observation of
`osl_env.parallel_env` and gives one number for each hop becomes a folder of two files (safetensors and YAML), which
`make_policy("checkpoint", path=FOLDER)` flies with numpy.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from torch import nn

from baselines import make_policy
from baselines.features import RawFeatures
from baselines.learned.checkpoint import Checkpoint, CheckpointHeader, ScenarioMark
from baselines.learned.pilot import ActionDefinition, observation_of
from osl_env import Scenario
from training import evaluate


def write_checkpoint(
    folder: Path, layers: Sequence[nn.Linear], activation: str, scenario: Scenario, algorithm: str
) -> None:
    """Write the actor made of `layers`, with `activation` ("tanh" or "relu") between them, to `folder`."""
    *hidden, last = layers
    names = [f"hidden.{number}" for number in range(len(hidden))] + ["action"]
    arrays = {}
    for name, layer in zip(names, layers, strict=True):
        arrays[f"{name}.weight"] = layer.weight.detach().cpu().float().numpy()
        arrays[f"{name}.bias"] = layer.bias.detach().cpu().float().numpy()
    n_uavs = scenario.team.n_uavs
    header = CheckpointHeader(
        name=folder.name,
        agent="hop",
        algorithm=algorithm,
        architecture={
            "kind": "mlp",
            "inputs": layers[0].in_features,
            "hidden": [layer.out_features for layer in hidden],
            "activation": activation,
            "outputs": last.out_features,
            "head": "logits",
        },
        observation=observation_of((RawFeatures(neighbours=n_uavs - 1),)),  # the flat vector of the environments
        action=ActionDefinition.of("hop", scenario.vehicle).as_mapping(),
        max_uavs=n_uavs,
        scenario=ScenarioMark(name=scenario.name, hash=scenario.hash),
    )
    folder.parent.mkdir(parents=True, exist_ok=True)
    Checkpoint(header, arrays).write(folder)


def score(folder: Path, scenario: Scenario, episodes: int, first_seed: int = 50_000) -> None:
    """Fly the checkpoint in `folder` and print success rate and search time, failures at the time limit."""
    policy = make_policy("checkpoint", path=folder)
    records = evaluate(policy, scenario, seeds=range(first_seed, first_seed + episodes))
    rate, minutes = 100 * records.values("success_rate").mean(), records.values("capped_search_time").mean() / 60
    print(f"success rate {rate:.0f} %, capped mean search time {minutes:.1f} min ({folder})")
