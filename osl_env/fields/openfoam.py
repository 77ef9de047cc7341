"""Importing an OpenFOAM case: the velocity, and a scalar if there is one, as a field on a regular grid.

Where all cells are equal boxes on a lattice (blockMesh, obstacles cut out by subsetMesh), a cell of the mesh becomes
a cell of the grid, without interpolation; lattice places without a cell are solid. Any other mesh is resampled to
cells of a given size: a place takes the values of the cell that holds it (`nearest`), or is linear between the centres
around it (`linear`; Delaunay). A place that lies in no cell's bounding box is solid.
"""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError, cKDTree

from osl_env.errors import InputError
from osl_env.fields.field import Field
from osl_env.fields.foam_files import open_foam, read_dimensions, read_faces, read_internal, read_labels, read_vectors
from osl_env.fields.storage import MAX_FIELD_BYTES
from osl_env.geometry import FREE, SOLID
from osl_env.parameters import FloatArray, Vector

SCALARS = ("C", "c", "s", "tracer", "concentration")  # looked for, in this order, as the gas
_UNITS = {(1, -3): "kg/m^3", (0, -3, 0, 0, 1): "mol/m^3", (): "1"}  # of a scalar, by its dimensions without final zeros
_VELOCITY = (0, 1, -1)  # powers of kg, m, s
_EQUAL = 0.02  # of a cell: text files hold six digits
_NEIGHBOURS = 16  # cells that are tried for one that holds a place


class Mesh(NamedTuple):
    """The cells of a mesh."""

    centres: FloatArray  # (n, 3) m: means of the centres of their faces
    low: FloatArray  # (n, 3) m: their bounding boxes
    high: FloatArray  # (n, 3) m


class Lattice(NamedTuple):
    """The grid, and how its free places take their values from the mesh: weighted sums over some cells."""

    origin: FloatArray  # (3,) m: the first centre
    spacing: FloatArray  # (3,) m
    shape: tuple[int, int, int]
    places: NDArray[np.int64]  # (m,): the free ones
    cells: NDArray[np.int64]  # (m, k)
    weights: FloatArray  # (m, k)


def import_openfoam(
    case: str | Path,
    *,
    spacing: float | Vector | None = None,
    method: Literal["nearest", "linear"] = "nearest",
    velocity: str = "U",
    scalar: str | None = None,
    unit: str | None = None,
    start: float | None = None,
    stop: float | None = None,
    max_bytes: int = MAX_FIELD_BYTES,
) -> Field:
    """The wind (field `velocity`) and the gas (field `scalar`) of the OpenFOAM case in the folder `case`.

    `spacing` (m, one number or three) resamples by `method`; it is needed unless the mesh is regular. `scalar`: by
    default one of `SCALARS` if the case has it at all times, "" for none. `unit`: of the scalar, by default from its
    dimensions. Times from `start` to `stop`, s; by default all but the initial state at 0. Coordinates stay the
    case's. Raises InputError for a folder that is not a case or has no velocity, for times that do not increase, for
    compressed, damaged or inconsistent files, and where the field would take more than `max_bytes` of memory.
    """
    folder = Path(case)
    frames = _times(folder, velocity, start, stop)
    gas = _scalar(frames, scalar)
    mesh = _read_mesh(folder / "constant" / "polyMesh")
    room = max_bytes // (len(frames) * (16 if gas else 12))
    lattice = _lattice(folder, mesh, spacing, method, room)
    winds = np.zeros((len(frames), *lattice.shape, 3), np.float32)
    gases = np.zeros((len(frames), *lattice.shape), np.float32) if gas else None
    for k, (_, at) in enumerate(frames):
        _sample(at / velocity, len(mesh.centres), lattice, winds[k], _VELOCITY)
        if gas and gases is not None:
            _sample(at / gas, len(mesh.centres), lattice, gases[k], None)
    solid = np.full(lattice.shape, SOLID, np.uint8)
    solid.reshape(-1)[lattice.places] = FREE
    return Field(
        times=np.array([time for time, _ in frames]),
        origin=lattice.origin,
        spacing=lattice.spacing,
        wind=winds,
        concentration=None if gases is None else np.maximum(gases, 0.0),  # schemes undershoot a little
        unit=unit or (_unit(frames[0][1] / gas) if gas else "ppm"),
        solid=solid if solid.any() else None,
        card=_card(folder, velocity, gas, len(mesh.centres), spacing, method),
    )


