"""How the numbers of a field are packed, so that they compress well and unpack fast.

Values are first made integers: multiples of a step (winds), or the bit patterns of float32 rounded to some bits of
mantissa (concentrations, which span many magnitudes; the patterns of numbers above 0 are in the order of the numbers).
The integers are differenced from frame to frame, then along x, modulo their width; differences of either sign become
small unsigned numbers (zigzag: 0, -1, 1, -2, ..), and these are split into planes of bytes, of which the high ones are
nearly all 0. The planes, uint8 of shape (n_bytes, n_components, n_t, nx, ny, nz), are what a file holds.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from osl_env.errors import InputError

Planes: TypeAlias = NDArray[np.uint8]
Grid: TypeAlias = NDArray[np.float32]

_SIGNED: dict[int, np.dtype[Any]] = {1: np.dtype(np.int8), 2: np.dtype(np.int16), 4: np.dtype(np.int32)}
_UNSIGNED: dict[int, np.dtype[Any]] = {1: np.dtype(np.uint8), 2: np.dtype(np.uint16), 4: np.dtype(np.uint32)}
_MANTISSA = 23  # bits of a float32


def pack_steps(grid: Grid, step: float) -> Planes:
    """Planes of `grid` (n_t, nx, ny, nz, n_components) rounded to multiples of `step`; 1, 2 or 4 bytes a number."""
    steps = np.rint(np.moveaxis(grid, -1, 0).astype(np.float64) / step)
    largest = float(np.abs(steps).max())
    if largest > 2**31 - 1:
        raise InputError(f"wind_step = {step:g}: too small for winds of {largest * step:g} m/s")
    n_bytes = 1 if largest <= 127 else 2 if largest <= 32767 else 4
    return _split(steps.astype(_SIGNED[n_bytes]))


def unpack_steps(planes: Planes, step: float, out: Grid) -> None:
    """Write the numbers of `planes` into the first components of `out` (n_t, nx, ny, nz, any number)."""
    for component in range(planes.shape[1]):
        steps = _join(planes[:, component])
        np.multiply(steps, np.float32(step), out=out[..., component], dtype=np.float32, casting="unsafe")


def pack_bits(grid: Grid, mantissa: int) -> Planes:
    """Planes of `grid` (n_t, nx, ny, nz, n_components) with `mantissa` bits of 23, rounded to nearest."""
    patterns = np.ascontiguousarray(np.moveaxis(grid, -1, 0)).view(np.uint32)
    dropped = np.uint32(_MANTISSA - mantissa)
    if dropped:
        half = np.uint32(1) << (dropped - np.uint32(1))
        patterns = ((patterns + half) >> dropped) << dropped
    return _split((patterns >> dropped).astype(np.uint32).view(np.int32))


def unpack_bits(planes: Planes, mantissa: int, out: Grid) -> None:
    """Write the numbers of `planes` into the first components of `out` (n_t, nx, ny, nz, any number)."""
    for component in range(planes.shape[1]):
        patterns = _join(planes[:, component]).view(np.uint32) << np.uint32(_MANTISSA - mantissa)
        out[..., component] = patterns.view(np.float32)


def _split(numbers: NDArray[Any]) -> Planes:
    """Planes (n_bytes, n_components, n_t, ..) of signed integers (n_components, n_t, ..)."""
    n_bytes = numbers.dtype.itemsize
    differences = numbers.copy()
    differences[:, 1:] -= numbers[:, :-1]
    differences[:, :, 1:] -= differences[:, :, :-1].copy()
    sign = differences >> np.array(8 * n_bytes - 1, numbers.dtype)
    zigzag = ((differences << np.array(1, numbers.dtype)) ^ sign).view(_UNSIGNED[n_bytes])
    planes = np.empty((n_bytes, *numbers.shape), np.uint8)
    for k in range(n_bytes):
        planes[k] = (zigzag >> np.array(8 * k, zigzag.dtype)).astype(np.uint8)
    return planes


def _join(planes: Planes) -> NDArray[Any]:
    """The signed integers (n_t, ..) of the planes (n_bytes, n_t, ..) of one component."""
    n_bytes = planes.shape[0]
    unsigned, signed = _UNSIGNED[n_bytes], _SIGNED[n_bytes]
    zigzag = planes[0].astype(unsigned)
    for k in range(1, n_bytes):
        zigzag |= planes[k].astype(unsigned) << np.array(8 * k, unsigned)
    low_bit = (zigzag & np.array(1, unsigned)).view(signed)
    zigzag >>= np.array(1, unsigned)
    numbers: NDArray[Any] = zigzag.view(signed)
    numbers ^= -low_bit
    for i in range(1, numbers.shape[1]):
        numbers[:, i] += numbers[:, i - 1]
    for frame in range(1, len(numbers)):
        numbers[frame] += numbers[frame - 1]
    return numbers
