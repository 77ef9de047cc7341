"""`osl reproduce`: a paper's experiments, and what of its claims holds here."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from osl_env.errors import InputError
from training.commands.options import DEFAULT_STORE, Folder, OptionalCount, check_count, print_json

if TYPE_CHECKING:
    from training.reproduce.experiment import Experiment, Outcome


@dataclass(frozen=True)
class Reproduce:
    """Run a paper's experiments again: table, figure and notes "ours / paper"."""

    paper: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="PAPER")]
    """muc-osl"""
    experiment: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="EXPERIMENT")] = "all"
    """area, uavs, radius, particles, energy, example, gaden (these four in a filament plume: gaden-area, ..) or all"""
    episodes: OptionalCount = None
    """at most so many a setting; 200 by default, as in the paper"""
    seed: OptionalCount = None
    """of the first episode; by default as configured"""
    quick: bool = False
    """few episodes: a look, with wide intervals"""
    jobs: OptionalCount = None
    """processes; all cores by default"""
    out: Folder = Path("results/reproduce")
    """for the files"""
    store: Folder = DEFAULT_STORE
    """keeps finished episodes; the same command takes them from there"""
    json: bool = False
    """print JSON only"""

    def execute(self) -> None:
        """Run, print and write, one experiment after the other. Raises InputError for any bad argument."""
        check_count("episodes", self.episodes)
        check_count("seed", self.seed, 0)
        experiments = _chosen(self.paper, self.experiment)
        from training.records import check_output
        from training.reproduce.experiment import QUICK_EPISODES, reproduce
        from training.store import Store

        check_output(self.out / self.paper / "figure.png", (".png",))
        outcomes = []
        for experiment in experiments:
            outcome = reproduce(
                experiment,
                episodes=self.episodes or (QUICK_EPISODES if self.quick else None),
                first_seed=self.seed,
                n_jobs=self.jobs,
                store=Store(self.store),
            )
            folder = self.out / self.paper / experiment.name
            outcome.write(folder)
            outcomes.append(outcome)
            if not self.json:
                _print(outcome, folder)
        if self.json:
            print_json([_as_json(outcome) for outcome in outcomes])


def _chosen(paper: str, name: str) -> Sequence[Experiment]:
    from training.reproduce import muc_osl

    papers = {"muc-osl": muc_osl.EXPERIMENTS}
    if paper not in papers:
        raise InputError(f"unknown paper {paper!r}: allowed are {', '.join(papers)}")
    experiments = papers[paper]
    if name == "all":
        return list(experiments.values())
    if name in muc_osl.GROUPS:
        return [experiments[member] for member in muc_osl.GROUPS[name]]
    if name not in experiments:
        allowed = [*experiments, *muc_osl.GROUPS]
        near = difflib.get_close_matches(name, allowed, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise InputError(f"unknown experiment {name!r} of {paper}: {hint}allowed are {', '.join(allowed)}, all")
    return [experiments[name]]


def _print(outcome: Outcome, folder: Path) -> None:
    from training.report import console, rules

    screen = console()
    screen.print(outcome.benchmark.title, style="bold")
    screen.print(outcome.experiment.summary + "\n")
    screen.print(outcome.tables())
    screen.print("The paper's claims", style="bold")
    screen.print(outcome.verdicts())
    screen.print()
    screen.print(outcome.experiment.remarks, style="dim")
    screen.print(rules(outcome.groups, with_best=outcome.experiment.by_policy), style="dim")
    screen.print(f"\nfigure.png, notes.md, table.csv and episodes.csv are in {folder}\n")


def _as_json(outcome: Outcome) -> dict[str, object]:
    from training.comparison import wide

    return {
        "experiment": outcome.experiment.name,
        "title": outcome.benchmark.title,
        "findings": [
            {"claim": finding.claim, "verdict": finding.verdict, "ours": finding.ours} for finding in outcome.findings
        ],
        "rows": wide(outcome.groups),
    }
