"""GADEN's occupancy grids and wind files (Monroy et al. 2017; versions 1 to 3), read and written.

Binary files are little-endian, cells in the order x fastest, then y, then z. `OccupancyGrid3D.csv` has four lines of
header and a line for each x with all y; ";" ends a layer of z. Winds come as a ParaView CSV of points and velocities
in either order of columns, whose points lie somewhere in their cells; as three files `_U`, `_V`, `_W`; or as one
binary file, whose size tells its layout.
"""

from __future__ import annotations

import io
import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from osl_env.errors import InputError
from osl_env.geometry import FREE, OUTLET, SOLID
from osl_env.parameters import FloatArray

Wind: TypeAlias = NDArray[np.float32]  # (nx, ny, nz, 3) m/s

MAX_CELLS = 2**28
_CODES = {"0": FREE, "1": SOLID, "2": OUTLET}
_BLOCKS_CODE = 999  # GADEN's mark of a binary _U, _V or _W file
_BYTES_PER_CELL = 400  # a line of a CSV is shorter
_FEWEST = 0.1  # of the free cells must have a point of a CSV


@dataclass(frozen=True, eq=False)
class Occupancy:
    """The grid of a GADEN environment: cubic cells, and what they hold."""

    low: FloatArray  # (3,) m: the low corner
    cell: float  # m
    solid: NDArray[np.uint8]  # (nx, ny, nz): geometry.FREE, SOLID, OUTLET

    @property
    def shape(self) -> tuple[int, int, int]:
        """(nx, ny, nz)."""
        nx, ny, nz = self.solid.shape
        return nx, ny, nz


def file_bytes(path: Path, limit: int, expected: str) -> bytes:
    """The content of the file at `path`, of at most `limit` bytes. Raises InputError."""
    try:
        size = path.stat().st_size
        if not path.is_file() or size > limit:
            raise InputError(f"{path}: has {size} bytes; expected {expected} of at most {limit}")
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected {expected}") from None


def read_occupancy(path: Path) -> Occupancy:
    """The environment in the `OccupancyGrid3D.csv` at `path`. Raises InputError ("FILE: reason; expected ..")."""
    expected = "GADEN's OccupancyGrid3D.csv"
    content = file_bytes(path, 4 * MAX_CELLS, expected)
    try:
        text = content.decode("ascii")
        head, body = _split_header(text)
        low = _numbers(head, "#env_min(m)", 3)
        counts = _numbers(head, "#num_cells", 3)
        cell = float(_numbers(head, "#cell_size(m)", 1)[0])
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not text; expected {expected}") from None
    except InputError as error:
        raise InputError(f"{path}: {error}; expected {expected}") from None
    nx, ny, nz = map(int, counts)
    if not np.array_equal(counts, (nx, ny, nz)) or min(nx, ny, nz) < 1 or nx * ny * nz > MAX_CELLS:
        raise InputError(f"{path}: #num_cells = {counts.tolist()}; expected whole numbers, {MAX_CELLS} cells at most")
    if cell <= 0:
        raise InputError(f"{path}: #cell_size(m) = {cell:g}; expected a size above 0 m")
    return Occupancy(low, cell, _layers(path, body, (nx, ny, nz)))


def _split_header(text: str) -> tuple[dict[str, str], str]:
    lines = text.split("\n", 4)
    head = {key: rest for key, _, rest in (line.strip().partition(" ") for line in lines[:4])}
    return head, lines[4] if len(lines) > 4 else ""


def _numbers(head: dict[str, str], key: str, count: int) -> FloatArray:
    words = head.get(key, "").split()
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError:
        numbers = np.empty(0)
    if numbers.size != count or not np.all(np.isfinite(numbers)) or np.any(np.abs(numbers) > 1e9):
        raise InputError(f"{key} = {' '.join(words)[:60]!r}: is not {count} number{'s' * (count > 1)}")
    return numbers


def _layers(path: Path, body: str, shape: tuple[int, int, int]) -> NDArray[np.uint8]:
    nx, ny, nz = shape
    if len(body) < 2 * nx * ny * nz - ny * nz:
        raise InputError(f"{path}: is cut off; expected {nx} x {ny} x {nz} cells")
    layers = body.split(";", nz)
    if len(layers) != nz + 1 or layers[nz].strip():
        raise InputError(f"{path}: has {len(layers) - 1} layers or more after them; expected {nz}, each ended by ';'")
    solid = np.empty(shape, np.uint8)
    for z in range(nz):
        rows = [line.split() for line in layers[z].splitlines() if line.strip()]
        if len(rows) != nx or any(len(row) != ny for row in rows):
            raise InputError(f"{path}: layer {z} has {len(rows)} lines; expected {nx}, each of {ny} cells")
        for x, row in enumerate(rows):
            try:
                solid[x, :, z] = [_CODES[word] for word in row]
            except KeyError as error:
                raise InputError(f"{path}: layer {z}, line {x}: {error.args[0]!r:.20}; expected 0, 1 or 2") from None
    return solid


def write_occupancy(path: Path, occupancy: Occupancy) -> None:
    """Write `occupancy` as GADEN's OccupancyGrid3D.csv to `path`."""
    nx, ny, nz = occupancy.shape
    high = occupancy.low + occupancy.cell * np.array(occupancy.shape)
    with path.open("w", encoding="ascii") as file:
        file.write("#env_min(m) " + " ".join(repr(float(x)) for x in occupancy.low) + "\n")
        file.write("#env_max(m) " + " ".join(repr(float(x)) for x in high) + "\n")
        file.write(f"#num_cells {nx} {ny} {nz}\n#cell_size(m) {occupancy.cell!r}\n")
        for z in range(nz):
            np.savetxt(file, occupancy.solid[:, :, z], fmt="%d")
            file.write(";\n")


