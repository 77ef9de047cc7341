"""`osl reproduce`: a paper's experiments, and what of its claims holds here."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from osl_env.errors import InputError
from training.commands.options import DEFAULT_STORE, Folder, OptionalCount, check_count, print_json

if TYPE_CHECKING:
    from training.reproduce.report import Report, Reproducible


@dataclass(frozen=True)
class Reproduce:
    """Run a paper's experiments again: table, figure and notes "ours / paper"."""

    paper: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="PAPER")]
    """muc-osl, chemotaxis, gaslam or swarm"""
    experiment: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="EXPERIMENT")] = "all"
    """muc-osl: area, uavs, radius, particles, energy, example, gaden (these four in a filament plume: gaden-area, ..);
    chemotaxis: table1, table2, table3, tables (all three), parameters, trajectories; gaslam: table2, real (with meander
    and lag), maps, ablation; swarm: small, large, forces, snapshots; or all"""
    episodes: OptionalCount = None
    """at most so many a setting; by default as configured: muc-osl 200, gaslam 10, as in the papers; chemotaxis 20,
    swarm 30"""
    seed: OptionalCount = None
    """of the first episode; by default as configured"""
    quick: bool = False
    """few episodes: a look, with wide intervals"""
    jobs: OptionalCount = None
    """processes; all cores by default"""
    out: Folder = Path("results/reproduce")
    """for the files"""
    store: Folder = DEFAULT_STORE
    """keeps finished episodes; the same command takes them from there (gaslam's are flown again, for their maps)"""
    json: bool = False
    """print JSON only"""

    def execute(self) -> None:
        """Run, print and write, one experiment after the other. Raises InputError for any bad argument."""
        check_count("episodes", self.episodes)
        check_count("seed", self.seed, 0)
        experiments = _chosen(self.paper, self.experiment)
        from training.records import check_output
        from training.store import Store
        from training.sweep import check_jobs

        check_jobs(self.jobs)
        check_output(self.out / self.paper / "figure.png", (".png",))
        reports = []
        for experiment in experiments:
            report = experiment.run(
                episodes=self.episodes,
                quick=self.quick,
                first_seed=self.seed,
                n_jobs=self.jobs,
                store=Store(self.store),
            )
            folder = self.out / self.paper / experiment.name
            files = report.write(folder)
            reports.append(report)
            if not self.json:
                _print(report, folder, files)
        if self.json:
            print_json([_as_json(report) for report in reports])


def _chosen(paper: str, name: str) -> Sequence[Reproducible]:
    from training.reproduce.papers import PAPERS

    if paper not in PAPERS:
        raise InputError(f"unknown paper {paper!r}: {_hint(paper, PAPERS)}allowed are {', '.join(PAPERS)}")
    allowed = PAPERS[paper].names
    if name not in allowed:
        raise InputError(
            f"unknown experiment {name!r} of {paper}: {_hint(name, allowed)}allowed are {', '.join(allowed)}"
        )
    return PAPERS[paper].chosen(name)


def _hint(name: str, allowed: Iterable[str]) -> str:
    near = difflib.get_close_matches(name, list(allowed), n=1)
    return f"did you mean {near[0]!r}? " if near else ""


def _print(report: Report, folder: Path, files: Sequence[str]) -> None:
    from training.report import console
    from training.reproduce.report import verdicts

    screen = console()
    screen.print(report.title, style="bold")
    screen.print(report.summary + "\n")
    screen.print(report.tables())
    if report.findings:
        screen.print("The paper's claims", style="bold")
        screen.print(verdicts(report.findings))
        screen.print()
    screen.print(report.remarks, style="dim")
    screen.print(report.footnotes, style="dim")
    screen.print(f"\n{', '.join(files[:-1])} and {files[-1]} are in {folder}\n")


def _as_json(report: Report) -> dict[str, object]:
    return {
        "experiment": report.name,
        "title": report.title,
        "findings": [
            {"claim": finding.claim, "verdict": finding.verdict, "ours": finding.ours} for finding in report.findings
        ],
        "rows": report.rows(),
    }
