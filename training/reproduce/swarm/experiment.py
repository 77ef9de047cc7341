"""Search times as an experiment: settings, averages, claims, tables, curves over the team, and notes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure
from rich.console import RenderableType

from training.figures import save
from training.records import write_table, write_text
from training.report import conditions
from training.reproduce.claims import Finding
from training.reproduce.report import ExperimentReport, verdict_lines
from training.reproduce.swarm import tables
from training.reproduce.swarm.averages import Pool
from training.reproduce.swarm.claims import SwarmClaim
from training.reproduce.swarm.figures import time_over_team
from training.reproduce.swarm.readings import REMARKS
from training.reproduce.swarm.runs import Flown, Setting, fly_settings, planned_cases
from training.store import Store

QUICK_EPISODES = 3
_FILES = ("figure.png", "notes.md", "table.csv", "episodes.csv")


@dataclass(frozen=True)
class Table:
    """Which settings stand in a table, under a title."""

    title: str
    holds: Callable[[Setting], bool]


@dataclass(frozen=True)
class SwarmExperiment:
    """Settings flown over several runs. The figure shows `drawn`, a panel `panel_of` and a line `line_of` each."""

    name: str
    title: str
    summary: str
    benchmarks: tuple[str, ...]
    claims: tuple[SwarmClaim, ...]
    shown: tuple[Table, ...]
    drawn: Callable[[Setting], bool]
    panel_of: Callable[[Setting], str]
    line_of: Callable[[Setting], str]
    remarks: str = REMARKS

    def run(
        self,
        *,
        episodes: int | None = None,
        quick: bool = False,
        first_seed: int | None = None,
        n_jobs: int | None = None,
        store: Store | None = None,
        progress: bool | None = None,
    ) -> SwarmReport:
        """Fly all settings with at most `episodes` runs each; the other arguments as for `training.evaluate`."""
        planned = planned_cases(self.benchmarks, episodes or (QUICK_EPISODES if quick else None), first_seed)
        flown = fly_settings(planned, n_jobs=n_jobs, store=store, progress=progress)
        pool = Pool(flown)
        return SwarmReport(self, flown, pool, [claim.check(pool) for claim in self.claims])


@dataclass(frozen=True)
class SwarmReport(ExperimentReport):
    """An experiment, its runs and the verdicts on its claims."""

    experiment: SwarmExperiment
    flown: Sequence[Flown]
    pool: Pool
    findings: Sequence[Finding]

    @property
    def footnotes(self) -> str:
        """The rules by which the figures came about."""
        return tables.footnotes(self.flown)

    @property
    def _settings(self) -> list[Setting]:
        policies = list(dict.fromkeys(setting.policy for setting in self.pool.flown))
        return sorted(self.pool.flown, key=lambda one: (policies.index(one.policy), *one[1:]))

    @property
    def _titled(self) -> list[tables.Titled]:
        titled = [(table.title, [one for one in self._settings if table.holds(one)]) for table in self.experiment.shown]
        return [(title, members) for title, members in titled if members]

    def tables(self) -> RenderableType:
        """For the terminal."""
        return tables.on_screen(self.pool, self._titled)

    def rows(self) -> list[dict[str, Any]]:
        """One row a setting."""
        return tables.plain_rows(self.pool)

    def figure(self) -> Figure:
        """Search time over the team."""
        experiment = self.experiment
        settings = [one for one in self._settings if experiment.drawn(one)]
        return time_over_team(self.pool, settings, self.title, experiment.panel_of, experiment.line_of)

    def notes(self) -> str:
        """Markdown: claims, tables, and what cannot be compared."""
        lines = [f"# {self.title}", "", self.summary, "", *verdict_lines(self.findings), ""]
        for title, settings in self._titled:
            lines += [f"## {title[0].upper()}{title[1:]}", "", *tables.as_markdown(self.pool, settings), ""]
        lines += ["## Remarks", "", self.remarks, "", *(f"- {line}" for line in self.footnotes.splitlines()), ""]
        return "\n".join([*lines, "## Conditions", "", *_condition_lines(self.flown), ""])

    def write(self, folder: Path) -> list[str]:
        """Table, episodes, figure and notes into `folder`."""
        write_table(folder / "table.csv", pd.DataFrame(self.rows()))
        write_table(folder / "episodes.csv", episodes_frame(self.flown))
        write_text(folder / "notes.md", self.notes())
        save(self.figure(), folder / "figure.png")
        return list(_FILES)


def episodes_frame(flown: Sequence[Flown]) -> pd.DataFrame:
    """Every run, under its setting."""
    frames = [
        layout.records.to_frame().assign(setting=one.setting.policy, obstacles=one.setting.obstacles,
                                         emission=one.setting.emission)
        for one in flown
        for layout in one.layouts
    ]  # fmt: skip
    return pd.concat(frames, ignore_index=True)


def _condition_lines(flown: Sequence[Flown]) -> list[str]:
    """A line for each layout, and one for each policy."""
    layouts = {layout.case.cell.scenario.name: layout.case.cell for one in flown for layout in one.layouts}
    lines = [f"- {name}, as: {conditions(cell.scenario, cell.seeds)}" for name, cell in layouts.items()]
    for label, policy in {one.setting.policy: one.layouts[0].case.cell.policy for one in flown}.items():
        parameters = ", ".join(f"{key} = {value}" for key, value in policy.model_dump().items())
        lines.append(f"- {label}: {policy.name} with {parameters}")
    return lines
