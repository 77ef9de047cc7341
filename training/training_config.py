"""The configuration of a training: one YAML file of differences from the defaults below.

    name: ppo-raw
    steps: 20_000_000
    algorithm: {kind: ppo, n_steps: 64, batch_size: 4096}
    environment: {kind: uav, scenarios: [rate-100x60x30-random], n_worlds: 64, features: [{kind: raw}]}
    network: {kind: mlp, layers: [64, 64]}
    evaluation: {scenario: rate-100x60x30-random, seeds: {first: 50000, count: 200}, every: 1_000_000}
    checkpoints: {every: 500_000}

A step is one slot's: one UAV's decision. The names of hyperparameters are Stable-Baselines3's. Three kinds of seeds
never meet: episodes of training are drawn from 2^40 on, those that choose the best checkpoint lie below 100000, and
those from 100000 on belong to the benchmarks.
"""

from __future__ import annotations

import difflib
import importlib
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError

from osl_env.configuration import config_folder, read_yaml
from osl_env.errors import InputError
from osl_env.parameters import UNKNOWN_KEY, Parameters, one_line, quantity
from osl_env.scenario import Scenario
from osl_env.scenario_files import load_scenario
from training.training_blocks import Environment, Network

FIRST_TRAINING_SEED = 2**40
FIRST_BENCHMARK_SEED = 100_000
MAX_STEPS = 10**12


class LearningRate(Parameters):
    """Of Adam; from the first value to the last in proportion to the steps done."""

    learning_rate: float = quantity(3e-4, "", gt=0, le=1)
    final_learning_rate: float | None = quantity(None, "", ge=0, le=1)  # None: constant


class OnPolicy(LearningRate):
    """What PPO and RecurrentPPO share."""

    n_steps: int = quantity(64, "", ge=2, le=1_000_000)  # of each slot, a rollout
    batch_size: int = quantity(4096, "", ge=2)
    n_epochs: int = quantity(4, "", ge=1, le=1000)
    gamma: float = quantity(0.99, "", gt=0, le=1)
    gae_lambda: float = quantity(0.95, "", ge=0, le=1)
    clip_range: float = quantity(0.2, "", gt=0)
    normalize_advantage: bool = True
    ent_coef: float = quantity(0.0, "", ge=0)
    vf_coef: float = quantity(0.5, "", ge=0)
    max_grad_norm: float = quantity(0.5, "", gt=0)
    target_kl: float | None = quantity(None, "", gt=0)


class PPO(OnPolicy):
    """Proximal policy optimisation, one policy shared by all UAVs. Schulman et al. 2017."""

    kind: Literal["ppo"] = "ppo"


class RecurrentPPO(OnPolicy):
    """PPO through time: the policy keeps a memory of its episode. The network is of kind `lstm`."""

    kind: Literal["recurrent-ppo"] = "recurrent-ppo"


class OffPolicy(LearningRate):
    """What DQN and SAC share: a replay buffer, which is part of every checkpoint."""

    buffer_size: int = quantity(200_000, "", ge=1, le=10**9)  # transitions of all slots together
    learning_starts: int = quantity(10_000, "", ge=0)  # steps
    batch_size: int = quantity(256, "", ge=1)
    gamma: float = quantity(0.99, "", gt=0, le=1)
    train_freq: int = quantity(1, "", ge=1)  # steps of each slot between two updates
    gradient_steps: int = quantity(1, "", ge=1)  # an update
    tau: float = quantity(0.005, "", gt=0, le=1)  # of the target network's soft update


class DQN(OffPolicy):
    """Deep Q-network for hops. Mnih et al. 2015."""

    kind: Literal["dqn"] = "dqn"
    target_update_interval: int = quantity(10_000, "", ge=1)  # steps
    tau: float = quantity(1.0, "", gt=0, le=1)
    exploration_fraction: float = quantity(0.2, "", gt=0, le=1)  # of all steps
    exploration_initial_eps: float = quantity(1.0, "", ge=0, le=1)
    exploration_final_eps: float = quantity(0.05, "", ge=0, le=1)
    max_grad_norm: float = quantity(10.0, "", gt=0)


class SAC(OffPolicy):
    """Soft actor-critic for velocities and waypoints. Haarnoja et al. 2018."""

    kind: Literal["sac"] = "sac"
    ent_coef: Literal["auto"] | float = "auto"
    target_update_interval: int = quantity(1, "", ge=1)  # updates
    target_entropy: Literal["auto"] | float = "auto"


Algorithm = PPO | RecurrentPPO | DQN | SAC


class HeldOutSeeds(Parameters):
    """The seeds first, first + 1, .. of the episodes that choose the best checkpoint."""

    first: int = quantity(50_000, "", ge=0)
    count: int = quantity(100, "", ge=1, le=FIRST_BENCHMARK_SEED)

    @model_validator(mode="after")
    def _not_the_benchmarks(self) -> HeldOutSeeds:
        if self.first + self.count > FIRST_BENCHMARK_SEED:
            raise ValueError(
                f"first + count = {self.first + self.count}: must be at most {FIRST_BENCHMARK_SEED}: the seeds from"
                " there on are the benchmarks'"
            )
        return self


