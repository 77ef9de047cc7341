"""Pictures of single flights: snapshots and an animation of one in the small and one in the large arena."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from rich.box import SIMPLE_HEAD
from rich.console import Group as Lines
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from training.figures import save
from training.plume_pictures import write_gif
from training.records import write_table, write_text
from training.report import conditions
from training.reproduce.claims import Finding
from training.reproduce.report import ExperimentReport
from training.reproduce.swarm.claims import FULL
from training.reproduce.swarm.film import Film, film
from training.reproduce.swarm.film_pictures import pages, snapshots
from training.reproduce.swarm.readings import REMARKS
from training.reproduce.swarm.runs import Setting, planned_cases
from training.store import Store

_FPS = 8.0
_FOOTNOTES = (
    "Shades: the plume at the robots' height, on a log scale, white is less. Arrows: the wind. Dots: robots, lines: "
    "their latest tracks, over a twelfth of the flight. Star: the source. Grey: obstacles."
)


@dataclass(frozen=True)
class Snapshots:
    """One flight of each of `settings` of the other experiments' benchmarks, with their first seed."""

    name: str
    title: str
    summary: str
    benchmarks: tuple[str, ...]
    settings: tuple[tuple[str, Setting], ...]  # how the files are called, what is flown

    def run(
        self,
        *,
        episodes: int | None = None,
        quick: bool = False,
        first_seed: int | None = None,
        n_jobs: int | None = None,
        store: Store | None = None,
        progress: bool | None = None,
    ) -> SnapshotReport:
        """Fly, in this process; of the arguments only `first_seed` counts."""
        planned = planned_cases(self.benchmarks, 1, first_seed)
        return SnapshotReport(self, {name: film(planned[setting][0].cell) for name, setting in self.settings})


@dataclass(frozen=True)
class SnapshotReport(ExperimentReport):
    """The flights that are drawn; a single flight decides no claim."""

    experiment: Snapshots
    films: dict[str, Film]

    @property
    def findings(self) -> Sequence[Finding]:
        """None."""
        return ()

    @property
    def remarks(self) -> str:
        """What is not the paper's."""
        return REMARKS

    @property
    def footnotes(self) -> str:
        """What the pictures show."""
        return _FOOTNOTES

    def tables(self) -> RenderableType:
        """A line a flight."""
        table = Table(padding=(0, 1, 0, 0), box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
        for header in ("flight", "scenario", "robots", "ended by", "search time s"):
            table.add_column(header, no_wrap=True)
        for row in self.rows():
            time = f"{row['search_time']:.1f}"
            table.add_row(row["flight"], row["scenario"], str(row["n_robots"]), row["ended"].replace("_", " "), time)
        return Lines(table, Text())

    def rows(self) -> list[dict[str, Any]]:
        """One row a flight."""
        return [
            {
                "flight": name,
                "scenario": one.record.scenario,
                "seed": one.record.seed,
                "n_robots": one.record.n_uavs,
                "success": one.record.success,
                "ended": one.record.ended,
                "search_time": one.record.search_time,
                "first_detection_time": one.record.first_detection_time,
            }
            for name, one in self.films.items()
        ]

    def notes(self) -> str:
        """Markdown: the flights, and what is not the paper's."""
        lines = [f"# {self.title}", "", self.summary, ""]
        for name, one in self.films.items():
            cell = one.cell
            lines.append(
                f"- {name}: {_heading(one)}; {cell.scenario.name}, {conditions(cell.scenario, cell.seeds[:1])}"
            )
        return "\n".join([*lines, "", self.remarks, "", self.footnotes, ""])

    def write(self, folder: Path) -> list[str]:
        """Snapshots, an animation of each flight, table and notes into `folder`."""
        names = []
        for name, one in self.films.items():
            save(snapshots(one, _heading(one)), folder / f"{name}.png")
            write_gif(list(pages(one, _heading(one))), folder / f"{name}.gif", _FPS)
            names += [f"{name}.png", f"{name}.gif"]
        write_table(folder / "table.csv", pd.DataFrame(self.rows()))
        write_text(folder / "notes.md", self.notes())
        return [*names, "notes.md", "table.csv"]


def _heading(one: Film) -> str:
    record = one.record
    width, depth = one.size
    obstacles = len(one.cell.scenario.arena.obstacles)
    among = f", {obstacles} obstacles" if obstacles else ""
    if record.success:
        ending = f"source reached after {record.search_time:.0f} s"
    else:
        ending = f"not reached, ended by {record.ended.replace('_', ' ')} after {record.mission_time:.0f} s"
    return f"{record.n_uavs} robots in {width:g} x {depth:g} m{among}, seed {record.seed}: {ending}"


EXPERIMENT = Snapshots(
    name="snapshots",
    title="Swarm, snapshots of two flights",
    summary="One flight in 4 x 6 m with 10 obstacles and one in 30 x 40 m, with the first seed.",
    benchmarks=("swarm_small_10", "swarm_large"),
    settings=(("small", Setting(FULL, 10, 0.02, 15)), ("large", Setting(FULL, 0, 0.05, 40))),
)
