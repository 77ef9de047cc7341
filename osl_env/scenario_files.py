"""Scenarios from files: the shipped presets, and a user's YAML files of differences.

A file holds the differences from the defaults of `Scenario`, or from another preset named by its key `base`.
"""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any

from osl_env.configuration import config_folder, merged, read_yaml
from osl_env.errors import InputError
from osl_env.fields.references import found_beside
from osl_env.scenario import Scenario, build_scenario

_MAX_BASES = 8  # a chain of `base` keys longer than this is a loop


def scenario_names() -> list[str]:
    """The names of the shipped presets."""
    return sorted(path.stem for path in (config_folder() / "scenarios").glob("*.yaml"))


def _find(name: str, beside: Path | None) -> Path:
    shipped = config_folder() / "scenarios" / f"{name}.yaml"
    if "/" not in name and "\\" not in name and shipped.is_file():
        return shipped
    path = Path(name) if beside is None or Path(name).is_absolute() else beside / name
    if path.is_file():
        return path
    if path.suffix in (".yaml", ".yml"):
        raise InputError(f"{path}: no such scenario file")
    near = difflib.get_close_matches(name, scenario_names(), n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise InputError(f"unknown scenario {name!r}: {hint}allowed are {_allowed()}, or a YAML file")


def _allowed() -> str:
    """The presets' names; of a preset and its random variant the first, with a star."""
    names = scenario_names()
    plain = [name for name in names if not name.endswith("-random") or name.removesuffix("-random") not in names]
    starred = [f"{name}*" if f"{name}-random" in names else name for name in plain]
    return f"{', '.join(starred)} (*: also with -random)"


def _content(name: str, beside: Path | None = None, depth: int = 0) -> tuple[dict[str, Any], Path]:
    """The merged content of the scenario file `name` and of the bases that it names, and its path."""
    path = _find(name, beside)
    if depth > _MAX_BASES:
        raise InputError(f"{path}: base: more than {_MAX_BASES} files build on each other; is it a loop?")
    content = {"name": path.stem} | found_beside(read_yaml(path), path.parent)
    base = content.pop("base", None)
    if base is None:
        return content, path
    if not isinstance(base, str):
        raise InputError(f"{path}: base = {base!r}: must be the name or path of a scenario")
    return merged(_content(base, path.parent, depth + 1)[0], content), path


def load_scenario(scenario: str | Path | Scenario, **overrides: Any) -> Scenario:
    """The Scenario that `scenario` (a preset's name, a path, or a Scenario) means, with `overrides` laid over it.

    Overrides are nested mappings (`team={"n_uavs": 5}`) or dotted keys (`**{"radio.radius": "20 m"}`). Raises
    InputError for an unknown name, key or unit, or a value out of its limits, in one line.
    """
    if isinstance(scenario, Scenario):
        return scenario.override(**overrides) if overrides else scenario
    if not isinstance(scenario, str | Path):
        raise InputError(f"scenario = {scenario!r:.80}: must be a name, a path or a Scenario")
    content, path = _content(str(scenario))
    where: str | Path = path
    if path.parent == config_folder() / "scenarios":
        where = f"scenario {path.stem}"
    return build_scenario(merged(content, overrides), where)