class Evaluation(Parameters):
    """Flights of the exported checkpoint on held-out seeds, which choose the best one."""

    scenario: str
    overrides: dict[str, Any] = Field(default_factory=dict)
    seeds: HeldOutSeeds = HeldOutSeeds()
    every: int = quantity(1_000_000, "", ge=1, le=MAX_STEPS)  # steps; and at the end
    jobs: int = quantity(1, "", ge=1, le=4096)  # processes
    stochastic: bool = False  # fly it with actions drawn from the network's distribution

    def made(self) -> Scenario:
        """The scenario that is flown. Raises InputError for an unknown name or a bad override."""
        return load_scenario(self.scenario, **self.overrides)


class Checkpoints(Parameters):
    """When the training's whole state is saved."""

    every: int = quantity(1_000_000, "", ge=1, le=MAX_STEPS)  # steps; and at the end


class TrainingConfig(Parameters):
    """One training."""

    name: str = Field("custom", pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")
    seed: int = quantity(0, "", ge=0, lt=2**32)
    steps: int = quantity(..., "", ge=1, le=MAX_STEPS)
    threads: int = quantity(1, "", ge=1, le=1024)  # of torch
    device: Literal["auto", "cpu", "cuda"] = "cpu"
    algorithm: Algorithm = quantity(..., "", discriminator="kind")
    environment: Environment
    network: Network
    evaluation: Evaluation
    checkpoints: Checkpoints = Checkpoints()

    @property
    def first_episode_seed(self) -> int:
        """From which the seeds of all training episodes are derived."""
        return FIRST_TRAINING_SEED + self.seed

    @property
    def summary(self) -> str:
        """One line: who learns what, and how long."""
        return (
            f"{self.algorithm.kind} in the environment {self.environment.kind}, network {self.network.kind},"
            f" {self.steps:,} steps"
        )

    def dump(self) -> dict[str, Any]:
        """All values, in JSON's types, whatever the kinds of the blocks."""
        return self.model_dump(mode="json", serialize_as_any=True)


# block -> kind -> where its class lies: other packages are imported only for the kinds that need them
_KINDS: dict[str, dict[str, str]] = {
    "algorithm": {
        "ppo": "training.training_config:PPO",
        "recurrent-ppo": "training.training_config:RecurrentPPO",
        "dqn": "training.training_config:DQN",
        "sac": "training.training_config:SAC",
    },
    "environment": {
        "uav": "training.environments:UavEnvironment",
        "course": "training.environments:CourseEnvironment",
        "search": "training.search_environment:SearchEnvironment",
    },
    "network": {
        "mlp": "training.training_blocks:MLP",
        "lstm": "training.training_blocks:LSTM",
        "team": "training.training_blocks:Team",
    },
}


def register_kind(block: str, kind: str, place: str) -> None:
    """Make `kind` known in `block` (algorithm, environment, network): `place` is module:class of its Parameters."""
    _KINDS[block][kind] = place


def _block(name: str, content: Any, where: str | Path) -> Any:
    """The Parameters object that the block `name` of a file means. A bare text is its kind."""
    if isinstance(content, Parameters):
        return content
    kinds = _KINDS[name]
    values = {"kind": content} if isinstance(content, str) else content
    if not isinstance(values, dict):
        raise InputError(f"{where}: {name} = {content!r:.80}: must be a mapping with the key kind")
    kind = values.get("kind")
    if kind not in kinds:
        near = difflib.get_close_matches(str(kind), kinds, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise InputError(f"{where}: {name}.kind = {kind!r}: {hint}allowed are {', '.join(kinds)}")
    module, _, attribute = kinds[kind].partition(":")
    block: type[Parameters] = getattr(importlib.import_module(module), attribute)
    try:
        return block.model_validate(values)
    except ValidationError as error:
        raise one_line(_under(name, error), where) from None


def _under(name: str, error: ValidationError) -> ValidationError:
    """`error` with all paths below the key `name`."""
    details = []
    for each in error.errors():
        context = each.get("ctx", {})
        kind: str | PydanticCustomError = each["type"]
        if kind == UNKNOWN_KEY:
            kind = PydanticCustomError(UNKNOWN_KEY, "unknown key {key}", context)
        details.append(InitErrorDetails(type=kind, loc=(name, *each["loc"]), input=each["input"], ctx=context))
    return ValidationError.from_exception_data(error.title, details)


def make_config(content: dict[str, Any], where: str | Path = "training") -> TrainingConfig:
    """The TrainingConfig that `content`, a file's mapping, means. Raises InputError naming `where` and the key."""
    blocks = {name: _block(name, content[name], where) for name in _KINDS if name in content}
    try:
        config = TrainingConfig.model_validate(content | blocks)
        config.evaluation.made()
    except ValidationError as error:
        raise one_line(error, where) from None
    except InputError as error:
        raise InputError(f"{where}: evaluation: {error}") from None
    return config


def training_names() -> list[str]:
    """The names of the shipped configurations."""
    return sorted(path.stem for path in (config_folder() / "training").glob("*.yaml"))


def load_training(name: str | Path, **changes: Any) -> TrainingConfig:
    """The configuration in the file `name`, or the shipped one of that name, with `changes` to its top-level keys.

    Its own name is by default the file's. Raises InputError, naming file and key.
    """
    path = config_folder() / "training" / f"{name}.yaml"
    if "/" in str(name) or not path.is_file():
        path = Path(name)
    if not path.is_file():
        near = difflib.get_close_matches(str(name), training_names(), n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        allowed = ", ".join(training_names())
        raise InputError(f"unknown training {str(name)!r}: {hint}allowed are {allowed}, or a YAML file")
    return make_config({"name": path.stem} | read_yaml(path) | changes, path)
