"""What the commands of `osl plume` share: names of options, checks, and how they say what they have written."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from osl_env.errors import InputError
from training.commands.options import Pairs, parse_pairs, print_json

if TYPE_CHECKING:
    from training.plume_subjects import Subject

Name = Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="NAME")]
Seconds = Annotated[float, tyro.conf.arg(metavar="S")]
OptionalSeconds = Annotated[float | None, tyro.conf.arg(metavar="S", help_behavior_hint="")]
OptionalMetres = Annotated[float | None, tyro.conf.arg(metavar="M", help_behavior_hint="")]
Output = Annotated[Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint="", aliases=["--out"])]


def named_subject(name: str, seed: int, changes: Pairs) -> Subject:
    """The scenario or field `name` in the episode with `seed`, with KEY=VALUE `changes`. Raises InputError."""
    from osl_env.streams import check_seed
    from training.plume_subjects import find_subject

    return find_subject(name, check_seed(seed), parse_pairs(changes, "--set"))


LONGEST = 86400.0  # s that a command simulates: a day


def check_times(**options: float | None) -> None:
    """Raise InputError for an option that is not above 0 and finite, or --seconds above a day."""
    for name, value in options.items():
        if value is not None and not 0 < value < math.inf:
            raise InputError(f"--{name} {value:g}: must be above 0 and finite")
        if name == "seconds" and value is not None and value > LONGEST:
            raise InputError(f"--seconds {value:g}: must be at most {LONGEST:g}, a day")


def progress_bar(total: int, unit: str, silent: bool) -> Any:
    """A progress bar on a terminal; none if `silent`."""
    from tqdm import tqdm

    return tqdm(total=total, unit=unit, leave=False, disable=True if silent else None)


def say_written(paths: list[Path], as_json: bool) -> None:
    """Print `paths`."""
    if as_json:
        print_json({"files": [str(path) for path in paths]})
    else:
        for path in paths:
            print(path)
