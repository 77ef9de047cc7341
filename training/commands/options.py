"""What several commands take: names of options, KEY=VALUE pairs, and JSON on stdout."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import tyro

from osl_env.errors import InputError

DEFAULT_STORE = Path("results/store")

Pairs = Annotated[tuple[str, ...], tyro.conf.arg(metavar="KEY=VALUE"), tyro.conf.UseAppendAction]
Count = Annotated[int, tyro.conf.arg(metavar="N")]
OptionalCount = Annotated[int | None, tyro.conf.arg(metavar="N", help_behavior_hint="")]
File = Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")]
Folder = Annotated[Path, tyro.conf.arg(metavar="FOLDER")]
OptionalFolder = Annotated[Path | None, tyro.conf.arg(metavar="FOLDER", help_behavior_hint="")]


def parse_pairs(pairs: Sequence[str], option: str) -> dict[str, Any]:
    """`team.n_uavs=4` -> {"team.n_uavs": 4}; values are read as YAML. Raises InputError for anything else."""
    import yaml

    values: dict[str, Any] = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        if not equals or not key.strip():
            raise InputError(f"{option} {pair}: must be KEY=VALUE")
        if key in values:
            raise InputError(f"{option} {pair}: {key} is given twice")
        try:
            values[key.strip()] = yaml.safe_load(text)
        except yaml.YAMLError:
            raise InputError(f"{option} {pair}: the value is not YAML") from None
    return values


def check_count(name: str, value: int | None, low: int = 1) -> None:
    """Raise InputError if `value` is below `low`."""
    if value is not None and value < low:
        raise InputError(f"--{name} {value}: must be at least {low}")


def print_json(content: object) -> None:
    """`content` on stdout as strict JSON: no value becomes null, infinity the text "inf"."""
    json.dump(_strict(content), sys.stdout, indent=1, allow_nan=False)
    sys.stdout.write("\n")


def _strict(content: object) -> object:
    if isinstance(content, dict):
        return {key: _strict(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_strict(value) for value in content]
    if isinstance(content, float) and not math.isfinite(content):
        return None if math.isnan(content) else "inf" if content > 0 else "-inf"
    return content
