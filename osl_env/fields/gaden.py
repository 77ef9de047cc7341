"""Import of GADEN's environments, winds and results of all versions as a field, and export of a field for GADEN.

A GADEN folder holds `OccupancyGrid3D.csv`, winds (`wind/wind_iteration_i`, or the NAME_i.csv files that they were made
from) and, for each source, a folder of results `iteration_i`. Which belong together is found by their names; where a
folder holds several, the parameters say which. Files of winds and results have no times: the steps between them are
those the simulation was run with.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from osl_env.errors import InputError
from osl_env.fields.field import Field
from osl_env.fields.gaden_grid import Occupancy, read_occupancy, read_wind, write_occupancy, write_wind
from osl_env.fields.gaden_raster import concentration_of
from osl_env.fields.gaden_results import GadenResult, read_result, write_result
from osl_env.fields.storage import MAX_FIELD_BYTES

Series: TypeAlias = list[Path]

_OCCUPANCY = "OccupancyGrid3D.csv"
_WIND_KINDS = (r"(wind_iteration)_(\d+)", r"(.+)_(\d+)\.csv_gaden", r"(.+)_(\d+)\.csv_U", r"(.+)_(\d+)\.csv")
_RESULT = r"(iteration)_(\d+)"
_MAX_FILES = 1_000_000  # in a folder that is searched
_AIR = 1.0 / (82.057338 * 298.0)  # mol of all gases in a cm^3, at 1 atm and 298 K
_UP = 3  # folders above, where GADEN 3 keeps what several simulations share
GASES = (
    "ethanol", "methane", "hydrogen", "propanol", "chlorine", "fluorine", "acetone", "neon", "helium", "biogas",
    "butane", "carbon dioxide", "carbon monoxide", "smoke",
)  # fmt: skip


def import_gaden(
    folder: str | Path,
    *,
    quantity: Literal["all", "wind", "gas"] = "all",
    occupancy: str | Path | None = None,
    wind: str | Path | None = None,
    results: str | Path | Sequence[str | Path] | None = None,
    wind_step: float = 1.0,
    save_step: float = 0.5,
    cutoff: float = 3.0,
    max_bytes: int = MAX_FIELD_BYTES,
) -> Field:
    """The field in a GADEN `folder`: its `quantity`, wind and gas where both are there.

    `occupancy` is the grid's file, `wind` the folder of winds or NAME of NAME_i.csv, and `results` the folder of
    results, or one for each source, whose gas is added; by default they are looked for in and above `folder`. Frames
    are `save_step` s apart if there is gas, each with the wind that its result names, and `wind_step` s otherwise.
    `cutoff` is in sigma of a filament. Raises InputError in one line; also if the field needs more than `max_bytes`.
    """
    root = Path(folder)
    if not os.path.isdir(root):  # unlike Path's, never raises
        raise InputError(f"{root}: no such folder; expected one with GADEN's files")
    for name, value in (("wind_step", wind_step), ("save_step", save_step), ("cutoff", cutoff)):
        if not 0 < value < 1e6:
            raise InputError(f"{name} = {value!r}: must be above 0 and below 1e6")
    grid = read_occupancy(_occupancy_file(root) if occupancy is None else Path(occupancy))
    winds = [] if quantity == "gas" else _wind_files(root, wind)
    moments = [] if quantity == "wind" else _result_files(root, results)
    if not winds and not moments:
        raise InputError(f"{root}: holds no {'wind or gas' if quantity == 'all' else quantity} of GADEN; expected some")
    frames = len(moments[0]) if moments else len(winds)
    needed = frames * grid.solid.size * (12 * bool(winds) + 4 * bool(moments))
    if needed > max_bytes:
        raise InputError(
            f"{root}: {frames} frames of {grid.shape} cells need {needed:.3g} bytes; allowed {max_bytes:.3g}"
        )
    return _assembled(root, grid, winds, moments, save_step if moments else wind_step, cutoff)


def _assembled(root: Path, grid: Occupancy, winds: Series, moments: list[Series], step: float, cutoff: float) -> Field:
    n = len(moments[0]) if moments else len(winds)
    gas = np.zeros((n, *grid.shape), np.float32) if moments else None
    air = np.zeros((n, *grid.shape, 3), np.float32) if winds else None
    card: dict[str, Any] = {"title": root.resolve().name, "source": "GADEN"}
    if gas is not None:
        card["sources"] = [_add_results(series, grid, cutoff, gas) for series in moments]
    if air is not None:
        _fill_winds(winds, moments, grid, air)
    return Field(
        times=np.arange(n, dtype=np.float64) * step,
        origin=grid.low + 0.5 * grid.cell,
        spacing=np.full(3, grid.cell),
        wind=air,
        concentration=gas,
        unit="ppm",
        solid=grid.solid,
        card=card,
    )


def _add_results(series: Series, grid: Occupancy, cutoff: float, gas: NDArray[np.float32]) -> dict[str, Any]:
    """Add the results of one source to `gas` (n_t, nx, ny, nz); what the card says of the source."""
    for k, path in enumerate(series):
        result = read_result(path)
        _same_grid(path, result, grid)
        gas[k] += concentration_of(result, grid, cutoff)
    named = 0 <= result.gas < len(GASES)
    return {"position": result.source.tolist(), "gas": GASES[result.gas] if named else f"gas {result.gas}"}


def _same_grid(path: Path, result: GadenResult, grid: Occupancy) -> None:
    slack = 0.01 * grid.cell
    same = result.shape == grid.shape and abs(result.cell - grid.cell) < slack
    if not same or np.any(np.abs(result.low - grid.low) > slack + 1e-5 * np.abs(grid.low)):
        raise InputError(
            f"{path}: has {result.shape} cells of {result.cell:g} m from {result.low.tolist()}; expected the grid's"
            f" {grid.shape} cells of {grid.cell:g} m from {grid.low.tolist()}"
        )


def _fill_winds(winds: Series, moments: list[Series], grid: Occupancy, air: NDArray[np.float32]) -> None:
    """Put into `air` (n_t, nx, ny, nz, 3) the winds, or with results the wind that each of them names."""
    latest: tuple[int, NDArray[np.float32]] | None = None
    for k in range(len(air)):
        index = read_result(moments[0][k]).wind_index if moments else k
        if not 0 <= index < len(winds):
            raise InputError(f"{moments[0][k]}: names wind {index}; expected one of the {len(winds)} there are")
        if latest is None or latest[0] != index:
            latest = index, read_wind(winds[index], grid)
        air[k] = latest[1]


def _ancestors(root: Path) -> list[Path]:
    return [root, *root.resolve().parents[:_UP]]


def _occupancy_file(root: Path) -> Path:
    for place in _ancestors(root):
        if (place / _OCCUPANCY).is_file():
            return place / _OCCUPANCY
    below = [path for path in _files(root) if path.name == _OCCUPANCY]
    if len(below) != 1:
        raise InputError(f"{root}: has {len(below)} files {_OCCUPANCY} in and above it; expected one (see occupancy)")
    return below[0]


def _files(root: Path) -> list[Path]:
    found = []
    for path in root.rglob("*"):
        found.append(path)
        if len(found) > _MAX_FILES:
            raise InputError(f"{root}: holds over {_MAX_FILES} files; expected the folder of one GADEN simulation")
    return found


def _series(paths: Sequence[Path], pattern: str) -> dict[tuple[Path, str], Series]:
    """The numbered files among `paths`, in order, for each folder and NAME. Raises InputError for a gap."""
    numbered: dict[tuple[Path, str], dict[int, Path]] = {}
    for path in paths:
        match = re.fullmatch(pattern, path.name)
        if match and len(match[2]) < 10 and path.is_file():
            numbered.setdefault((path.parent, match[1]), {})[int(match[2])] = path
    series = {}
    for (parent, name), files in numbered.items():
        order = sorted(files)
        gaps = [number for number in range(order[0], order[0] + len(order)) if number not in files]
        if gaps:
            raise InputError(
                f"{parent}: number {gaps[0]} of {name} is missing; expected all from {order[0]} to {order[-1]}"
            )
        series[parent, name] = [files[number] for number in order]
    return series


def _wind_files(root: Path, given: str | Path | None) -> Series:
    """The files of the winds: in the folder or of the NAME given, or in, below or above `root`."""
    if given is None:
        above = [path for place in _ancestors(root)[1:] for path in sorted((place / "wind").glob("*"))]
        candidates = [_files(root), above]
    else:
        place = Path(given)
        paths = sorted(place.glob("*")) if place.is_dir() else sorted(place.parent.glob("*"))
        candidates = [
            paths if place.is_dir() else [p for p in paths if p.name.startswith(f"{place.name.rstrip('_')}_")]
        ]
    for paths in candidates:
        for pattern in _WIND_KINDS:
            series = _series(paths, pattern)
            if len(series) > 1:
                names = ", ".join(sorted(str(parent / name) for parent, name in series)[:4])
                raise InputError(f"{root}: holds several winds ({names}); expected one (see wind)")
            if series:
                return next(iter(series.values()))
    if given is not None:
        raise InputError(f"{given}: holds no winds of GADEN; expected wind_iteration_i, NAME_i.csv or NAME_i.csv_U")
    return []


def _result_files(root: Path, given: str | Path | Sequence[str | Path] | None) -> list[Series]:
    """The files of the results of each source."""
    if given is None:
        found = list(_series(_files(root), _RESULT).values())
        if len(found) > 1:
            names = ", ".join(sorted(str(series[0].parent) for series in found)[:4])
            raise InputError(f"{root}: holds several simulations ({names}); expected one, or name them in results")
        return found
    folders = [given] if isinstance(given, str | Path) else list(given)
    found = []
    for folder in folders:
        series = list(_series(sorted(Path(folder).glob("*")), _RESULT).values())
        if not series:
            raise InputError(f"{folder}: holds no results of GADEN; expected files iteration_i")
        found += series
    lengths = {len(series) for series in found}
    if len(lengths) > 1:
        raise InputError(f"{root}: the simulations have {sorted(lengths)} results; expected the same number each")
    return found


def export_gaden(field: Field, folder: str | Path) -> None:
    """Write `field` to `folder` for GADEN 3: the occupancy grid, the winds and, if it holds gas, the results.

    Frame i is wind i and result i; GADEN's wind and save steps must be the field's interval. A result holds the
    concentration, of a source at the first place in the card. Raises InputError if the cells are not cubes, the unit
    is not ppm, or the folder cannot be written or is not empty. What stops it midway leaves nothing behind.
    """
    root = Path(folder)
    cell = float(field.spacing[0])
    if np.any(np.abs(field.spacing - cell) > 1e-6 * cell):
        raise InputError(f"spacing = {field.spacing.tolist()}: GADEN's cells are cubes")
    if field.concentration is not None and field.unit != "ppm":
        raise InputError(f"unit = {field.unit!r}: GADEN's gas is in ppm")
    solid = field.solid if field.solid is not None else np.zeros(field.shape, np.uint8)
    occupancy = Occupancy(field.low, cell, solid)
    try:
        root.mkdir(parents=True, exist_ok=True)
        if any(root.iterdir()):
            raise InputError(f"{root}: is not empty; expected a new folder")
        with _whole_or_nothing(root):
            write_occupancy(root / _OCCUPANCY, occupancy)
            if field.wind is not None:
                (root / "wind").mkdir()
                for k, air in enumerate(field.wind):
                    write_wind(root / "wind" / f"wind_iteration_{k}", air)
            if field.concentration is not None:
                (root / "result").mkdir()
                for k in range(field.n_frames):
                    write_result(root / "result" / f"iteration_{k}", _result(field, occupancy, k))
    except OSError as error:
        raise InputError(f"{root}: cannot be written ({error.strerror})") from None


@contextmanager
def _whole_or_nothing(root: Path) -> Iterator[None]:
    """Remove what was written to `root`, which was empty, if the writing fails or is stopped."""
    try:
        yield
    except BaseException:
        for part in root.iterdir():
            if part.is_dir():
                shutil.rmtree(part, ignore_errors=True)
            else:
                part.unlink(missing_ok=True)
        raise


def _result(field: Field, occupancy: Occupancy, frame: int) -> GadenResult:
    """Frame `frame` of `field` as a result. Readers of concentrations ignore the constants of the filaments."""
    assert field.concentration is not None
    source = field.sources[0] if len(field.sources) else occupancy.low
    gas = field.card["sources"][0].get("gas") if len(field.sources) else None
    return GadenResult(
        version=(3, 0),
        low=occupancy.low,
        cell=occupancy.cell,
        shape=occupancy.shape,
        source=np.asarray(source),
        gas=GASES.index(gas) if gas in GASES else -1,
        moles=0.0,
        air=_AIR,
        wind_index=frame if field.wind is not None else 0,
        concentration=field.concentration[frame],
    )
