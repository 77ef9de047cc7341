"""Runs one published experiment: benchmark, table, figure, and notes that set our figures beside the paper's claims."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from training.benchmark import Benchmark, Result, load_benchmark, run_benchmark
from training.comparison import Group, episodes_frame, grouped, wide_frame
from training.figures import curves, energy_bars, last_moment, save, side_by_side
from training.records import write_table, write_text
from training.report import conditions, group_tables, rules, sweep_tables
from training.reproduce.claims import Claim, Finding
from training.store import Store

QUICK_EPISODES = 24


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


@dataclass(frozen=True)
class Outcome:
    """An experiment, its results and the verdicts on its claims."""

    experiment: Experiment
    benchmark: Benchmark
    results: list[Result]
    groups: list[Group]
    findings: list[Finding]

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
        table = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False, show_header=False)
        table.add_column(no_wrap=True)
        table.add_column()
        colours = {"holds": "green", "contradicted": "red", "open": "yellow"}
        for finding in self.findings:
            table.add_row(Text(finding.verdict, style=colours[finding.verdict]), f"{finding.claim}\n  {finding.ours}")
        return table

    def notes(self) -> str:
        """Markdown: the claims, ours, and what cannot be compared."""
        lines = [
            f"# {self.benchmark.title}",
            "",
            self.experiment.summary,
            "",
            "| paper | ours | verdict |",
            "| --- | --- | --- |",
        ]
        lines += [f"| {finding.claim} | {finding.ours} | {finding.verdict} |" for finding in self.findings]
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

    def write(self, folder: Path) -> None:
        """Table, episodes, figure and notes into `folder`."""
        write_table(folder / "table.csv", wide_frame(self.groups))
        write_table(folder / "episodes.csv", episodes_frame(self.results))
        write_text(folder / "notes.md", self.notes())
        save(self.figure(), folder / "figure.png")
        for case in (result.case for result in self.results if result.case.policy == self.experiment.picture_of):
            save(last_moment(case.cell.policy, case.cell.scenario, case.cell.seeds[0]), folder / "episode.png")


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
