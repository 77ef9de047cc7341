"""A zip of arrays from a stranger, read within bounds.

The end of the zip must be plain (no zip64, no comment) and its directory small. The sizes that the directory and the
arrays' own headers declare must be those expected, and are compared before anything large is allocated; a member that
would have to shrink better than deflate can is refused; members are inflated to their expected length and not a byte
further, and their checksums must hold. Arrays are little-endian, in C order, of plain numbers; no pickle.
"""

from __future__ import annotations

import math
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, TypeAlias

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from osl_env.errors import InputError

Expected: TypeAlias = Mapping[str, tuple[np.dtype[Any], tuple[int, ...]]]

_END = struct.Struct("<4s4H2LH")  # the end of a zip's directory
_LOCATOR_SIZE = 20  # of the zip64 locator, which would stand before it
_MAX_MEMBERS = 16
_MAX_DIRECTORY = 2**14  # bytes
_MAX_ARRAY_HEADER = 1024  # bytes
_ARRAY_HEADER = re.compile(
    rb"\{'descr': '([<>|][a-z]\d{1,4})', 'fortran_order': False, 'shape': \(((?:\d{1,19}, ?)*(?:\d{1,19})?)\), \} *\n"
)
_MAX_INFLATION = 1040  # deflate cannot do better than 1032 to 1
_CHUNK = 2**20  # bytes inflated at a time
_DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    EOFError,
    OSError,
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    RuntimeError,  # an encrypted member; a method or zip version that Python does not know; nesting too deep
    ArithmeticError,
)


class Archive:
    """The arrays of an open zip file. Errors are InputErrors without the file's name, or of the kinds in _DAMAGE."""

    def __init__(self, file: IO[bytes]) -> None:
        """Check the directory of `file`."""
        size = _check_end(file)
        self._zip = zipfile.ZipFile(file)
        self._members: dict[str, zipfile.ZipInfo] = {}
        self._expected: Expected = {}
        for info in self._zip.infolist():
            name = info.filename.removesuffix(".npy")
            if name == info.filename or name in self._members:
                raise InputError(f"member {info.filename!r:.60}; expected arrays (.npy), each of them once")
            if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise InputError(f"{name}: compression method {info.compress_type}; expected stored or deflated")
            if info.compress_size > size or info.file_size > _MAX_INFLATION * (info.compress_size + 1):
                raise InputError(
                    f"{name}: {info.file_size} bytes are said to lie in {min(info.compress_size, size)};"
                    f" expected at most {_MAX_INFLATION} to 1"
                )
            self._members[name] = info

    def read_bytes(self, name: str, limit: int) -> bytes:
        """The uint8 array `name` of at most `limit` bytes."""
        size = self._member(name).file_size
        if size > limit + _MAX_ARRAY_HEADER:
            raise InputError(f"{name}: has {size} bytes; expected at most {limit}")
        with self._zip.open(self._member(name)) as stream:
            found, shape = _array_header(stream, name)
            if found != "|u1" or len(shape) != 1 or size != stream.tell() + shape[0]:
                raise InputError(f"{name}: is {found} of shape {shape}; expected one row of bytes")
            return _inflated(stream, name, shape[0]).tobytes()

    def expect(self, arrays: Expected) -> None:
        """Refuse the file if it has not exactly these `arrays` (type and shape for each name) besides its header."""
        names = {"header", *arrays}
        if missing := sorted(names - set(self._members)):
            raise InputError(f"array {missing[0]!r} is missing; expected {', '.join(sorted(names))}")
        if extra := sorted(set(self._members) - names):
            raise InputError(f"array {extra[0]!r:.60} is unknown; expected {', '.join(sorted(names))}")
        for name, (dtype, shape) in arrays.items():
            payload, size = math.prod(shape) * dtype.itemsize, self._member(name).file_size
            if not payload < size <= payload + _MAX_ARRAY_HEADER:
                raise InputError(f"{name}: has {size} bytes; expected {payload} and a header for shape {shape}")
        self._expected = arrays

    def read(self, name: str) -> NDArray[Any]:
        """The array `name`, of the type and shape expected of it."""
        dtype, shape = self._expected[name]
        payload = math.prod(shape) * dtype.itemsize
        with self._zip.open(self._member(name)) as stream:
            found, found_shape = _array_header(stream, name)
            if found != dtype.str or found_shape != shape:
                raise InputError(f"{name}: is {found} of shape {found_shape}; expected {dtype.str} of {shape}")
            if stream.tell() + payload != self._member(name).file_size:
                raise InputError(f"{name}: has bytes after its {payload}; expected none")
            return _inflated(stream, name, payload).view(dtype).reshape(shape)

    def _member(self, name: str) -> zipfile.ZipInfo:
        if name not in self._members:
            raise InputError(f"array {name!r} is missing; expected the arrays of a field")
        return self._members[name]


