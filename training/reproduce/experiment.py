"""Runs one published experiment: benchmark, table, figure, and notes that set our figures beside the paper's claims."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from rich.console import RenderableType
from rich.table import Table

from training.benchmark import Benchmark, Result, load_benchmark, run_benchmark
from training.comparison import Group, episodes_frame, grouped, wide, wide_frame
from training.figures import curves, energy_bars, last_moment, save, side_by_side
from training.records import write_table, write_text
from training.report import conditions, group_tables, rules, sweep_tables
from training.reproduce.claims import Claim, Finding
from training.reproduce.report import verdict_lines, verdicts
from training.store import Store

QUICK_EPISODES = 24
_FILES = ("figure.png", "notes.md", "table.csv", "episodes.csv")


@dataclass(frozen=True)
class Experiment:
    """One experiment of a paper. `table` and `figure` say how its results are shown."""

    name: str
    benchmark: str
    summary: str
    claims: tuple[Claim, ...]
    remarks: str  # frank: what is not the paper's, and what cannot be compared
    by_policy: bool = False  # the full tables of each group, instead of one line a setting
    energy_figure: bool = False
    picture_of: str = ""  # a policy, whose first episode is drawn

    def run(
        self,
        *,
        episodes: int | None = None,
        quick: bool = False,
        first_seed: int | None = None,
        n_jobs: int | None = None,
        store: Store | None = None,
        progress: bool | None = None,
    ) -> Outcome:
        """`reproduce` this with at most `episodes` episodes a setting, or few if `quick`."""
        most = episodes or (QUICK_EPISODES if quick else None)
        return reproduce(self, episodes=most, first_seed=first_seed, n_jobs=n_jobs, store=store, progress=progress)


@dataclass(frozen=True)
class Outcome:
    """An experiment, its results and the verdicts on its claims."""

    experiment: Experiment
    benchmark: Benchmark
    results: list[Result]
    groups: list[Group]
    findings: list[Finding]

    @property
    def name(self) -> str:
        """Of the experiment."""
        return self.experiment.name

    @property
    def title(self) -> str:
        """The benchmark's."""
        return self.benchmark.title

    @property
    def summary(self) -> str:
        """What was flown."""
        return self.experiment.summary

    @property
    def remarks(self) -> str:
        """What is not the paper's, and what cannot be compared."""
        return self.experiment.remarks

    @property
    def footnotes(self) -> str:
        """The rules by which the figures came about."""
        return rules(self.groups, with_best=self.experiment.by_policy)

    def tables(self) -> RenderableType:
        """For the terminal."""
        sweep = self.benchmark.sweep
        if self.experiment.by_policy:
            return group_tables(self.groups, sweep)
        return sweep_tables(self.groups, sweep)

    def figure(self) -> Figure:
        """For the eyes."""
        if self.experiment.energy_figure:
            return energy_bars(self.groups, self.benchmark.title)
        if self.experiment.by_policy:
            return side_by_side(self.groups, self.benchmark.title)
        return curves(self.groups, self.benchmark.title, self.benchmark.sweep)

    def verdicts(self) -> Table:
        """Claims and verdicts, for the terminal."""
        return verdicts(self.findings)

    def notes(self) -> str:
        """Markdown: the claims, ours, and what cannot be compared."""
        lines = [
            f"# {self.benchmark.title}",
            "",
            self.experiment.summary,
            "",
            *verdict_lines(self.findings),
        ]
        lines += [
            "",
            self.experiment.remarks,
            "",
            "Differences are pooled over the settings, on the same seeds, with 95 %",
        ]
        lines += ["intervals; `open` means that the interval includes zero.", "", "## Conditions", ""]
        for group in self.groups:
            cell = group.rows[0].result.case.cell
            value = "" if group.value is None else f", {group.value:g}"
            lines.append(f"- {group.scenario}{value}: {conditions(cell.scenario, cell.seeds)}")
        footnotes = [f"- {line}" for line in rules(self.groups, with_best=False).splitlines()]
        return "\n".join([*lines, "", *footnotes, ""])

    def rows(self) -> list[dict[str, Any]]:
        """One row a policy, scenario and swept value."""
        return wide(self.groups)

    def write(self, folder: Path) -> list[str]:
        """Table, episodes, figure and notes into `folder`; the names of the files."""
        write_table(folder / "table.csv", wide_frame(self.groups))
        write_table(folder / "episodes.csv", episodes_frame(self.results))
        write_text(folder / "notes.md", self.notes())
        save(self.figure(), folder / "figure.png")
        for case in (result.case for result in self.results if result.case.policy == self.experiment.picture_of):
            save(last_moment(case.cell.policy, case.cell.scenario, case.cell.seeds[0]), folder / "episode.png")
        return list(_FILES)


def reproduce(
    experiment: Experiment,
    *,
    episodes: int | None = None,
    first_seed: int | None = None,
    n_jobs: int | None = None,
    store: Store | None = None,
    progress: bool | None = None,
) -> Outcome:
    """Run `experiment` with at most `episodes` episodes a setting; the other arguments as for `training.evaluate`."""
    benchmark = load_benchmark(experiment.benchmark).limited(episodes, first_seed)
    results = run_benchmark(benchmark, n_jobs=n_jobs, store=store, progress=progress)
    findings = [claim.check(results) for claim in experiment.claims]
    return Outcome(experiment, benchmark, results, grouped(results), findings)
