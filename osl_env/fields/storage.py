"""The file of a field: NAME.npz, a zip of arrays that `numpy.load` reads without pickle, all little-endian.

    header          uint8 (n,)   JSON in UTF-8, see `Header`
    times           float64 (n_t,) s
    wind            uint8 (n_bytes, n_components, n_t, nx, ny, nz), packed: see `packing`; missing components are 0
    concentration   uint8 (n_bytes, 1, n_t, nx, ny, nz), packed
    solid           uint8 (nx, ny, nz)

Files come from strangers. What is read is what follows from the JSON header, and every size is known and added up
before anything large is allocated (see `archive`).
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic import Field as Key

from osl_env.errors import InputError
from osl_env.fields.archive import Archive, opened, write_arrays
from osl_env.fields.field import Field
from osl_env.fields.packing import pack_bits, pack_steps, unpack_bits, unpack_steps
from osl_env.parameters import one_line

MAX_FIELD_BYTES = 4 * 2**30  # of memory that reading one field may take
_MAX_HEADER = 2**20  # bytes of the JSON header
_UINT8, _FLOAT64 = np.dtype("|u1"), np.dtype("<f8")


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)


class Packing(_Strict):
    """How one quantity is packed: multiples of `step`, or float32 patterns with `mantissa` bits."""

    bytes: Literal[1, 2, 4]  # of a number
    components: int = Key(ge=1, le=3)
    step: float = Key(ge=0, le=1e3)  # 0: patterns
    mantissa: int = Key(ge=1, le=23)  # with patterns

    def unpack(self, planes: NDArray[np.uint8], out: NDArray[np.float32]) -> None:
        """Write `planes` into the first components of `out` (n_t, nx, ny, nz, any number)."""
        if self.step > 0:
            unpack_steps(planes, self.step, out)
        else:
            unpack_bits(planes, self.mantissa, out)


class Header(_Strict):
    """The JSON header of a field's file."""

    format: Literal["osl-field"] = "osl-field"
    version: Literal[1] = 1
    shape: tuple[int, int, int, int]  # n_t, nx, ny, nz
    origin: tuple[float, float, float]  # m, the centre of the first cell
    spacing: tuple[float, float, float]  # m
    period: float  # s
    unit: str = Key(max_length=40)
    wind: Packing | None
    concentration: Packing | None
    solid: bool
    card: dict[str, Any]


