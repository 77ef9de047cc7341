"""The paper's pictures of trajectories: the pinned flight of every cell, by mode and by concentration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.box import SIMPLE_HEAD
from rich.console import Group as Lines
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from training.figures import save
from training.records import EpisodeRecords, write_table, write_text
from training.report import number
from training.reproduce.chemotaxis.cells import FlownCell, Part, planned_cells
from training.reproduce.chemotaxis.claims import DetectsAfterClimb, PinnedFlightsSucceed
from training.reproduce.chemotaxis.experiment import footnotes
from training.reproduce.chemotaxis.pictures import draw_height, draw_plan, flight_picture, overview
from training.reproduce.chemotaxis.readings import REMARKS
from training.reproduce.chemotaxis.tables_of_paper import PARTS
from training.reproduce.chemotaxis.tracks import Track, fly_track
from training.reproduce.claims import Finding
from training.reproduce.report import ExperimentReport, verdict_lines
from training.store import Store

_OVERVIEWS = {"overview.png": (draw_plan, ("x, m", "y, m")), "heights.png": (draw_height, ("time, s", "z, m"))}


@dataclass(frozen=True)
class Trajectories:
    """The flight of every cell with its first seed, watched and drawn."""

    name: str
    title: str
    summary: str
    parts: tuple[Part, ...]

    def run(
        self,
        *,
        episodes: int | None = None,
        quick: bool = False,
        first_seed: int | None = None,
        n_jobs: int | None = None,
        store: Store | None = None,
        progress: bool | None = None,
    ) -> TrajectoryReport:
        """Fly each cell once, in this process; of the arguments only `first_seed` counts."""
        flights = []
        for one in planned_cells(self.parts, 1, first_seed):
            track = fly_track(one.cell, one.cell.seeds[0])
            flights.append((one.flown(EpisodeRecords([track.record])), track))
        cells = [cell for cell, _ in flights]
        return TrajectoryReport(self, flights, [PinnedFlightsSucceed().check(cells), DetectsAfterClimb().check(cells)])


@dataclass(frozen=True)
class TrajectoryReport(ExperimentReport):
    """The watched flights and the verdicts on the claims about them."""

    experiment: Trajectories
    flights: Sequence[tuple[FlownCell, Track]]
    findings: Sequence[Finding]

    @property
    def remarks(self) -> str:
        """What is read differently, and what cannot be compared."""
        return REMARKS

    @property
    def footnotes(self) -> str:
        """The rules by which flight times and detections are counted."""
        return footnotes(self.flights[0][0].cell.scenario)

    def tables(self) -> RenderableType:
        """A line a flight."""
        table = Table(padding=(0, 1, 0, 0), box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
        table.add_column("cell", no_wrap=True)
        for header in ("paper\ns", "ours\ns", "first\ndetection s", "at x, y, z\nm", "flown\nm", "failed\nby"):
            table.add_column(header, justify="right", no_wrap=not header.startswith("failed"))
        for row, (cell, _) in zip(self.rows(), self.flights, strict=True):
            place = ", ".join(number(row[f"detection_{axis}"]) for axis in "xyz")
            times = (number(row[key], 2) for key in ("paper_time", "time", "first_detection_time"))
            failure = "" if row["ended"] == "success" else row["ended"].replace("_", " ")
            table.add_row(cell.name, *times, place, number(row["path"]), failure)
        return Lines(table, Text())

    def rows(self) -> list[dict[str, Any]]:
        """One row a flight, SI units; places in the paper's coordinates."""
        rows = []
        for cell, track in self.flights:
            found = track.detected.any()
            place = track.positions[np.argmax(track.detected)] if found else np.full(3, np.nan)
            rows.append(
                {
                    "source": cell.source,
                    "start": cell.start,
                    "seed": track.record.seed,
                    "ended": track.record.ended,
                    "paper_time": cell.paper,
                    "time": cell.pinned_time,
                    "first_detection_time": track.record.first_detection_time,
                    **{f"detection_{axis}": float(value) for axis, value in zip("xyz", place, strict=True)},
                    "path": track.record.path,
                }
            )
        return rows

    def tracks(self) -> pd.DataFrame:
        """Every decision of every flight; places in the paper's coordinates."""
        frames = [
            pd.DataFrame(
                {
                    "source": cell.source,
                    "start": cell.start,
                    "time": track.times,
                    **dict(zip("xyz", track.positions.T, strict=True)),
                    "mode": track.modes,
                    "concentration": track.readings,
                }
            )
            for cell, track in self.flights
        ]
        return pd.concat(frames, ignore_index=True)

    def notes(self) -> str:
        """Markdown: the claims, and what cannot be compared."""
        lines = [f"# {self.title}", "", self.summary, "", *verdict_lines(self.findings), "", self.remarks, ""]
        return "\n".join([*lines, *(f"- {line}" for line in self.footnotes.splitlines()), ""])

    def write(self, folder: Path) -> list[str]:
        """Table, tracks, notes, the overviews, and a picture of each flight into `folder`."""
        write_table(folder / "table.csv", pd.DataFrame(self.rows()))
        write_table(folder / "tracks.csv", self.tracks())
        write_text(folder / "notes.md", self.notes())
        for name, (draw, labels) in _OVERVIEWS.items():
            save(overview(self.flights, self.title, draw, labels), folder / name)
        for cell, track in self.flights:
            save(flight_picture(cell, track), folder / f"source{cell.source}-initial{cell.start}.png")
        return [*_OVERVIEWS, "source1-initial1.png ..", "notes.md", "table.csv", "tracks.csv"]


EXPERIMENT = Trajectories(
    name="trajectories",
    title="Chemotaxis, trajectories of the fifteen cells",
    summary="The flight with the first seed of every cell, in the paper's coordinates.",
    parts=tuple(PARTS.values()),
)
