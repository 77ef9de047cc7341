"""GADEN's gas results, `iteration_i`: one saved moment of a simulation, of every version, read and written.

A result is a zlib stream, little-endian: the version, the grid, the source, the moles of gas in a filament (n_f) and
of air in a cm^3 (n_air), the index of the wind, and then the filaments, or the concentrations of all cells:

    1          int32 major; min 3d, max 3d, cells 3i, cell 3d, source 3d, gas i, n_f and n_air 2d, wind i; records
    2.0 .. 2.5 int32 major, minor; cells 3i, min 3f, max 3f, cell f, source 3f, gas i, 2d, wind i; records
    2.6 ..     the same with 2f
    3.x        cells 3i, min 3f, max 3f, cell f; source: type as text, for a box its size 3f, a line its end 3f, a
               sphere its radius f, then position 3f, gas i; 2f; wind i; mode as text, `filaments` or `concentrations`

Texts are an uint64 length and the bytes. A record is int32 id, x, y, z (m) and sigma (cm), as doubles to 2.5, as
floats from 2.6. After a mode, lists begin with their uint64 length; filaments are then x, y, z, sigma and a flag
padded to 20 bytes, or 16 without it. The first builds of 3.0 have no mode and go on with records, as 2.6. Later builds
put "GADEN_RESULT", a null and an uint64 of bytes before the stream.
"""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from osl_env.errors import InputError
from osl_env.fields.gaden_grid import MAX_CELLS, file_bytes, to_flat
from osl_env.parameters import FloatArray

MAX_RESULT = 2**28  # bytes of one result, inflated
_MARK = b"GADEN_RESULT\0"
_PLAIN_LIMIT = 5_000_000  # bytes that readers of GADEN 3 allot to a result without a mark
_SOURCES = {b"point": 0, b"box": 12, b"line": 12, b"sphere": 4}  # bytes of their shapes


@dataclass(frozen=True, eq=False)
class GadenResult:
    """One saved moment. Either `filaments` or `concentration` is there."""

    version: tuple[int, int]
    low: FloatArray  # (3,) m
    cell: float  # m
    shape: tuple[int, int, int]
    source: FloatArray  # (3,) m
    gas: int  # GADEN's number of the gas
    moles: float  # n_f, mol of gas in a filament
    air: float  # n_air, mol of all gases in a cm^3
    wind_index: int
    filaments: FloatArray | None = None  # (n, 4): x, y, z in m, sigma in cm
    concentration: NDArray[np.float32] | None = field(default=None)  # (nx, ny, nz) ppm


class _Reader:
    """Reads numbers from the bytes of a result, in order; InputError where they end too early."""

    def __init__(self, content: bytes) -> None:
        self.content = content
        self.at = 0

    def take(self, size: int) -> bytes:
        if size > self.left:
            raise InputError(f"ends after {len(self.content)} bytes, within a value; expected more")
        part = self.content[self.at : self.at + size]
        self.at += size
        return part

    def numbers(self, layout: str) -> tuple[float, ...]:
        return struct.unpack("<" + layout, self.take(struct.calcsize("<" + layout)))

    def integer(self) -> int:
        return int(self.numbers("i")[0])

    def text(self) -> bytes:
        length = int(self.numbers("Q")[0])
        if length > 64:
            raise InputError(f"a text of {length} bytes; expected a source's type or a mode")
        return self.take(length)

    @property
    def left(self) -> int:
        return len(self.content) - self.at


def read_result(path: Path) -> GadenResult:
    """The result in the file at `path`. Raises InputError ("FILE: reason; expected ..")."""
    content = file_bytes(path, MAX_RESULT, "a result of GADEN")
    try:
        return _parse(_Reader(_inflate(content)))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _inflate(content: bytes) -> bytes:
    if content.startswith(_MARK):
        content = content[len(_MARK) + 8 :]
    stream = zlib.decompressobj()
    try:
        raw = stream.decompress(content, MAX_RESULT)
    except zlib.error as error:
        raise InputError(f"is not a zlib stream or damaged ({error}); expected a result of GADEN") from None
    if not stream.eof:
        reason = f"is longer than {MAX_RESULT} bytes" if stream.unconsumed_tail else "is cut off"
        raise InputError(f"{reason}; expected a whole result of GADEN")
    if stream.unused_data:
        raise InputError(f"has {len(stream.unused_data)} bytes after its end; expected none")
    return raw


