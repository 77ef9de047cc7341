"""A benchmark: scenarios x policies x seeds, fixed beforehand in a YAML file.

    title: ...
    seeds: {first: 0, count: 200}
    scenarios: [rate-60x60x30, {scenario: rate-100x60x30, overrides: {team.n_uavs: 4}, label: four UAVs}]
    policies: [muc-osl, {policy: muc-osl, parameters: {particles: 160}, label: 160 particles, episodes: 50}]
    sweep: {of: scenario, key: team.n_uavs, values: [1, 2, 3], label: UAVs}     # optional: one parameter varied
    compare: muc-osl     # optional: the policy (or a list) that the others are tested against; else each group's best

A swept scenario may name a key of its own, `{scenario: .., swept: uav_faults.lost_uav.number}`, which takes the values
instead of the sweep's.

Every policy flies the same seeds, so the same worlds; `episodes` gives a slow policy the first few of them only.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError, field_validator, model_validator

from baselines import Policy, make_policy
from osl_env.configuration import config_folder, read_yaml
from osl_env.errors import InputError
from osl_env.parameters import Parameters, one_line, quantity
from osl_env.scenario import Scenario
from osl_env.scenario_files import load_scenario
from osl_env.streams import MAX_SEED, check_seed
from training.records import EpisodeRecords
from training.store import Store
from training.sweep import Cell, run_cells


class Seeds(Parameters):
    """The seeds first, first + 1, .. of the episodes."""

    first: int = quantity(0, "", ge=0, le=MAX_SEED)
    count: int = quantity(200, "", ge=1, le=1_000_000)


class ScenarioEntry(Parameters):
    """A scenario with overrides, under a label."""

    scenario: str
    overrides: dict[str, Any] = Field(default_factory=dict)
    label: str = ""
    swept: str = ""  # the key that a sweep varies in this scenario; empty: the sweep's own

    def made(self, **changes: Any) -> Scenario:
        """The scenario, with `changes` on top of the overrides."""
        return load_scenario(self.scenario, **(self.overrides | changes))


class PolicyEntry(Parameters):
    """A policy with parameters, under a label."""

    policy: str
    parameters: dict[str, Any] = Field(default_factory=dict)
    label: str = ""
    episodes: int | None = quantity(None, "", ge=1)  # the first few seeds only; None: all

    def made(self, **changes: Any) -> Policy:
        """The policy, with `changes` on top of the parameters."""
        return make_policy(self.policy, **(self.parameters | changes))


class Sweep(Parameters):
    """One parameter of all scenarios or of all policies, given each of `values` in turn."""

    of: Literal["scenario", "policy"] = "scenario"
    key: str = ""  # empty: each scenario names its own
    values: tuple[float, ...] = quantity(..., "", infinite=True, min_length=1)
    label: str = ""


@dataclass(frozen=True)
class Case:
    """One row of a benchmark's table: what is run, and how it is called."""

    scenario: str  # labels
    policy: str
    value: float | None  # of the swept parameter
    cell: Cell


@dataclass(frozen=True)
class Result:
    """A case and its episodes."""

    case: Case
    records: EpisodeRecords


