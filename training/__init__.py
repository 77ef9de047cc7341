"""Everything that measures: the runner, its store and statistics, the tables, and the command line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from training.records import EpisodeRecords
    from training.sweep import evaluate

__all__ = ["EpisodeRecords", "evaluate"]


def __getattr__(name: str) -> Any:
    """Import what is asked for, when it is: `osl --help` loads no simulator."""
    if name == "evaluate":
        from training.sweep import evaluate

        return evaluate
    if name == "EpisodeRecords":
        from training.records import EpisodeRecords

        return EpisodeRecords
    raise AttributeError(f"module 'training' has no attribute {name!r}")
