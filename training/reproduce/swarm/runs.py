"""Runs of a swarm: a setting is a policy, a number of obstacles, an emission and a team; layouts of obstacles are
pooled in it.

Benchmarks list the layouts as scenarios. What a setting is, is read from the scenario itself, so a run that two
benchmarks share is flown and counted once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from osl_env.parameters import FloatArray
from training.benchmark import Case, Result, load_benchmark
from training.records import EpisodeRecords
from training.statistics import Estimate, wilson
from training.store import Store
from training.sweep import run_cells


class Setting(NamedTuple):
    """What is varied."""

    policy: str  # the benchmark's label
    obstacles: int
    emission: float  # g/s
    n_robots: int


class Flown(NamedTuple):
    """All runs of one setting, a result a layout."""

    setting: Setting
    layouts: tuple[Result, ...]

    @property
    def records(self) -> EpisodeRecords:
        """Of all layouts."""
        return EpisodeRecords(record for layout in self.layouts for record in layout.records)

    @property
    def n_successes(self) -> int:
        """Runs that reached the source."""
        return sum(record.success for record in self.records)

    @property
    def success(self) -> Estimate:
        """Share of all runs, with Wilson's interval."""
        return wilson(self.n_successes, len(self.records))

    @property
    def times(self) -> list[FloatArray]:
        """(n,) search times, s, of each layout; a failed run's is the limit."""
        return [layout.records.values("capped_search_time") for layout in self.layouts]

    @property
    def median(self) -> float:
        """Search time, s, of all runs; a failed run's is the limit."""
        return float(np.median(np.concatenate(self.times)))

    @property
    def limit(self) -> float:
        """s, of a run."""
        return self.layouts[0].case.cell.scenario.ending.time_limit


def setting_of(case: Case) -> Setting:
    """What `case` flies."""
    scenario = case.cell.scenario
    plume: Any = scenario.plume
    return Setting(case.policy, len(scenario.arena.obstacles), float(plume.release_rate), scenario.team.n_uavs)


def planned_cases(
    benchmarks: Sequence[str], episodes: int | None = None, first_seed: int | None = None
) -> dict[Setting, list[Case]]:
    """What the shipped `benchmarks` fly: the layouts of each setting.

    With `episodes`, so many runs a setting at most, spread evenly over its layouts; layouts without a run are left out.
    """
    settings: dict[Setting, dict[str, Case]] = {}
    for name in benchmarks:
        for case in load_benchmark(name).limited(None, first_seed).cases():
            settings.setdefault(setting_of(case), {}).setdefault(case.cell.key, case)
    return {
        setting: list(layouts.values()) if episodes is None else _limited(list(layouts.values()), episodes)
        for setting, layouts in settings.items()
    }


def _limited(cases: list[Case], episodes: int) -> list[Case]:
    whole, rest = divmod(episodes, len(cases))
    counts = [whole + (k < rest) for k in range(len(cases))]
    return [
        replace(case, cell=replace(case.cell, seeds=case.cell.seeds[:count]))
        for case, count in zip(cases, counts, strict=True)
        if count
    ]


def fly_settings(
    planned: dict[Setting, list[Case]], *, n_jobs: int | None, store: Store | None, progress: bool | None
) -> list[Flown]:
    """All runs of `planned`, flown together over all processes. Arguments as for `training.evaluate`."""
    cases = [case for layouts in planned.values() for case in layouts]
    records = iter(run_cells([case.cell for case in cases], n_jobs=n_jobs, store=store, progress=progress))
    return [
        Flown(setting, tuple(Result(case, next(records)) for case in layouts)) for setting, layouts in planned.items()
    ]
