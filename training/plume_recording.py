"""A simulated plume as a field, to play back or export: readings and winds at the centres of cells, frame by frame."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from osl_env.errors import InputError
from osl_env.fields import Field
from osl_env.geometry import SOLID
from training.plume_subjects import Subject

_CELLS_ALONG = 60  # the longer side, by default
_MAX_BYTES = 2 * 2**30
_MAX_ROWS = 5_000_000


def record(
    subject: Subject, seconds: float, interval: float, spacing: float | None, tell: Callable[[], object] = int
) -> Field:
    """`subject` from now on for `seconds` s: a frame every `interval` s, on cubic cells of `spacing` m.

    One frame if it does not change. By default 60 cells lie along the longer side. `tell` is called after each frame.
    Raises InputError if the field would take over 2 GiB.
    """
    sides = subject.high - subject.low
    cell = float(sides.max()) / _CELLS_ALONG if spacing is None else spacing
    frames = 1 + (round(seconds / interval) if subject.changes else 0)
    bound = float(np.prod(np.maximum(sides / cell, 1.0))) * frames * 16
    if not bound <= _MAX_BYTES:
        needs = f"spacing = {cell:g} m, {frames} frames: this field would take {bound / 2**30:.1f} GiB"
        raise InputError(f"{needs}; at most 2 GiB, with larger --spacing or --interval or fewer --seconds")
    n = [max(1, math.ceil(side / cell - 1e-9)) for side in sides]
    origin = subject.low + cell / 2
    places = origin + cell * np.stack(np.meshgrid(*map(np.arange, n), indexing="ij"), axis=-1)
    gas, air = np.empty((frames, *n), np.float32), np.empty((frames, *n, 3), np.float32)
    for k in range(frames):
        if k > 0:
            subject.go_on(interval)
        gas[k], air[k] = subject.readings(places), subject.winds(places)
        tell()
    blocked = subject.solid(places).astype(np.uint8) * np.uint8(SOLID)
    return Field(
        times=np.arange(frames, dtype=np.float64) * float(interval),
        origin=origin,
        spacing=np.full(3, cell),
        wind=air,
        concentration=np.maximum(gas, 0.0),
        unit=subject.unit,
        solid=blocked if blocked.any() else None,
        card={
            "title": f"{subject.name}, recorded",
            "source": "simulated by osl-env",
            "sources": [{"position": place.tolist()} for place in subject.sources],
        },
    )


def table(field: Field) -> pd.DataFrame:
    """One row a frame and free cell: time (s), x, y, z (m), the concentration in the field's unit, and u, v, w (m/s).

    Raises InputError above 5 million rows.
    """
    free = field.free
    rows = field.n_frames * int(free.sum())
    if rows > _MAX_ROWS:
        raise InputError(f"{rows:,} rows: at most {_MAX_ROWS:,} in a CSV; with fewer --seconds or larger --spacing")
    grids = np.meshgrid(field.centres("x"), field.centres("y"), field.centres("z"), indexing="ij")
    x, y, z = (grid[free] for grid in grids)
    columns: dict[str, NDArray[Any]] = {"time_s": np.repeat(field.times, len(x))}
    columns |= {f"{axis}_m": np.tile(places, field.n_frames) for axis, places in zip("xyz", (x, y, z), strict=True)}
    if field.concentration is not None:
        columns[f"concentration_{field.unit}"] = field.concentration[:, free].ravel()
    if field.wind is not None:
        blown = field.wind[:, free].reshape(-1, 3)
        columns |= {f"{name}_m_s": blown[:, k] for k, name in enumerate("uvw")}
    return pd.DataFrame(columns)
