"""Small models with random weights, for tests of what flies them."""

from __future__ import annotations

import copy
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from baselines.features import FeatureSpec, make_spec, spec_size, spec_slices
from baselines.learned.checkpoint import Checkpoint, CheckpointHeader, ScenarioMark
from baselines.learned.network import Architecture
from baselines.learned.pilot import ActionDefinition, observation_of
from baselines.search_agent.crew import SearchView
from baselines.search_agent.levers import N_LEVERS, N_SITUATION
from baselines.search_agent.policy import SearchAction, observation_definition
from osl_env import Scenario
from osl_env.agent_actions import BOX_SIZES, n_hop_actions

RAW: list[dict[str, Any]] = [{"kind": "raw"}]


def architecture(agent: str, kind: str, spec: FeatureSpec, outputs: int) -> dict[str, Any]:
    """A small network of `kind`; a team's entries are those of the last feature."""
    content: dict[str, Any] = {"kind": kind, "inputs": spec_size(spec), "hidden": [16], "outputs": outputs}
    content["head"] = "logits" if agent == "hop" else "gaussian"
    if kind == "lstm":
        content["lstm"] = {"size": 12}
    if kind == "team":
        slots = spec_slices(spec)[-1]
        size = {"team": 10, "raw": 7}[spec[-1].kind]
        start = slots.stop - 7 * size
        content["team"] = {"start": start, "slots": 7, "slot_size": size, "embedding": 8}
    return content


def random_checkpoint(
    scenario: Scenario, kind: str = "mlp", features: Any = RAW, seed: int = 1, scale: float = 1.0
) -> Checkpoint:
    """A checkpoint for the agent that `scenario.action` says, with random weights of standard deviation `scale`.

    It never declares.
    """
    agent, spec = scenario.action, make_spec(features)
    outputs = n_hop_actions(scenario.vehicle.hop_lengths) if agent == "hop" else BOX_SIZES[agent]
    content = architecture(agent, kind, spec, outputs)
    rng = np.random.default_rng(seed)
    shapes = Architecture.parse(content, "test").shapes()
    arrays = {name: (scale * rng.standard_normal(shape)).astype(np.float32) for name, shape in shapes.items()}
    arrays["action.bias"][-1] = -50.0  # the last output declares: it would end the episodes at once
    header = CheckpointHeader(
        name="random",
        agent=agent,
        algorithm="none",
        architecture=content,
        observation=observation_of(spec),
        action=ActionDefinition.of(agent, scenario.vehicle).as_mapping(),
        max_uavs=8,
        scenario=ScenarioMark(name=scenario.name, hash=scenario.hash),
    )
    return Checkpoint(header, arrays)


def search_checkpoint(folder: Path, seed: int = 1) -> Path:
    """A checkpoint of the agent `search` with random weights, written to `folder`."""
    content = {"kind": "mlp", "inputs": N_SITUATION, "hidden": [16], "outputs": N_LEVERS, "head": "gaussian"}
    rng = np.random.default_rng(seed)
    shapes = Architecture.parse(content, "test").shapes()
    arrays = {name: (0.3 * rng.standard_normal(shape)).astype(np.float32) for name, shape in shapes.items()}
    header = CheckpointHeader(
        name="random-search",
        agent="search",
        algorithm="none",
        architecture=content,
        observation=observation_definition(SearchView()),
        action=SearchAction().model_dump(),
        max_uavs=8,
        scenario=ScenarioMark(name="rate-100x60x30-random", hash=""),
    )
    return Checkpoint(header, arrays).write(folder)


def write_sb3(path: Path, scenario: Scenario, algorithm: str = "PPO", **keywords: Any) -> Path:
    """An untrained SB3 model for one UAV of `scenario`, saved as a zip. Needs SB3."""
    import sb3_contrib
    import stable_baselines3

    from osl_env.envs.single import SoloEnv

    solo = SoloEnv(scenario.override(**{"team.n_uavs": 1}))
    learner = sb3_contrib.RecurrentPPO if algorithm == "RecurrentPPO" else getattr(stable_baselines3, algorithm)
    policy = "MlpLstmPolicy" if algorithm == "RecurrentPPO" else "MlpPolicy"
    sizes = {"buffer_size": 10} if algorithm in ("DQN", "SAC") else {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # a copy: SB3 writes into the policy's keywords
        learner(policy, solo, seed=1, device="cpu", **(sizes | copy.deepcopy(keywords))).save(path)
    return path
