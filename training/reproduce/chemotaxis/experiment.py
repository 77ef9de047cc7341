"""The paper's tables and its parameter study as experiments: cells, claims, tables, strips and notes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure
from rich.console import RenderableType

from osl_env.scenario import Scenario
from training.figures import save
from training.records import write_table, write_text
from training.report import conditions
from training.reproduce.chemotaxis.cells import BASE, FlownCell, Part, by_setting, by_source, fly_parts
from training.reproduce.chemotaxis.claims import CellClaim
from training.reproduce.chemotaxis.figures import Panel, strips
from training.reproduce.chemotaxis.readings import REMARKS
from training.reproduce.chemotaxis.tables import FOOTNOTES, plain_rows, setting_tables, source_tables
from training.reproduce.claims import Finding
from training.reproduce.report import ExperimentReport, verdict_lines
from training.store import Store

QUICK_EPISODES = 3
_FILES = ("figure.png", "notes.md", "table.csv", "episodes.csv")


@dataclass(frozen=True)
class CellExperiment:
    """Cells flown over several seeds. `by_setting`: settings against the base, instead of ours against the paper's."""

    name: str
    title: str
    summary: str
    parts: tuple[Part, ...]
    claims: tuple[CellClaim, ...]
    remarks: str = REMARKS
    compares_settings: bool = False

    def run(
        self,
        *,
        episodes: int | None = None,
        quick: bool = False,
        first_seed: int | None = None,
        n_jobs: int | None = None,
        store: Store | None = None,
        progress: bool | None = None,
    ) -> CellReport:
        """Fly all cells with at most `episodes` seeds; the other arguments as for `training.evaluate`."""
        cells = fly_parts(
            self.parts,
            episodes=episodes or (QUICK_EPISODES if quick else None),
            first_seed=first_seed,
            n_jobs=n_jobs,
            store=store,
            progress=progress,
        )
        return CellReport(self, cells, [claim.check(cells) for claim in self.claims])


@dataclass(frozen=True)
class CellReport(ExperimentReport):
    """An experiment, its cells and the verdicts on its claims."""

    experiment: CellExperiment
    cells: Sequence[FlownCell]
    findings: Sequence[Finding]

    @property
    def footnotes(self) -> str:
        """The rules by which the figures came about."""
        return footnotes(self.cells[0].cell.scenario)

    def tables(self) -> RenderableType:
        """For the terminal."""
        return setting_tables(self.cells) if self.experiment.compares_settings else source_tables(self.cells)

    def rows(self) -> list[dict[str, Any]]:
        """One row a cell."""
        return plain_rows(self.cells)

    def figure(self) -> Figure:
        """A panel a source with a row a start, or a panel a start with a row a setting."""
        if self.experiment.compares_settings:
            starts = dict.fromkeys(cell.start for cell in self.cells)
            groups = {f"Initial {start}": [cell for cell in self.cells if cell.start == start] for start in starts}
            panels = [
                Panel(title, tuple((cell.setting, cell) for cell in members)) for title, members in groups.items()
            ]
        else:
            panels = [
                Panel(f"Source {source}", tuple((f"Initial {cell.start}", cell) for cell in members))
                for source, members in by_source(self.cells).items()
                if members
            ]
        return strips(panels, self.title)

    def notes(self) -> str:
        """Markdown: claims, ours, the cells, and what cannot be compared."""
        lines = [f"# {self.title}", "", self.summary, "", *verdict_lines(self.findings), "", *_cell_lines(self.cells)]
        lines += ["", self.remarks, "", *(f"- {line}" for line in self.footnotes.splitlines())]
        return "\n".join([*lines, "", "## Conditions", "", *_condition_lines(self.cells), ""])

    def write(self, folder: Path) -> list[str]:
        """Table, episodes, figure and notes into `folder`."""
        write_table(folder / "table.csv", pd.DataFrame(self.rows()))
        write_table(folder / "episodes.csv", episodes_frame(self.cells))
        write_text(folder / "notes.md", self.notes())
        save(self.figure(), folder / "figure.png")
        return list(_FILES)


def footnotes(scenario: Scenario) -> str:
    """The rules by which flight times and detections are counted."""
    return FOOTNOTES.format(radius=scenario.ending.success_radius)


def episodes_frame(cells: Sequence[FlownCell]) -> pd.DataFrame:
    """Every flight of every cell, under the cell's source, start and setting."""
    frames = [
        cell.records.to_frame().assign(source=cell.source, start=cell.start, setting=cell.setting) for cell in cells
    ]
    return pd.concat(frames, ignore_index=True)


def _cell_lines(cells: Sequence[FlownCell]) -> list[str]:
    """Ours and the paper's, cell by cell, as a Markdown table."""
    header = ["cell", "success", "paper, s", "mean, s", "10-90 %, s", "ours / paper", "pinned, s", "first detection, s"]
    lines = [f"| {' | '.join(header)} |", f"| {' | '.join(['---'] * len(header))} |"]
    for cell in cells:
        low, high = cell.spread
        figures = [
            cell.name,
            f"{cell.n_successes}/{len(cell.records)}",
            *(f"{value:.2f}" for value in (cell.paper, cell.mean.value)),
            f"{low:.1f} to {high:.1f}",
            *(f"{value:.2f}" for value in (cell.ratio.value, cell.pinned_time, cell.detection)),
        ]
        lines.append(f"| {' | '.join('-' if 'nan' in figure else figure for figure in figures)} |")
    return lines


def _condition_lines(cells: Sequence[FlownCell]) -> list[str]:
    """A line for each source and setting: where, in what, with which policy."""
    lines = []
    for setting, members in by_setting(cells).items():
        for source, group in by_source(members).items():
            if group:
                cell = group[0].cell
                place = f"Source {source}" if setting == BASE else f"Source {source}, {setting}"
                policy = ", ".join(f"{key} = {value}" for key, value in cell.policy.model_dump().items())
                lines.append(f"- {place}: {conditions(cell.scenario, cell.seeds)}; {cell.policy.name}: {policy}")
    return lines