def _times(folder: Path, velocity: str, start: float | None, stop: float | None) -> list[tuple[float, Path]]:
    """The times of the case and their folders, in order."""
    if not (folder / "constant" / "polyMesh").is_dir():
        cut = "; it is decomposed: run reconstructPar" if (folder / "processor0").is_dir() else ""
        raise InputError(f"{folder}: is not an OpenFOAM case: there is no folder constant/polyMesh{cut}")
    named = [(_number(path.name), path) for path in folder.iterdir() if path.is_dir()]
    found = sorted((time, path) for time, path in named if time is not None)
    held = [(time, path) for time, path in found if any((path / f"{velocity}{end}").is_file() for end in ("", ".gz"))]
    if not held:
        raise InputError(f"{folder}: no time has a velocity {velocity!r}; expected files such as 0.5/{velocity}")
    for (a, first), (b, second) in itertools.pairwise(held):
        if a == b:
            raise InputError(
                f"{folder}: times do not increase: folders {first.name!r} and {second.name!r} are one time"
            )
    low = start if start is not None else (-np.inf if len(held) == 1 or held[-1][0] <= 0 else np.nextafter(0.0, 1.0))
    high = np.inf if stop is None else stop
    chosen = [(time, path) for time, path in held if low <= time <= high]
    if not chosen:
        span = f"{held[0][0]:g} to {held[-1][0]:g}"
        raise InputError(f"{folder}: no time from {low:g} to {high:g} s; the case has {span} s")
    return chosen


def _number(name: str) -> float | None:
    return float(name) if re.fullmatch(r"-?\d{1,20}(\.\d{1,20})?(e[-+]?\d{1,3})?", name) else None


def _scalar(frames: list[tuple[float, Path]], scalar: str | None) -> str | None:
    """The name of the gas's field, if there is one."""
    if scalar == "":
        return None
    for name in SCALARS if scalar is None else (scalar,):
        if all((path / name).is_file() for _, path in frames):
            return name
    if scalar is not None:
        missing = next(path for _, path in frames if not (path / scalar).is_file())
        raise InputError(f"{missing / scalar}: no such file; the scalar must be there at all times")
    return None


def _unit(path: Path) -> str:
    powers = read_dimensions(open_foam(path))
    while powers and powers[-1] == 0:
        powers = powers[:-1]
    if powers not in _UNITS:
        raise InputError(f"{path}: dimensions = {list(powers)}: not those of a gas; give unit")
    return _UNITS[powers]


def _read_mesh(folder: Path) -> Mesh:
    """The mesh in the folder polyMesh."""
    points = read_vectors(open_foam(folder / "points"))
    starts, corners = read_faces(open_foam(folder / "faces"))
    owner = read_labels(open_foam(folder / "owner"))
    neighbour = read_labels(open_foam(folder / "neighbour"))
    n_faces = len(starts) - 1
    if corners.min() < 0 or corners.max() >= len(points) or not np.all(np.isfinite(points)):
        raise InputError(f"{folder}: its faces name points that are not there, or that are not finite")
    cells = np.concatenate([owner, neighbour])
    if len(owner) != n_faces or len(neighbour) > n_faces or cells.min() < 0 or cells.max() >= n_faces:
        raise InputError(f"{folder}: owner, neighbour and faces do not belong together")
    faces = np.concatenate([np.arange(n_faces), np.arange(len(neighbour))])
    sizes = np.bincount(cells)
    if sizes.min() < 4:
        raise InputError(f"{folder}: cell {int(sizes.argmin())} has {int(sizes.min())} faces; at least 4 are needed")
    order = np.argsort(cells, kind="stable")
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    at = points[corners]
    low = np.minimum.reduceat(np.minimum.reduceat(at, starts[:-1])[faces[order]], first)
    high = np.maximum.reduceat(np.maximum.reduceat(at, starts[:-1])[faces[order]], first)
    middles = np.add.reduceat(at, starts[:-1]) / np.diff(starts)[:, None]
    centres = np.add.reduceat(middles[faces[order]], first) / sizes[:, None]
    return Mesh(centres, low, high)


def _lattice(
    folder: Path, mesh: Mesh, spacing: float | Vector | None, method: Literal["nearest", "linear"], room: int
) -> Lattice:
    """The grid: the mesh's own, or one of `spacing`, of at most `room` cells."""
    own = np.median(mesh.high - mesh.low, axis=0)
    low, high = mesh.low.min(axis=0), mesh.high.max(axis=0)
    if spacing is None:
        spans = own
    else:
        spans = np.broadcast_to(np.asarray(spacing, np.float64), (3,)).copy()
        if not np.all((spans > 0) & np.isfinite(spans)):
            raise InputError(f"spacing = {spacing!r}: must be one or three lengths above 0 m")
        flat = np.all(mesh.high - mesh.low > (1.0 - _EQUAL) * (high - low), axis=0)  # one layer of cells
        spans[flat] = (high - low)[flat]
    if not np.all(own > 0):
        raise InputError(f"{folder}: its cells have no volume")
    counts = np.rint((high - low) / spans)
    if float(np.prod(np.maximum(counts, 1.0))) > room:
        wanted = " x ".join(f"{max(n, 1):.0f}" for n in counts)
        raise InputError(
            f"{folder}: a grid of {wanted} cells is more than the {room} that fit max_bytes; raise spacing"
        )
    nx, ny, nz = (max(int(n), 1) for n in counts)
    origin = low + 0.5 * spans
    if np.allclose(spans, own, rtol=_EQUAL):
        places = np.rint((mesh.centres - origin) / own)
        if _regular(mesh, places, origin, own):
            index = np.ravel_multi_index(tuple(places.astype(np.int64).T), (nx, ny, nz))
            chosen = np.arange(len(index))[:, None]
            return Lattice(origin, own, (nx, ny, nz), index, chosen, np.ones(chosen.shape))
    if spacing is None:
        sizes = " x ".join(f"{side:.3g}" for side in own)
        raise InputError(
            f"{folder}: its mesh is not a regular grid (cells of about {sizes} m): give spacing to resample"
        )
    return _resampled(mesh, origin, spans, (nx, ny, nz), method)