def read_wind(path: Path, occupancy: Occupancy) -> Wind:
    """The wind in the file at `path`: NAME_i.csv, NAME_i.csv_U (with its _V and _W beside it), or a binary file."""
    with np.errstate(all="ignore"):  # what is not a finite float32 is refused below
        if path.name.endswith("_U"):
            stem = path.name[:-1]
            blocks = [_read_block(path.with_name(stem + axis), occupancy) for axis in "UVW"]
            wind = np.stack(blocks, axis=-1).astype(np.float32)
        elif path.suffix == ".csv":
            wind = _read_csv(path, occupancy)
        else:
            wind = _read_binary(path, occupancy)
    if not np.all(np.isfinite(wind)):
        raise InputError(f"{path}: holds velocities that are not finite; expected m/s")
    return wind


def _read_block(path: Path, occupancy: Occupancy) -> NDArray[np.float64]:
    size = 4 + 8 * math.prod(occupancy.shape)
    content = file_bytes(path, size, "a file of the wind's components")
    if len(content) != size or struct.unpack("<i", content[:4])[0] != _BLOCKS_CODE:
        raise InputError(
            f"{path}: has {len(content)} bytes, or does not begin with {_BLOCKS_CODE}; expected {size} for"
            f" {occupancy.shape} cells"
        )
    return _from_flat(np.frombuffer(content, "<f8", offset=4), occupancy.shape)


def _from_flat(values: NDArray[np.generic], shape: tuple[int, int, int]) -> NDArray[np.float64]:
    """(nx, ny, nz, ..) of values in GADEN's order of cells, (nx * ny * nz, ..)."""
    nx, ny, nz = shape
    return np.swapaxes(values.reshape(nz, ny, nx, *values.shape[1:]), 0, 2).astype(np.float64)


def to_flat(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """`values` (nx, ny, nz, ..) in GADEN's order of cells: (nx * ny * nz, ..), little-endian."""
    return np.ascontiguousarray(np.swapaxes(values, 0, 2), "<f4").reshape(-1, *values.shape[3:])


def _read_binary(path: Path, occupancy: Occupancy) -> Wind:
    n = math.prod(occupancy.shape)
    content = file_bytes(path, 24 * n, "a wind file")
    size = len(content)
    if size == 24 * n:  # to version 2.5
        blocks = np.frombuffer(content, "<f8").reshape(3, n).T
        return _from_flat(blocks, occupancy.shape).astype(np.float32)
    if size == 12 * n + 8:  # 3.0
        version = struct.unpack("<2i", content[:8])
        if version[0] != 3:
            raise InputError(f"{path}: is of version {version[0]}.{version[1]}; expected 3.x")
    elif size != 12 * n:  # 2.6
        raise InputError(
            f"{path}: has {size} bytes; expected {24 * n}, {12 * n} or {12 * n + 8} for {occupancy.shape} cells"
        )
    packed = np.frombuffer(content, "<f4", offset=size - 12 * n).reshape(n, 3)
    return _from_flat(packed, occupancy.shape).astype(np.float32)


def write_wind(path: Path, wind: Wind) -> None:
    """Write `wind` (nx, ny, nz, 3) as a wind file of version 3.0 to `path`."""
    path.write_bytes(struct.pack("<2i", 3, 0) + to_flat(wind).tobytes())


def _read_csv(path: Path, occupancy: Occupancy) -> Wind:
    """A point goes to the cell that contains it, as a mean of its points; free cells without any take the nearest."""
    expected = 'a CSV with the columns "U:0".."U:2" and "Points:0".."Points:2"'
    content = file_bytes(path, 10_000 + _BYTES_PER_CELL * math.prod(occupancy.shape), expected)
    try:
        head, _, body = content.decode("utf-8").partition("\n")
        names = [name.strip().strip('"') for name in head.split(",")]
        order = [names.index(f"{quantity}:{axis}") for quantity in ("Points", "U") for axis in range(3)]
        if not body.strip():
            raise ValueError("holds no points")
        table = np.loadtxt(io.StringIO(body), delimiter=",", usecols=order, ndmin=2, comments=None)
    except (ValueError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is not readable ({str(error)[:80]}); expected {expected}") from None
    if not np.all(np.isfinite(table)):
        raise InputError(f"{path}: holds numbers that are not finite; expected {expected}")
    return _in_cells(path, table, occupancy)


def _in_cells(path: Path, table: FloatArray, occupancy: Occupancy) -> Wind:
    place = np.floor((table[:, :3] - occupancy.low) / occupancy.cell)
    inside = np.all((place >= 0) & (place < occupancy.shape), axis=1)
    cells = np.ravel_multi_index(tuple(place[inside].astype(np.int64).T), occupancy.shape)
    n = math.prod(occupancy.shape)
    count = np.bincount(cells, minlength=n)
    sums = np.stack([np.bincount(cells, table[inside, 3 + axis], n) for axis in range(3)], axis=-1)
    wind = (sums / np.maximum(count, 1)[:, None]).reshape(*occupancy.shape, 3)
    known, free = (count > 0).reshape(occupancy.shape), occupancy.solid != SOLID
    if (known & free).sum() < _FEWEST * free.sum():
        raise InputError(
            f"{path}: its points lie in {int((known & free).sum())} of {int(free.sum())} free cells; expected nearly"
            " all: is it the grid of another environment?"
        )
    if not known[free].all():
        from scipy import ndimage  # slow to import, and rarely needed

        nearest = ndimage.distance_transform_edt(~(known & free), return_distances=False, return_indices=True)
        wind = np.where((free & ~known)[..., None], wind[tuple(nearest)], wind)
    return wind.astype(np.float32)