def _check_end(file: IO[bytes]) -> int:
    """The size of `file`, whose last bytes must be the plain end of a small zip directory."""
    size = file.seek(0, 2)
    tail = _END.size + _LOCATOR_SIZE
    if size < tail:
        raise InputError(f"has {size} bytes; expected a field's .npz file")
    file.seek(-tail, 2)
    last = file.read(tail)
    mark, _, _, _, members, length, start, comment = _END.unpack(last[_LOCATOR_SIZE:])
    if mark != b"PK\x05\x06" or comment != 0 or start + length != size - _END.size or last[:4] == b"PK\x06\x07":
        raise InputError("does not end as a zip of arrays does, it may be cut off; expected a whole .npz file")
    if members > _MAX_MEMBERS or length > _MAX_DIRECTORY:
        raise InputError(f"{members} members in a directory of {length} bytes; expected the few arrays of a field")
    return size


def _array_header(stream: IO[bytes], name: str) -> tuple[str, tuple[int, ...]]:
    """The type ("<f8") and the shape that an array's own header declares.

    Read here, for `numpy.lib.format` parses it as Python source, with all that can go wrong in that.
    """
    start = stream.read(10)
    if len(start) < 10 or start[:8] != b"\x93NUMPY\x01\x00":
        raise InputError(f"{name}: unknown version of the array format; expected 1.0")
    size = int.from_bytes(start[8:], "little")
    found = _ARRAY_HEADER.fullmatch(stream.read(size)) if size <= _MAX_ARRAY_HEADER else None
    if found is None:
        raise InputError(f"{name}: its header is not that of plain numbers in C order; expected such an array")
    return found[1].decode(), tuple(int(n) for n in found[2].replace(b",", b" ").split())


def _inflated(stream: IO[bytes], name: str, size: int) -> NDArray[np.uint8]:
    """The last `size` bytes of a member; its checksum is compared when it ends."""
    out = np.empty(size, np.uint8)
    done = 0
    while done < size:
        chunk = stream.read(min(_CHUNK, size - done))
        if not chunk:
            raise InputError(f"{name}: ends after {done} bytes; expected {size}")
        out[done : done + len(chunk)] = np.frombuffer(chunk, np.uint8)
        done += len(chunk)
    if stream.read(1):
        raise InputError(f"{name}: goes on after its {size} bytes; expected its end")
    return out


@contextmanager
def opened(path: Path, expected: str) -> Iterator[Archive]:
    """The arrays of the file at `path`; whatever goes wrong inside is an InputError "FILE: reason; expected .."."""
    try:
        if not path.is_file():
            raise InputError(f"{'is not a file' if path.exists() else 'no such file'}; expected {expected}")
        with path.open("rb") as file:
            yield Archive(file)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except MemoryError:
        raise InputError(f"{path}: needs more memory than there is; expected {expected}") from None
    except _DAMAGE as error:
        raise InputError(
            f"{path}: is damaged ({str(error)[:100] or type(error).__name__}); expected {expected}"
        ) from None


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write `arrays` to the zip at `path`, deflated, without the time of day: the same arrays, the same bytes."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, array in arrays.items():
            info = zipfile.ZipInfo(f"{name}.npy")
            info.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(info, "w") as stream:
                npy.write_array(stream, np.ascontiguousarray(array), version=(1, 0), allow_pickle=False)
