"""Many episode records: as a table, as a summary with intervals, and as a file."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import IO, TYPE_CHECKING

import numpy as np

from osl_env.errors import InputError
from osl_env.parameters import FloatArray
from osl_env.record import EpisodeRecord

if TYPE_CHECKING:
    import pandas as pd

    from training.statistics import Estimate

# measure -> its value in one record, SI units: 0 or 1 for rates; NaN leaves an episode out of a mean
RATES: dict[str, Callable[[EpisodeRecord], float]] = {
    "success_rate": lambda record: float(record.success),
    "false_declaration_rate": lambda record: float(record.false_declaration),
}
MEANS: dict[str, Callable[[EpisodeRecord], float]] = {
    "capped_search_time": lambda record: record.search_time,
    "search_time_of_successes": lambda record: record.search_time if record.success else math.nan,
    "mission_time": lambda record: record.mission_time,
    "first_detection_time": lambda record: record.first_detection_time,
    "detections": lambda record: record.detections,
    "declaration_error": lambda record: record.declaration_error,
    "decisions": lambda record: record.decisions,
    "team_path": lambda record: record.team_path,
    "n_flights": lambda record: record.n_flights,
    "n_hovers": lambda record: record.n_hovers,
    "n_turns": lambda record: record.n_turns,
    "waiting_time": lambda record: record.waiting_time,
    "energy": lambda record: record.energy,
    "energy_flying": lambda record: record.energy_flying,
    "energy_hovering": lambda record: record.energy_hovering,
    "energy_turning": lambda record: record.energy_turning,
    "energy_waiting": lambda record: record.energy_waiting,
    "energy_computing": lambda record: record.energy_computing,
    "energy_communicating": lambda record: record.energy_communicating,
    "messages": lambda record: record.messages,
    "bytes": lambda record: record.bytes,
    "reward": lambda record: record.reward,
    "decision_seconds": lambda record: record.decision_seconds,
}


class EpisodeRecords(list[EpisodeRecord]):
    """The records of `training.evaluate`, in the order of the seeds."""

    def to_frame(self) -> pd.DataFrame:
        """One row an episode, one column a field of EpisodeRecord and `energy`; `parameters` as JSON text."""
        import pandas as pd

        rows = [
            {**record.to_dict(), "parameters": json.dumps(record.parameters), "energy": record.energy}
            for record in self
        ]
        frame = pd.DataFrame(rows)
        times = [name for name in ("declaration_error", "first_detection_time", "decision_seconds") if rows]
        return frame.astype(dict.fromkeys(times, float))

    def values(self, measure: str) -> FloatArray:
        """(n,) the episodes' values of one of `RATES` or `MEANS`, SI units."""
        value_of = (RATES | MEANS)[measure]
        return np.array([value_of(record) for record in self], dtype=np.float64)

    def estimate(self, measure: str) -> Estimate:
        """The mean of `values` with its 95 % interval: Wilson's for one of `RATES`, bootstrap for one of `MEANS`."""
        from training.statistics import bootstrap_mean, wilson  # slow to import, and no worker process needs it

        values = self.values(measure)
        return wilson(int(values.sum()), values.size) if measure in RATES else bootstrap_mean(values)

    def summary(self) -> dict[str, Estimate]:
        """Every measure's estimate over all records, SI units."""
        return {measure: self.estimate(measure) for measure in (*RATES, *MEANS)}

    def common_seeds(self, other: EpisodeRecords) -> tuple[EpisodeRecords, EpisodeRecords]:
        """The records of both that share a seed, row by row: the pairs of a paired comparison."""
        mine, theirs = ({record.seed: record for record in records} for records in (self, other))
        seeds = [seed for seed in mine if seed in theirs]
        return EpisodeRecords(mine[seed] for seed in seeds), EpisodeRecords(theirs[seed] for seed in seeds)


def write_text(path: Path, text: str) -> None:
    """Write `text` to `path` whole or not at all. Raises InputError if that cannot be written."""
    _write_whole(path, lambda part: part.write_text(text, encoding="utf-8"))


def write_bytes(path: Path, fill: Callable[[IO[bytes]], object]) -> None:
    """Let `fill` write into the file `path`, which appears whole or not at all."""

    def write(part: Path) -> None:
        with part.open("wb") as file:
            fill(file)

    _write_whole(path, write)


def write_table(path: Path, frame: pd.DataFrame) -> None:
    """Write `frame` as .csv, .json (records) or .parquet, whole or not at all.

    Raises InputError for another suffix, an unwritable place, or Parquet without pyarrow.
    """
    if path.suffix == ".csv":
        _write_whole(path, lambda part: frame.to_csv(part, index=False))
    elif path.suffix == ".json":
        _write_whole(path, lambda part: frame.to_json(part, orient="records", indent=1))
    elif path.suffix == ".parquet":
        try:
            _write_whole(path, lambda part: frame.to_parquet(part, index=False))
        except ImportError:
            raise InputError(f"{path}: Parquet needs pyarrow (pip install 'osl-env[parquet]')") from None
    else:
        raise InputError(f"{path}: the suffix must be .csv, .json or .parquet")


def check_output(path: Path, suffixes: Iterable[str]) -> None:
    """Fail before hours of episodes, not after: InputError if `path` cannot be written later."""
    allowed = list(suffixes)
    if path.suffix not in allowed:
        raise InputError(f"{path}: the suffix must be {', '.join(allowed)}")
    make_folder(path.parent)
    if path.is_dir() or not os.access(path.parent, os.W_OK):
        raise InputError(f"{path}: cannot be written")


def make_folder(folder: Path) -> None:
    """Make `folder` and its parents. Raises InputError if that is impossible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror})") from None


def _write_whole(path: Path, write: Callable[[Path], object]) -> None:
    make_folder(path.parent)
    part = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        write(part)
        part.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from None
    finally:
        part.unlink(missing_ok=True)