def _parse(reader: _Reader) -> GadenResult:
    major = reader.integer()
    minor = reader.integer() if major in (2, 3) else 0
    if major not in (1, 2, 3):
        raise InputError(f"version {major}; expected 1, 2.x or 3.x")
    if major == 1:
        low, _ = reader.numbers("3d"), reader.numbers("3d")
        shape, cell = reader.numbers("3i"), reader.numbers("3d")
        if len(set(cell)) != 1:
            raise InputError(f"cells of {cell} m; expected cubes")
        source, gas = reader.numbers("3d"), reader.integer()
    else:
        shape, low, _ = reader.numbers("3i"), reader.numbers("3f"), reader.numbers("3f")
        cell = reader.numbers("f")
        if major == 3:
            kind = reader.text()
            if kind not in _SOURCES:
                raise InputError(
                    f"source of type {kind.decode('ascii', 'replace')!r:.40}; expected point, box, line, sphere"
                )
            reader.take(_SOURCES[kind])
        source, gas = reader.numbers("3f"), reader.integer()
    doubles = (major, minor) < (2, 6)
    moles, air = reader.numbers("2d" if doubles else "2f")
    wind_index = reader.integer()
    nx, ny, nz = (int(n) for n in shape)
    _check(low, source, float(cell[0]), (nx, ny, nz), moles, air)
    filaments, concentration = _content(reader, major, doubles, (nx, ny, nz))
    return GadenResult(
        version=(major, minor), low=np.array(low), cell=float(cell[0]), shape=(nx, ny, nz), source=np.array(source),
        gas=gas, moles=moles, air=air, wind_index=wind_index, filaments=filaments, concentration=concentration,
    )  # fmt: skip


def _check(
    low: tuple[float, ...],
    source: tuple[float, ...],
    cell: float,
    shape: tuple[int, int, int],
    moles: float,
    air: float,
) -> None:
    if min(shape) < 1 or math.prod(shape) > MAX_CELLS:
        raise InputError(f"{shape} cells; expected at least one each, {MAX_CELLS} together at most")
    if not all(map(math.isfinite, (*low, *source))) or not 0 < cell < math.inf:
        raise InputError(f"low corner {low}, source {source}, cell {cell}; expected finite places in m")
    if not (0 <= moles < math.inf and 0 < air < math.inf):
        raise InputError(f"{moles} mol in a filament, {air} mol/cm^3 of air; expected finite numbers, air above 0")


def _content(
    reader: _Reader, major: int, doubles: bool, shape: tuple[int, int, int]
) -> tuple[FloatArray | None, NDArray[np.float32] | None]:
    """The filaments or the concentration that the rest of the result holds."""
    mode = b"records"
    rest = reader.content[reader.at : reader.at + 22]
    if major == 3 and (rest[8:17] == b"filaments" or rest[8:22] == b"concentrations"):
        mode = reader.text()
    if mode == b"concentrations":
        return None, _concentration(reader, shape)
    if mode == b"filaments" and reader.left >= 8:
        (count,) = struct.unpack_from("<Q", reader.content, reader.at)
        for size in (20, 16):
            if reader.left - 8 == size * count:
                reader.take(8)
                packed = np.frombuffer(reader.take(reader.left), np.uint8).reshape(-1, size)
                return _checked(np.ascontiguousarray(packed[:, :16]).view("<f4")), None
    record = np.dtype([("id", "<i4"), ("numbers", "<f8" if doubles else "<f4", (4,))])
    if reader.left % record.itemsize:
        raise InputError(f"{reader.left} bytes of filaments; expected records of {record.itemsize}")
    return _checked(np.frombuffer(reader.take(reader.left), record)["numbers"]), None


def _checked(numbers: NDArray[np.generic]) -> FloatArray:
    with np.errstate(all="ignore"):  # NaN is refused below
        filaments = numbers.astype(np.float64)
    if not np.all(np.isfinite(filaments)) or np.any(filaments[:, 3] <= 0) or np.any(np.abs(filaments) > 1e9):
        raise InputError("filaments with places that are not finite, or widths not above 0; expected m and cm")
    return filaments


def _concentration(reader: _Reader, shape: tuple[int, int, int]) -> NDArray[np.float32]:
    n = math.prod(shape)
    if reader.left == 4 * n + 8:
        (count,) = reader.numbers("Q")
        if count != n:
            raise InputError(f"{count} concentrations; expected {n}, one for each cell")
    if reader.left != 4 * n:
        raise InputError(f"{reader.left} bytes of concentrations; expected {4 * n} for {shape} cells")
    nx, ny, nz = shape
    values = np.frombuffer(reader.take(reader.left), "<f4").reshape(nz, ny, nx).transpose(2, 1, 0)
    if not np.all(np.isfinite(values)) or values.min() < 0:
        raise InputError("concentrations that are not finite, or below 0; expected ppm")
    return np.ascontiguousarray(values, np.float32)


def write_result(path: Path, result: GadenResult) -> None:
    """Write the concentration of `result` as version 3.0, of a point source, to `path`."""
    assert result.concentration is not None
    high = result.low + result.cell * np.array(result.shape)
    raw = b"".join(
        (
            struct.pack("<2i3i7f", 3, 0, *result.shape, *result.low, *high, result.cell),
            struct.pack("<Q5s3fi", 5, b"point", *result.source, result.gas),
            struct.pack("<2fi", result.moles, result.air, result.wind_index),
            struct.pack("<Q14sQ", 14, b"concentrations", math.prod(result.shape)),
            to_flat(result.concentration).tobytes(),
        )
    )
    mark = _MARK + struct.pack("<Q", len(raw)) if len(raw) > _PLAIN_LIMIT else b""
    path.write_bytes(mark + zlib.compress(raw))