def save_field(field: Field, path: str | Path, *, wind_step: float = 0.01, mantissa: int = 10) -> None:
    """Write `field` to `path`, a file NAME.npz; the same field always gives the same bytes.

    Winds are rounded to multiples of `wind_step`, m/s (0: exact); concentrations to `mantissa` bits of 23 (23: exact;
    10: within 0.05 %). Raises InputError if the path does not end in .npz, cannot be written, or a number is out of
    its limits.
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise InputError(f"{path}: the file of a field must end in .npz")
    if not 0 <= wind_step <= 1e3 or 0 < wind_step < 1e-6:
        raise InputError(f"wind_step = {wind_step!r}: must be 0 (exact) or from 1e-6 to 1e3 m/s")
    if not isinstance(mantissa, int) or not 1 <= mantissa <= 23:
        raise InputError(f"mantissa = {mantissa!r}: must be an integer from 1 to 23")
    arrays: dict[str, NDArray[Any]] = {"times": field.times.astype(_FLOAT64)}
    packings: dict[str, Packing | None] = {"wind": None, "concentration": None}
    if field.wind is not None:
        n = 3 if np.any(field.wind[..., 2]) else 2 if np.any(field.wind[..., 1]) else 1
        part = field.wind[..., :n]
        arrays["wind"] = pack_steps(part, wind_step) if wind_step > 0 else pack_bits(part, 23)
        packings["wind"] = Packing(bytes=len(arrays["wind"]), components=n, step=wind_step, mantissa=23)  # type: ignore[arg-type]
    if field.concentration is not None:
        arrays["concentration"] = pack_bits(field.concentration[..., None], mantissa)
        packings["concentration"] = Packing(bytes=4, components=1, step=0.0, mantissa=mantissa)
    if field.solid is not None:
        arrays["solid"] = field.solid
    header = _header(field, packings).model_dump_json().encode()
    if len(header) > _MAX_HEADER:
        raise InputError(f"card: takes {len(header)} bytes; must be at most {_MAX_HEADER}")
    partial = path.with_name(f".{path.name}.partial")
    try:
        write_arrays(partial, {"header": np.frombuffer(header, np.uint8)} | arrays)
        os.replace(partial, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from None
    finally:
        partial.unlink(missing_ok=True)


def _header(field: Field, packings: dict[str, Packing | None]) -> Header:
    x, y, z = map(float, field.origin)
    dx, dy, dz = map(float, field.spacing)
    return Header(
        shape=(field.n_frames, *field.shape),
        origin=(x, y, z),
        spacing=(dx, dy, dz),
        period=float(field.period),
        unit=field.unit,
        solid=field.solid is not None,
        card=field.card,
        **packings,  # type: ignore[arg-type]
    )


def read_field(path: str | Path, max_bytes: int = MAX_FIELD_BYTES) -> Field:
    """The field in the file at `path`, which may be hostile. Raises InputError ("FILE: reason; expected ..").

    Refuses a file whose field would take more than `max_bytes` of memory to read.
    """
    with opened(Path(path), "a field's .npz file of whole, intact arrays") as archive:
        header = _read_header(archive)
        n_t, nx, ny, nz = header.shape
        if min(header.shape) < 1:
            raise InputError(f"header: shape = {list(header.shape)}; expected at least one frame and one cell")
        if header.wind is None and header.concentration is None:
            raise InputError("header: holds no wind and no concentration; expected at least one")
        cells = n_t * nx * ny * nz
        packed = max(p.bytes * p.components for p in (header.wind, header.concentration) if p is not None)
        temporary = 14  # bytes of a number while it is unpacked
        needed = cells * ((12 if header.wind else 0) + (4 if header.concentration else 0) + packed + temporary)
        if needed + 8 * n_t + nx * ny * nz > max_bytes:
            raise InputError(f"shape = {list(header.shape)} needs {needed:.3g} bytes; expected at most {max_bytes:.3g}")
        archive.expect(_expected(header))
        return _read_arrays(archive, header)


def _read_header(archive: Archive) -> Header:
    content = archive.read_bytes("header", _MAX_HEADER)
    try:
        return Header.model_validate_json(content)
    except ValidationError as error:
        if error.errors()[0]["type"] == "json_invalid":
            raise InputError("header: is not JSON; expected the header of a field") from None
        raise InputError(f"{str(one_line(error, 'header'))[:300]}; expected a header of version 1") from None


def _expected(header: Header) -> dict[str, tuple[np.dtype[Any], tuple[int, ...]]]:
    """The type and shape of each array that the header announces."""
    arrays: dict[str, tuple[np.dtype[Any], tuple[int, ...]]] = {"times": (_FLOAT64, header.shape[:1])}
    for name, packing in (("wind", header.wind), ("concentration", header.concentration)):
        if packing is not None:
            arrays[name] = (_UINT8, (packing.bytes, packing.components, *header.shape))
    if header.solid:
        arrays["solid"] = (_UINT8, header.shape[1:])
    return arrays


def _read_arrays(archive: Archive, header: Header) -> Field:
    wind = concentration = None
    if header.concentration is not None:
        if header.concentration.components != 1:
            raise InputError(f"header: concentration has {header.concentration.components} components; expected 1")
        planes = archive.read("concentration")
        concentration = np.zeros(header.shape, np.float32)
        header.concentration.unpack(planes, concentration[..., None])
    if header.wind is not None:
        planes = archive.read("wind")
        wind = (np.zeros if header.wind.components < 3 else np.empty)((*header.shape, 3), np.float32)
        header.wind.unpack(planes, wind)
    return Field(
        times=archive.read("times"),
        origin=np.array(header.origin),
        spacing=np.array(header.spacing),
        wind=wind,
        concentration=concentration,
        unit=header.unit,
        solid=archive.read("solid") if header.solid else None,
        period=header.period,
        card=header.card,
    )
