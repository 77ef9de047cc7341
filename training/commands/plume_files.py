"""`osl plume import` and `osl plume export`: other programs' files into fields, and plumes into files."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from osl_env.errors import InputError
from training.commands.options import Count, Pairs, print_json
from training.commands.plume_options import (
    LONGEST,
    Name,
    OptionalMetres,
    OptionalSeconds,
    Output,
    Seconds,
    check_times,
    named_subject,
    progress_bar,
    say_written,
)

if TYPE_CHECKING:
    from osl_env.fields import Field
    from training.plume_subjects import Subject


@dataclass(frozen=True)
class Import:
    """Turn another program's wind and gas into a field file (.npz)."""

    path: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="PATH")]
    """the folder of a GADEN simulation or of an OpenFOAM case"""
    format: Literal["auto", "gaden", "openfoam"] = "auto"
    """of the folder; by default found out"""
    output: Output = None
    """the field file; results/fields/NAME.npz by default"""
    quantity: Literal["all", "wind", "gas"] = "all"
    """what to take"""
    spacing: OptionalMetres = None
    """side of a cell, needed where OpenFOAM's mesh is not regular"""
    step: OptionalSeconds = None
    """between GADEN's files, which do not say; 1 by default, with gas 0.5"""
    json: bool = False
    """print JSON only"""

    def execute(self) -> None:
        """Read, write and print. Raises InputError for a folder that is neither, or damaged."""
        from osl_env.fields import save_field, statistics
        from training.records import check_output

        check_times(spacing=self.spacing, step=self.step)
        if not self.path.is_dir():
            found = "is a file; expected the folder of a simulation" if self.path.exists() else "no such folder"
            raise InputError(f"{self.path}: {found}")
        kind = _format_of(self.path) if self.format == "auto" else self.format
        target = self.output or Path("results") / "fields" / f"{self.path.resolve().name}.npz"
        check_output(target, (".npz",))
        field = self._gaden() if kind == "gaden" else self._openfoam()
        save_field(field, target)
        if self.json:
            print_json({"path": str(target), "format": kind, "statistics": statistics(field)})
            return
        print(f"{kind}: {field.n_frames} frames, {' x '.join(map(str, field.shape))} cells, {field.duration:g} s")
        print(target)
        print(f"look at it: osl plume show {target}")

    def _gaden(self) -> Field:
        from osl_env.fields.gaden import import_gaden

        if self.spacing is not None:
            raise InputError(f"--spacing {self.spacing:g}: GADEN's cells stay as they are")
        if self.step is None:
            return import_gaden(self.path, quantity=self.quantity)
        return import_gaden(self.path, quantity=self.quantity, wind_step=self.step, save_step=self.step)

    def _openfoam(self) -> Field:
        from osl_env.fields.openfoam import import_openfoam

        if self.step is not None or self.quantity == "gas":
            raise InputError(
                "--step, --quantity gas: are for GADEN; an OpenFOAM case has its times, and its wind is taken"
            )
        return import_openfoam(self.path, spacing=self.spacing, scalar="" if self.quantity == "wind" else None)


@dataclass(frozen=True)
class Export:
    """Write a plume to a field file, to GADEN's files, or as a table; a scenario's is simulated."""

    name: Name
    """a scenario, or a field: a name from `osl list`, a YAML or an .npz file"""
    format: Literal["npz", "gaden", "csv", "png"] = "npz"
    """field file, folder of GADEN's files, table of cells, or picture"""
    output: Output = None
    """file or, for gaden, folder; results/plumes/NAME.FORMAT by default"""
    seconds: OptionalSeconds = None
    """that are recorded of a scenario; 60 by default, and 0 for csv"""
    interval: Seconds = 1.0
    """between two frames"""
    spacing: OptionalMetres = None
    """side of a cell; by default 60 along the longer side"""
    seed: Count = 0
    """of the episode"""
    set: Pairs = ()
    """change the scenario: wind.velocity=[1,0,0]"""
    json: bool = False
    """print JSON only"""

    def execute(self) -> None:
        """Simulate and write. Raises InputError for any bad argument before anything is simulated."""
        check_times(interval=self.interval, spacing=self.spacing)
        if self.seconds is not None and not 0 <= self.seconds <= LONGEST:
            raise InputError(f"--seconds {self.seconds:g}: must be from 0 to {LONGEST:g}")
        subject = named_subject(self.name, self.seed, self.set)
        if self.format == "gaden" and subject.unit not in ("ppm", "m/s"):
            raise InputError(f"--format gaden: GADEN's gas is in ppm, and {subject.name} is in {subject.unit}")
        target = self.output or Path("results") / "plumes" / _file_name(Path(self.name).stem, self.format)
        from training.records import check_output

        if self.format == "gaden":
            _check_new_folder(target)
        else:
            check_output(target, (f".{self.format}",))
        field = self._write(subject, target)
        say_written([target], self.json)
        if self.format == "gaden" and field is not None and field.n_frames > 1 and not self.json:
            step = f"{field.times[1] - field.times[0]:g}"
            print(f"GADEN's files do not say times: its steps are {step} s; osl plume import {target} --step {step}")

    def _write(self, subject: Subject, target: Path) -> Field | None:
        """Write it; the field, where one was written."""
        if self.format == "png":
            from training.figures import save
            from training.plume_pictures import Picture

            subject.go_on(subject.development)
            save(Picture(subject).figure, target)
            return None
        field = self._field(subject)
        if self.format == "npz":
            from osl_env.fields import save_field

            save_field(field, target)
        elif self.format == "gaden":
            from osl_env.fields.gaden import export_gaden

            export_gaden(field, target)
        else:
            from training.plume_recording import table
            from training.records import write_table

            write_table(target, table(field))
        return field

    def _field(self, subject: Subject) -> Field:
        """The field itself, or the recorded simulation."""
        from training.plume_recording import record
        from training.plume_subjects import RecordedField

        if isinstance(subject, RecordedField):
            return subject.field
        seconds = (0.0 if self.format == "csv" else 60.0) if self.seconds is None else self.seconds
        subject.go_on(subject.development)
        frames = 1 + round(seconds / self.interval) if subject.changes else 1
        with progress_bar(frames, "frame", self.json) as bar:
            return record(subject, seconds, self.interval, self.spacing, bar.update)


def _check_new_folder(folder: Path) -> None:
    """Raise InputError if `folder` holds something, or cannot be made."""
    from training.records import make_folder

    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise InputError(f"{folder}: is not an empty folder; expected a new one")
    make_folder(folder.parent)
    if not os.access(folder if folder.exists() else folder.parent, os.W_OK):
        raise InputError(f"{folder}: cannot be written")


def _file_name(name: str, kind: str) -> str:
    return f"{name}-gaden" if kind == "gaden" else f"{name}.{kind}"


def _format_of(folder: Path) -> str:
    """What wrote `folder`: OpenFOAM if it is a case, else GADEN if its occupancy grid is in or above it."""
    if (folder / "system" / "controlDict").is_file() or (folder / "constant" / "polyMesh").is_dir():
        return "openfoam"
    here = folder.resolve()
    grids = [place / "OccupancyGrid3D.csv" for place in (here, *list(here.parents)[:3])]
    if any(grid.is_file() for grid in grids) or next(folder.rglob("OccupancyGrid3D.csv"), None):
        return "gaden"
    raise InputError(
        f"{folder}: neither an OpenFOAM case (no system/controlDict) nor a GADEN simulation (no OccupancyGrid3D.csv);"
        " say which with --format"
    )
