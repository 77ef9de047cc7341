"""The maps of single runs: of each case the run with the first seed, flown and drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import RenderableType

from training.figures import save
from training.records import write_table, write_text
from training.reproduce.claims import Finding
from training.reproduce.gaslam import tables
from training.reproduce.gaslam.claims import POLICY
from training.reproduce.gaslam.experiment import episodes_frame
from training.reproduce.gaslam.pictures import five_maps
from training.reproduce.gaslam.published import CASES
from training.reproduce.gaslam.readings import REMARKS
from training.reproduce.gaslam.runs import Flown, fly_cases, planned_cases
from training.reproduce.report import ExperimentReport
from training.store import Store

_FOOTNOTES = (
    "Cells are cut through the source: from above at its height, and from the side at its y. Concentrations share one "
    "scale from a hundredth of the truth's largest value; white is less, grey is where no reading reaches.\n"
) + tables.FOOTNOTES


@dataclass(frozen=True)
class MapPictures:
    """The run with the first seed of every case of a benchmark."""

    name: str
    title: str
    summary: str
    benchmark: str

    def run(
        self,
        *,
        episodes: int | None = None,
        quick: bool = False,
        first_seed: int | None = None,
        n_jobs: int | None = None,
        store: Store | None = None,
        progress: bool | None = None,
    ) -> MapReport:
        """Fly one run a case; of the arguments `first_seed`, `n_jobs` and `progress` count."""
        cases = [case for case in planned_cases(self.benchmark, 1, first_seed) if case.policy == POLICY]
        return MapReport(self, fly_cases(cases, n_jobs=n_jobs, progress=progress))


@dataclass(frozen=True)
class MapReport(ExperimentReport):
    """The runs that are drawn; a single run decides no claim."""

    experiment: MapPictures
    flown: Sequence[Flown]

    @property
    def findings(self) -> Sequence[Finding]:
        """None."""
        return ()

    @property
    def remarks(self) -> str:
        """What is read differently, and what cannot be compared."""
        return REMARKS

    @property
    def footnotes(self) -> str:
        """How maps are cut and coloured, and what is measured of them."""
        return _FOOTNOTES

    def tables(self) -> RenderableType:
        """A line a run."""
        return tables.on_screen(("the runs that are drawn", tables.beside_each_other(self.flown)))

    def rows(self) -> list[dict[str, Any]]:
        """One row a run."""
        frame = episodes_frame(self.flown).astype(object)
        return [
            {str(key): value for key, value in row.items()}
            for row in frame.where(frame.notna(), None).to_dict("records")
        ]

    def notes(self) -> str:
        """Markdown: the runs, and what cannot be compared."""
        lines = [f"# {self.title}", "", self.summary, "", *tables.as_markdown(tables.beside_each_other(self.flown))]
        return "\n".join([*lines, "", self.remarks, "", *(f"- {line}" for line in self.footnotes.splitlines()), ""])

    def write(self, folder: Path) -> list[str]:
        """A picture a case, table and notes into `folder`."""
        names = []
        for one in self.flown:
            run = one.runs[0]
            title = f"Case {one.name} ({CASES.get(one.name, one.case.cell.scenario.name)}), seed {run.seed}: five maps"
            names.append(f"case-{one.name.lower()}.png")
            save(five_maps(run, title), folder / names[-1])
        write_text(folder / "notes.md", self.notes())
        write_table(folder / "table.csv", pd.DataFrame(self.rows()))
        return [*names, "notes.md", "table.csv"]


EXPERIMENT = MapPictures(
    name="maps",
    title="GaSLAM, the maps of a run of each case",
    summary="The run with the first seed of cases A to D: truth, kernel map, confidence, source term's map, final map.",
    benchmark="gaslam_table2",
)
