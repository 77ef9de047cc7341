"""OpenFOAM's files: lists and fields of numbers, in text or binary, as its "FoamFile" header says.

Read here rather than by a library, because files come from strangers: the length that a list declares is compared with
the bytes that are there before anything is allocated, and nothing in a file is evaluated.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from osl_env.errors import InputError
from osl_env.parameters import FloatArray

MAX_FILE_BYTES = 2**30
_HEADER_BYTES = 2**14  # within which a header must end
_HEADER = re.compile(rb"FoamFile\s*\{(.*?)\}", re.DOTALL)
_ENTRY = re.compile(rb"(\w+)\s+(?:\"([^\"]*)\"|([^;\s]+))\s*;")
_BLANK = re.compile(rb"(?:\s|//[^\n]*\n|/\*.*?\*/)*", re.DOTALL)
_COUNT = re.compile(rb"\s*(\d{1,10})\s*\(")
_DIMENSIONS = re.compile(rb"\bdimensions\s+\[([-\d\s]*)\]")
_UNIFORM = re.compile(rb"\binternalField\s+uniform\s+([^;]*);")
_NONUNIFORM = re.compile(rb"\binternalField\s+nonuniform\s+List<(\w+)>")
_BRACKET, _LAST = re.compile(rb"\)"), re.compile(rb"\)\s*\)")  # the end of a list of numbers, of vectors
_BRACKETS = bytes.maketrans(b"()", b"  ")
_COMPONENTS = {"vector": 3, "scalar": 1}


class FoamFile(NamedTuple):
    """A file's bytes, and what its header says of them."""

    path: Path
    content: bytes
    body: int  # where the part after the header begins
    kind: str  # its class
    binary: bool
    label: np.dtype[Any]  # of its integers
    scalar: np.dtype[Any]  # of its numbers


def open_foam(path: Path) -> FoamFile:
    """The file at `path`. Raises InputError if it is not there, compressed, too large, or not OpenFOAM's."""
    if not path.is_file():
        packed = path.with_name(path.name + ".gz")
        if packed.is_file():
            raise InputError(f"{packed}: is compressed; set writeCompression off and run foamFormatConvert on the case")
        raise InputError(f"{path}: no such file; expected a file of an OpenFOAM case")
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise InputError(f"{path}: has {path.stat().st_size} bytes; at most {MAX_FILE_BYTES} are read")
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    header = _HEADER.search(content[:_HEADER_BYTES])
    if header is None:
        raise InputError(f"{path}: has no FoamFile header, so it is not an OpenFOAM file")
    entries = {key.decode(): (quoted or plain).decode("latin-1") for key, quoted, plain in _ENTRY.findall(header[1])}
    form, arch = entries.get("format", "ascii"), entries.get("arch", "")
    if form not in ("ascii", "binary"):
        raise InputError(f"{path}: format = {form!r:.40}: must be ascii or binary")
    order = ">" if "MSB" in arch else "<"
    label = np.dtype(f"{order}i{8 if 'label=64' in arch else 4}")
    scalar = np.dtype(f"{order}f{4 if 'scalar=32' in arch else 8}")
    body = _blank(content, header.end())
    return FoamFile(path, content, body, entries.get("class", ""), form == "binary", label, scalar)


def read_vectors(file: FoamFile) -> FloatArray:
    """The list of vectors (n, 3) that `file` holds."""
    return _numbers(file, file.body, 3, file.scalar, "vectors")[0].astype(np.float64)


def read_labels(file: FoamFile) -> NDArray[np.int64]:
    """The list of integers (n,) that `file` holds."""
    return _integers(file, file.body)[0]


