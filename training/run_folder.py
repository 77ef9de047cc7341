"""What a training keeps in its folder: the places of its files, and the trainer's own notes."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from training.held_out import Score


@dataclass
class RunFolder:
    """The places in a training's folder."""

    path: Path

    @property
    def config(self) -> Path:
        return self.path / "config.yaml"

    @property
    def state(self) -> Path:
        return self.path / "last" / "state.safetensors"

    @property
    def best(self) -> Path:
        return self.path / "best"

    @property
    def scores(self) -> Path:
        return self.path / "evaluations.csv"

    @property
    def tensorboard(self) -> Path:
        return self.path / "tensorboard"


@dataclass
class Diary:
    """What the trainer knows besides the model's state; saved with it."""

    scored_at: int = 0  # steps
    saved_at: int | None = None  # steps; None: never
    seconds: float = 0.0  # of training and scoring, resumptions included
    scores: list[Score] = field(default_factory=list)
    best: Score | None = None

    def notes(self) -> dict[str, Any]:
        """As JSON."""
        return asdict(self)

    @classmethod
    def of(cls, notes: dict[str, Any]) -> Diary:
        """From what `notes` gave."""
        scores = [Score(**each) for each in notes["scores"]]
        return cls(**notes | {"scores": scores, "best": Score(**notes["best"]) if notes["best"] else None})
