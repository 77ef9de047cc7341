"""Scores on held-out seeds: the network is exported, and the exported checkpoint is flown as any policy is.

So what is scored is what ships. The best checkpoint is the one of the shortest capped search time (a failure counts as
the time limit), the leaderboard's figure; ties go to the higher success rate, then to the higher reward.
"""

from __future__ import annotations

import csv
import io
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from stable_baselines3.common.base_class import BaseAlgorithm

from baselines import make_policy
from baselines.learned.checkpoint import Checkpoint, CheckpointHeader, ScenarioMark
from training.networks import exported
from training.provenance import versions
from training.records import write_text
from training.sweep import evaluate
from training.training_config import TrainingConfig


@dataclass(frozen=True)
class Score:
    """Means over the held-out episodes of the network after `steps` steps; SI units."""

    steps: int
    episodes: int
    success_rate: float
    capped_search_time: float  # s
    mission_time: float  # s
    false_declaration_rate: float
    detections: float
    reward: float

    @property
    def order(self) -> tuple[float, float, float]:
        """The lower, the better."""
        return self.capped_search_time, -self.success_rate, -self.reward

    def beats(self, other: Score | None) -> bool:
        """Whether this is the better one, and not the same."""
        return other is None or self.order < other.order

    def line(self) -> str:
        """For people."""
        return (
            f"success rate {100 * self.success_rate:.0f} %, capped MST {self.capped_search_time / 60:.2f} min"
            f" ({self.episodes} held-out episodes, after {self.steps:,} steps)"
        )


def make_checkpoint(
    model: BaseAlgorithm, config: TrainingConfig, *, command: str, seconds: float, scores: dict[str, Any] | None = None
) -> Checkpoint:
    """The network of `model` as it ships. Raises InputError for weights that are not finite."""
    policy: Any = model.policy
    architecture, arrays = policy.exported() if hasattr(policy, "exported") else exported(model)
    task = config.environment.task()
    header = CheckpointHeader(
        name=config.name,
        agent=task.agent,
        algorithm=config.algorithm.kind,
        architecture=architecture,
        observation=task.observation,
        action=task.action,
        max_uavs=task.max_uavs,
        scenario=ScenarioMark(name=task.scenario.name, hash=task.scenario.hash),
        training={
            "command": command,
            "config": config.dump(),
            "seed": config.seed,
            "steps": model.num_timesteps,
            "seconds": round(seconds, 1),
            "versions": versions(),
        },
        scores=scores or {},
    )
    return Checkpoint(header, arrays)


def score(checkpoint: Checkpoint, config: TrainingConfig, folder: Path) -> Score:
    """Fly `checkpoint`, written below `folder` for as long as that takes, on the held-out seeds."""
    evaluation = config.evaluation
    steps = int(checkpoint.header.training["steps"])
    place = folder / f".candidate-{steps}"
    try:
        checkpoint.write(place)
        records = evaluate(
            make_policy("checkpoint", path=str(place), stochastic=evaluation.stochastic),
            evaluation.made(),
            range(evaluation.seeds.first, evaluation.seeds.first + evaluation.seeds.count),
            n_jobs=evaluation.jobs,
            progress=False,
        )
    finally:
        shutil.rmtree(place, ignore_errors=True)
    measures = {name: float(records.values(name).mean()) for name in [field.name for field in fields(Score)][2:]}
    return Score(steps=steps, episodes=len(records), **measures)


def with_score(checkpoint: Checkpoint, found: Score, config: TrainingConfig) -> Checkpoint:
    """`checkpoint` with its score in the header."""
    held_out = asdict(found) | {"scenario": config.evaluation.scenario, "first_seed": config.evaluation.seeds.first}
    header = checkpoint.header.model_copy(update={"scores": {"held_out": held_out}})
    return replace(checkpoint, header=header)


def write_scores(path: Path, scores: Sequence[Score]) -> None:
    """All scores so far as CSV, whole or not at all."""
    text = io.StringIO()
    table = csv.DictWriter(text, [field.name for field in fields(Score)], lineterminator="\n")
    table.writeheader()
    table.writerows(asdict(each) for each in scores)
    write_text(path, text.getvalue())