def _regular(mesh: Mesh, places: FloatArray, origin: FloatArray, own: FloatArray) -> bool:
    """Whether every cell is a box of the sides `own` at a lattice place of its own."""
    equal = np.abs((mesh.high - mesh.low) / own - 1.0).max() < _EQUAL
    centred = np.abs((mesh.centres - origin) / own - places).max() < 2 * _EQUAL
    return bool(equal and centred and len(np.unique(places, axis=0)) == len(places))


def _resampled(
    mesh: Mesh,
    origin: FloatArray,
    spacing: FloatArray,
    shape: tuple[int, int, int],
    method: Literal["nearest", "linear"],
) -> Lattice:
    """A grid of another spacing than the mesh's, or over an irregular mesh."""
    steps = np.stack(np.meshgrid(*[np.arange(n) for n in shape], indexing="ij"), axis=-1).reshape(-1, 3)
    points = origin + spacing * steps
    slack = 1e-6 * spacing
    near = cKDTree(mesh.centres).query(points, k=min(_NEIGHBOURS, len(mesh.centres)))[1].reshape(len(points), -1)
    holding = np.full(len(points), -1)
    for candidate in near.T[::-1]:  # the nearest comes last and counts
        inside = np.all((points >= mesh.low[candidate] - slack) & (points <= mesh.high[candidate] + slack), axis=1)
        holding[inside] = candidate[inside]
    places = np.flatnonzero(holding >= 0)
    chosen = holding[places][:, None]
    if method == "nearest":
        return Lattice(origin, spacing, shape, places, chosen, np.ones(chosen.shape))
    cells, weights = _linear(mesh.centres, points[places], chosen[:, 0])
    return Lattice(origin, spacing, shape, places, cells, weights)


def _linear(
    centres: FloatArray, points: FloatArray, fallback: NDArray[np.int64]
) -> tuple[NDArray[np.int64], FloatArray]:
    """Cells and weights (m, k) of the linear interpolation at `points`; outside the hull of the centres `fallback`."""
    wide = np.ptp(centres, axis=0) > 1e-9  # a layer of cells has no extent across
    n = int(wide.sum())
    try:
        mesh = Delaunay(centres[:, wide])
    except (QhullError, ValueError) as error:
        raise InputError(f"method = 'linear': the mesh cannot be triangulated ({error!s:.60}); use nearest") from None
    simplex = mesh.find_simplex(points[:, wide])
    affine = mesh.transform[simplex]
    first = np.einsum("mij,mj->mi", affine[:, :n], points[:, wide] - affine[:, n])
    weights = np.concatenate([first, 1.0 - first.sum(axis=1, keepdims=True)], axis=1)
    cells = mesh.simplices[simplex].astype(np.int64)
    outside = (simplex < 0) | ~np.all(np.isfinite(weights), axis=1)
    cells[outside], weights[outside] = fallback[outside, None], 1.0 / (n + 1)
    return cells, weights


def _sample(
    path: Path, n_cells: int, lattice: Lattice, out: NDArray[np.float32], dimensions: tuple[int, ...] | None
) -> None:
    """Write the values of the field in the file `path` into the free places of `out`."""
    file = open_foam(path)
    powers = read_dimensions(file)
    if dimensions is not None and powers[: len(dimensions)] not in ((), dimensions):
        raise InputError(f"{path}: dimensions = {list(powers)}: a velocity's are [0 1 -1 0 0 0 0]")
    values = read_internal(file, n_cells)
    if values.ndim != out.ndim - 2:
        raise InputError(f"{path}: class = {file.kind!r}: a {'vector' if out.ndim == 4 else 'scalar'} field is needed")
    if not np.all(np.isfinite(values)):
        raise InputError(f"{path}: holds values that are not finite; did the run diverge?")
    shares = lattice.weights if values.ndim == 1 else lattice.weights[..., None]
    out.reshape(-1, *values.shape[1:])[lattice.places] = (values[lattice.cells] * shares).sum(axis=1)


def _card(
    folder: Path, velocity: str, gas: str | None, n_cells: int, spacing: float | Vector | None, method: str
) -> dict[str, Any]:
    how = "cell by cell" if spacing is None else f"resampled to {spacing} m ({method})"
    what = velocity if gas is None else f"{velocity} and {gas}"
    return {
        "title": folder.resolve().name,
        "source": "OpenFOAM",
        "description": f"{what} of an OpenFOAM case of {n_cells} cells, {how}",
    }