class Benchmark(Parameters):
    """Scenarios x policies x seeds, and perhaps a swept parameter."""

    title: str
    note: str = ""
    seeds: Seeds = Seeds()
    scenarios: tuple[ScenarioEntry, ...] = Field(min_length=1)
    policies: tuple[PolicyEntry, ...] = Field(min_length=1)
    sweep: Sweep | None = None
    compare: tuple[
        str, ...
    ] = ()  # labels of policies; empty: each group's best, which is picked from the same episodes

    @field_validator("compare", mode="before")
    @classmethod
    def _one_or_more(cls, labels: Any) -> Any:
        return (labels,) if isinstance(labels, str) else labels

    @field_validator("scenarios", "policies", mode="before")
    @classmethod
    def _bare_names(cls, entries: Any, info: Any) -> Any:
        key = "scenario" if info.field_name == "scenarios" else "policy"
        if isinstance(entries, list | tuple):
            return [{key: entry} if isinstance(entry, str) else entry for entry in entries]
        return entries

    @model_validator(mode="after")
    def _labels_differ(self) -> Benchmark:
        for key, labels in (
            ("scenarios", [entry.label or entry.scenario for entry in self.scenarios]),
            ("policies", [entry.label or entry.policy for entry in self.policies]),
        ):
            for label in labels:
                if labels.count(label) > 1:
                    raise ValueError(f"{key}: {label!r} comes twice; give each a label of its own")
        flown = [entry.label or entry.policy for entry in self.policies]
        for label in self.compare:
            if label not in flown or self.compare.count(label) > 1:
                raise ValueError(f"compare = {label!r}: must be one of the policies {', '.join(flown)}, each once")
        return self

    @model_validator(mode="after")
    def _swept_keys(self) -> Benchmark:
        for k, entry in enumerate(self.scenarios):
            if entry.swept and (self.sweep is None or self.sweep.of == "policy"):
                raise ValueError(f"scenarios.{k}.swept = {entry.swept!r}: needs a sweep of scenario")
        if self.sweep is not None and not self.sweep.key:
            if self.sweep.of == "policy" or not all(entry.swept for entry in self.scenarios):
                raise ValueError("sweep.key = '': must name what is varied, unless every scenario has a `swept` key")
            if not self.sweep.label:
                raise ValueError("sweep.label = '': must say what is varied where there is no sweep.key")
        return self

    def limited(self, episodes: int | None = None, first_seed: int | None = None) -> Benchmark:
        """This benchmark with at most `episodes` episodes a case, and other seeds."""
        first = self.seeds.first if first_seed is None else check_seed(first_seed)
        seeds = Seeds(first=first, count=min(self.seeds.count, episodes or self.seeds.count))
        return self.model_copy(update={"seeds": seeds})

    def cases(self) -> list[Case]:
        """The rows in the order of the table."""
        return [case for value in self._values() for case in self._cases_at(value)]

    def _values(self) -> tuple[float | None, ...]:
        if self.sweep is None:
            return (None,)
        return tuple(int(value) if value.is_integer() else value for value in self.sweep.values)

    def _cases_at(self, value: float | None) -> Iterator[Case]:
        of_scenario = self.sweep is None or self.sweep.of == "scenario"
        for world in self.scenarios:
            change = {} if self.sweep is None else {world.swept or self.sweep.key: value}
            scenario = world.made(**(change if of_scenario else {}))
            for entry in self.policies:
                policy = entry.made(**({} if of_scenario else change))
                count = min(self.seeds.count, entry.episodes or self.seeds.count)
                seeds = tuple(range(self.seeds.first, self.seeds.first + count))
                yield Case(
                    scenario=world.label or world.scenario,
                    policy=entry.label or entry.policy,
                    value=value,
                    cell=Cell(policy, scenario, seeds),
                )


def benchmark_names() -> list[str]:
    """The names of the shipped benchmarks."""
    return sorted(path.stem for path in (config_folder() / "benchmarks").glob("*.yaml"))


def load_benchmark(name: str | Path) -> Benchmark:
    """The benchmark in the file `name`, or the shipped one of that name. Raises InputError, naming file and key."""
    path = config_folder() / "benchmarks" / f"{name}.yaml"
    if "/" in str(name) or not path.is_file():
        path = Path(name)
    if not path.is_file():
        near = difflib.get_close_matches(str(name), benchmark_names(), n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        allowed = ", ".join(benchmark_names())
        raise InputError(f"unknown benchmark {str(name)!r}: {hint}allowed are {allowed}, or a YAML file")
    try:
        benchmark = Benchmark.model_validate(read_yaml(path))
        benchmark.cases()
    except ValidationError as error:
        raise one_line(error, path) from None
    except InputError as error:
        text = str(error)
        raise error if text.startswith(str(path)) else InputError(f"{path}: {text}") from None
    return benchmark


def run_benchmark(
    benchmark: Benchmark,
    *,
    n_jobs: int | None = None,
    store: Store | None = None,
    progress: bool | None = None,
) -> list[Result]:
    """Fly all cases of `benchmark`. Arguments as for `training.evaluate`."""
    cases = benchmark.cases()
    records = run_cells([case.cell for case in cases], n_jobs=n_jobs, store=store, progress=progress)
    return [Result(case, found) for case, found in zip(cases, records, strict=True)]
