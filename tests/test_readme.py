"""The README promises only what works: its code runs, its names and paths exist."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import osl_env
from baselines import policy
from osl_env.fields import Field, save_field
from osl_env.observation import ObservationLayout

REPOSITORY = Path(__file__).resolve().parent.parent
README = (REPOSITORY / "README.md").read_text(encoding="utf-8")
PYTHON = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
YAML = re.findall(r"```yaml\n(.*?)```", README, re.DOTALL)
COMMANDS = re.findall(r"^(osl (?:run|bench|reproduce|list|plume).*?)(?:\s+#.*)?$", README, re.MULTILINE)


@pytest.mark.parametrize("code", PYTHON, ids=[f"block {i}" for i in range(len(PYTHON))])
def test_python_runs(code: str) -> None:
    names: dict[str, Any] = {"__name__": "readme"}
    try:
        exec(compile(code.replace("range(20)", "range(2)"), "README.md", "exec"), names)
    finally:  # a policy of the README is not kept; those of modules that were imported are
        for name in [name for name, made in policy._REGISTRY.items() if made.__module__ == "readme"]:
            del policy._REGISTRY[name]
    if "table" in names:
        assert len(names["table"]) == 2


@pytest.mark.parametrize("text", YAML)
def test_scenario_file_loads(text: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    if "mine.npz" in text:  # as `osl plume import` would have written it
        solid = np.zeros((20, 15, 3), np.uint8)
        solid[8, 4:10] = 1
        field = Field(np.zeros(1), np.full(3, 0.5), np.ones(3), wind=np.ones((1, *solid.shape, 3)), solid=solid)
        save_field(field, tmp_path / "mine.npz")
    scenario = osl_env.load_scenario(path)
    assert scenario.name == "mine"
    given = yaml.safe_load(text)
    assert scenario.hash != osl_env.load_scenario(given["base"]).hash
    if "time_limit" in given.get("ending", {}):
        assert scenario.ending.time_limit == 900.0  # 15 min


def test_commands_are_understood() -> None:
    import shlex

    from training.cli import _parse

    assert len(COMMANDS) >= 5
    for command in COMMANDS:
        _parse(shlex.split(command)[1:])


def test_observation_table_is_complete() -> None:
    table = README.split("### Observation")[1].split("### Action")[0]
    layout = ObservationLayout(osl_env.load_scenario("rate-100x60x30"))
    for field in layout.fields:
        kind, _, part = field.name.partition("_")
        short = f"`_{part}`" if kind in ("detection", "neighbour") else ""
        assert f"`{field.name}`" in table or (short and short in table), field.name


def test_every_policy_and_path_is_there() -> None:
    for name in policy._MODULES:  # the shipped ones, not those that other tests register
        assert f"`{name}`" in README, name
    for path in re.findall(r"`((?:osl_env|baselines|training|configs|docs)/[\w/.*-]+)`", README):
        assert list(REPOSITORY.glob(path)), path
