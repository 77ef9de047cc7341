"""`osl bench`: a table of policies and scenarios, with a figure and a page."""

from __future__ import annotations

import shlex
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from training.commands.options import DEFAULT_STORE, Folder, OptionalCount, OptionalFolder, check_count, print_json

if TYPE_CHECKING:
    from training.benchmark import Benchmark, Result
    from training.comparison import Group
    from training.provenance import Provenance


@dataclass(frozen=True)
class Bench:
    """Compare policies on the same seeds: table, figure, CSV, JSON and report.html."""

    config: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="CONFIG")] = "demo"
    """a name from `osl list benchmarks`, or a YAML file"""
    episodes: OptionalCount = None
    """at most so many a cell; by default as configured"""
    seed: OptionalCount = None
    """of the first episode; by default as configured"""
    jobs: OptionalCount = None
    """processes; all cores by default"""
    out: OptionalFolder = None
    """for the files; results/CONFIG by default"""
    store: Folder = DEFAULT_STORE
    """keeps finished episodes; the same command takes them from there"""
    json: bool = False
    """print JSON only"""

    def execute(self) -> None:
        """Run, print and write. Raises InputError for any bad argument before the first episode."""
        check_count("episodes", self.episodes)
        check_count("seed", self.seed, 0)
        from training.benchmark import load_benchmark, run_benchmark
        from training.provenance import Provenance
        from training.records import check_output
        from training.store import Store
        from training.sweep import check_jobs, finished_episodes

        benchmark = load_benchmark(self.config).limited(episodes=self.episodes, first_seed=self.seed)
        folder = self.out or Path("results") / Path(self.config).stem
        check_output(folder / "figure.png", (".png",))
        store = Store(self.store)
        kept, total = finished_episodes([case.cell for case in benchmark.cases()], store)
        began = time.monotonic()
        results = run_benchmark(benchmark, n_jobs=self.jobs, store=store)
        provenance = Provenance(
            command=self._command(),
            date=datetime.now(UTC).strftime("%Y-%m-%d"),
            seconds=time.monotonic() - began,
            processes=check_jobs(self.jobs),
            episodes=total,
            from_store=kept,
        )
        self._report(benchmark, results, folder, provenance)

    def _command(self) -> str:
        """What decides the figures; not where files go, nor on how many processes."""
        words = ["osl", "bench", self.config]
        for option, value in (("--episodes", self.episodes), ("--seed", self.seed)):
            words += [] if value is None else [option, str(value)]
        return shlex.join(words)

    def _report(self, benchmark: Benchmark, results: list[Result], folder: Path, provenance: Provenance) -> None:
        from training.comparison import comparisons, grouped, wide
        from training.report import console, group_tables, overall_table, rules, sweep_tables

        groups = grouped(results, benchmark.compare)
        self._write(benchmark, results, groups, folder, provenance)
        if self.json:
            content = {"title": benchmark.title, "folder": str(folder)}
            print_json(content | {"rows": wide(groups), "comparisons": comparisons(groups)})
            return
        swept = benchmark.sweep is not None
        screen = console()
        screen.print(benchmark.title, style="bold")
        screen.print()
        screen.print(sweep_tables(groups, benchmark.sweep) if swept else group_tables(groups))
        if not swept and len(groups) > 1:
            screen.print(overall_table(groups))
        if benchmark.note:
            screen.print(benchmark.note)
        screen.print(rules(groups, with_best=not swept), style="dim")
        screen.print(f"\nfigure.png, table.csv, table.json, comparisons.csv and episodes.csv are in {folder}")
        print(f"open {folder / 'report.html'}")  # whole, where a console would break a long path

    def _write(
        self, benchmark: Benchmark, results: list[Result], groups: list[Group], folder: Path, provenance: Provenance
    ) -> None:
        from training.comparison import comparisons_frame, episodes_frame, wide_frame
        from training.figures import curves, save, side_by_side
        from training.records import write_table, write_text
        from training.report_page import report_page

        write_table(folder / "table.csv", wide_frame(groups))
        write_table(folder / "table.json", wide_frame(groups))
        write_table(folder / "comparisons.csv", comparisons_frame(groups))
        write_table(folder / "episodes.csv", episodes_frame(results))
        swept = benchmark.sweep is not None
        figure = curves(groups, benchmark.title, benchmark.sweep) if swept else side_by_side(groups, benchmark.title)
        save(figure, folder / "figure.png")
        write_text(folder / "report.html", report_page(benchmark, groups, provenance))