def read_faces(file: FoamFile) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The faces that `file` holds: where each begins (n + 1,) in the list of the points of all of them."""
    if file.binary:
        if file.kind != "faceCompactList":
            raise InputError(f"{file.path}: class = {file.kind!r:.40}: binary faces must be a faceCompactList")
        starts, end = _integers(file, file.body)
        points, _ = _integers(file, end)
    else:
        count, at = _count(file, file.body)
        starts, points = _text_faces(file, count, _text(file, at, file.content.rfind(b")")))
    if starts.size < 2 or starts[0] != 0 or starts[-1] != points.size or np.any(np.diff(starts) < 3):
        raise InputError(f"{file.path}: its faces do not add up; expected at least three points for each")
    return starts, points


def read_internal(file: FoamFile, n_cells: int) -> FloatArray:
    """The field's values in the cells: (n_cells, 3) of a vector field, (n_cells,) of a scalar field."""
    if file.kind not in ("volVectorField", "volScalarField"):
        raise InputError(f"{file.path}: class = {file.kind!r:.40}: must be volVectorField or volScalarField")
    components = 3 if file.kind == "volVectorField" else 1
    uniform = _UNIFORM.search(file.content, file.body)
    listed = _NONUNIFORM.search(file.content, file.body)
    if uniform and not (listed and listed.start() < uniform.start()):
        values = np.tile(_parsed(file, uniform[1].translate(_BRACKETS), components, "numbers"), (n_cells, 1))
    elif listed:
        if _COMPONENTS.get(listed[1].decode()) != components:
            raise InputError(f"{file.path}: internalField: a list of {listed[1].decode()} in a {file.kind}")
        numbers, _ = _numbers(file, listed.end(), components, file.scalar, f"{listed[1].decode()}s", n_cells)
        values = numbers.astype(np.float64)
    else:
        raise InputError(f"{file.path}: has no internalField, uniform or nonuniform")
    return values.reshape(n_cells, 3) if components == 3 else values.reshape(n_cells)


def read_dimensions(file: FoamFile) -> tuple[int, ...]:
    """Powers of kg, m, s, K, mol, A, cd; () if the file does not say."""
    found = _DIMENSIONS.search(file.content, file.body)
    return tuple(int(power) for power in found[1].split()) if found else ()


def _blank(content: bytes, at: int) -> int:
    """Where blanks and comments from `at` on end."""
    found = _BLANK.match(content, at)
    return found.end() if found else at


def _count(file: FoamFile, at: int) -> tuple[int, int]:
    """The length that the list at `at` declares, and where its entries begin."""
    found = _COUNT.match(file.content, _blank(file.content, at))
    if found is None:
        raise InputError(f"{file.path}: byte {at}: expected a list, as 'length(entries)'")
    return int(found[1]), found.end()


def _integers(file: FoamFile, at: int) -> tuple[NDArray[np.int64], int]:
    values, end = _numbers(file, at, 1, file.label, "integers")
    return values.astype(np.int64).reshape(-1), end


def _numbers(
    file: FoamFile, at: int, width: int, kind: np.dtype[Any], what: str, expected: int | None = None
) -> tuple[NDArray[Any], int]:
    """The list at `at` of entries of `width` numbers, (n, width), and where it ends."""
    count, at = _count(file, at)
    if expected is not None and count != expected:
        raise InputError(f"{file.path}: holds {count} {what}; the mesh has {expected} cells")
    if file.binary:
        end = at + count * width * kind.itemsize
        if len(file.content) <= end or file.content[end : end + 1] != b")":
            raise InputError(f"{file.path}: is cut off or damaged: declares {count} {what} that are not there")
        numbers = np.frombuffer(file.content, kind, count * width, at)
    else:
        found = (_LAST if width > 1 else _BRACKET).search(file.content, at)
        end = found.end() - 1 if found else -1
        numbers = _parsed(file, _text(file, at, end), count * width, what)
    return numbers.reshape(count, width), end + 1


def _text(file: FoamFile, at: int, end: int) -> bytes:
    if end < at:
        raise InputError(f"{file.path}: is cut off: a list does not end")
    return file.content[at:end].translate(_BRACKETS)


def _parsed(file: FoamFile, text: bytes, expected: int, what: str) -> FloatArray:
    """The `expected` numbers of `text`."""
    words = text.split()
    if len(words) != expected:
        raise InputError(
            f"{file.path}: is cut off or damaged: {len(words)} numbers where {expected} are declared ({what})"
        )
    try:
        return np.array(words, dtype="S32").astype(np.float64)
    except ValueError:
        raise InputError(f"{file.path}: holds something that is not a number among its {what}") from None


def _text_faces(file: FoamFile, count: int, text: bytes) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Faces written as "4(0 1 2 3)", one after the other: starts and points."""
    words = text.split()
    numbers = _parsed(file, text, len(words), "faces").astype(np.int64)
    starts, at = [0], 0
    for _ in range(count):
        if at >= numbers.size or not 0 < numbers[at] < numbers.size - at:
            raise InputError(f"{file.path}: is cut off or damaged: {count} faces are declared")
        starts.append(starts[-1] + int(numbers[at]))
        at += 1 + int(numbers[at])
    lengths = np.array(starts[:-1], np.int64) + np.arange(count)
    keep = np.ones(at, np.bool_)
    keep[lengths] = False
    return np.array(starts, np.int64), numbers[:at][keep]
