"""`osl bench`: a table of policies and scenarios, with a figure."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from training.commands.options import DEFAULT_STORE, Folder, OptionalCount, OptionalFolder, check_count, print_json

if TYPE_CHECKING:
    from training.benchmark import Benchmark, Result


@dataclass(frozen=True)
class Bench:
    """Compare policies on the same seeds: table, figure, CSV and JSON."""

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
        from training.records import check_output
        from training.store import Store

        benchmark = load_benchmark(self.config).limited(episodes=self.episodes, first_seed=self.seed)
        folder = self.out or Path("results") / Path(self.config).stem
        check_output(folder / "figure.png", (".png",))
        results = run_benchmark(benchmark, n_jobs=self.jobs, store=Store(self.store))
        self._report(benchmark, results, folder)

    def _report(self, benchmark: Benchmark, results: list[Result], folder: Path) -> None:
        from training.comparison import episodes_frame, grouped, wide, wide_frame
        from training.figures import curves, save, side_by_side
        from training.records import write_table
        from training.report import console, group_tables, overall_table, rules, sweep_tables

        groups = grouped(results)
        write_table(folder / "table.csv", wide_frame(groups))
        write_table(folder / "table.json", wide_frame(groups))
        write_table(folder / "episodes.csv", episodes_frame(results))
        swept = benchmark.sweep is not None
        figure = curves(groups, benchmark.title, benchmark.sweep) if swept else side_by_side(groups, benchmark.title)
        save(figure, folder / "figure.png")
        if self.json:
            print_json({"title": benchmark.title, "folder": str(folder), "rows": wide(groups)})
            return
        screen = console()
        screen.print(benchmark.title, style="bold")
        screen.print()
        screen.print(sweep_tables(groups, benchmark.sweep) if swept else group_tables(groups))
        if not swept and len(groups) > 1:
            screen.print(overall_table(groups))
        if benchmark.note:
            screen.print(benchmark.note)
        screen.print(rules(groups, with_best=not swept), style="dim")
        screen.print(f"\nfigure.png, table.csv, table.json and episodes.csv are in {folder}")
