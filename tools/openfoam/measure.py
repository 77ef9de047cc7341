"""The numbers of a field's card: the wakes, the shedding of vortices, and the gas of a filament plume in the wind.

The wakes: for each obstacle the rectangle behind it, four of its widths long and two wide; without obstacles the
whole arena. The shedding frequency is the peak of the spectrum of the cross-stream wind, averaged over the wakes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from settings import Box

from osl_env.arena import Arena
from osl_env.fields import Field
from osl_env.parameters import FloatArray
from osl_env.plumes.base import Scene
from osl_env.plumes.filament import FilamentPlume
from osl_env.winds.field import FieldWind

LENGTH, WIDTH = 4.0, 2.0  # of a wake, in widths of the obstacle


def wakes(field: Field, obstacles: list[Box]) -> NDArray[np.bool_]:
    """(nx, ny, nz): the cells of the wakes."""
    x, y = field.centres("x")[:, None], field.centres("y")[None, :]
    area = np.zeros(field.shape[:2], np.bool_) if obstacles else np.ones(field.shape[:2], np.bool_)
    for low, high in obstacles:
        width, middle = high[1] - low[1], 0.5 * (low[1] + high[1])
        area |= (x > high[0]) & (x < high[0] + LENGTH * width) & (np.abs(y - middle) < 0.5 * WIDTH * width)
    return np.asarray(area[..., None] & field.free)


def _digits(values: Any) -> Any:
    return [_digits(value) for value in values] if np.ndim(values) else float(f"{float(values):.3g}")


def of_wakes(field: Field, obstacles: list[Box]) -> dict[str, Any]:
    """Mean and root mean square of both components over the wakes, m/s, and the shedding frequency, Hz."""
    assert field.wind is not None
    wind = field.wind[:, wakes(field, obstacles), :2].astype(np.float64)  # (n_t, n, 2)
    fluctuation = wind - wind.mean(axis=0)
    numbers: dict[str, Any] = {
        "mean_m_s": _digits(wind.mean(axis=(0, 1))),
        "rms_m_s": _digits(np.sqrt((fluctuation**2).mean(axis=(0, 1)))),
    }
    if obstacles:
        spectrum = (np.abs(np.fft.rfft(fluctuation[..., 1], axis=0)) ** 2).mean(axis=1)
        smooth = np.convolve(spectrum, [0.25, 0.5, 0.25], mode="same")
        frequency = np.fft.rfftfreq(len(wind), field.loop_period / field.n_frames)
        numbers["shedding_hz"] = _digits(frequency[1 + int(np.argmax(smooth[1:]))])
    return numbers


def divergence(field: Field) -> float:
    """Root mean square of the divergence in cells whose neighbours are free, over that of du/dx."""
    assert field.wind is not None
    free = field.free[:, :, 0]
    inner = free[1:-1, 1:-1] & free[2:, 1:-1] & free[:-2, 1:-1] & free[1:-1, 2:] & free[1:-1, :-2]
    wind = field.wind[:, :, :, 0]
    along = (wind[:, 2:, 1:-1, 0] - wind[:, :-2, 1:-1, 0]) / (2 * field.spacing[0])
    across = (wind[:, 1:-1, 2:, 1] - wind[:, 1:-1, :-2, 1]) / (2 * field.spacing[1])
    return float(np.sqrt(((along + across)[:, inner] ** 2).mean() / (along[:, inner] ** 2).mean()))


def develop(
    field: Path, plume: FilamentPlume, arena: Arena, source: FloatArray, times: FloatArray, points: FloatArray
) -> FloatArray:
    """The gas (n_times, n) of one source at `points` (n, 3) m, at `times` s after it opened, in the wind of `field`."""
    wind = FieldWind(field=str(field))
    air = wind.allocate(1, arena)
    rows, seeds, due = np.zeros(1, np.int64), np.zeros(1, np.int64), np.ones(1, np.bool_)
    wind.begin(air, rows, seeds, 0.0)
    away = np.zeros((1, 1, 3))
    scene = Scene(source[None, None], np.ones((1, 1)), air.air, arena.geometry, np.array(arena.size), away)
    state = plume.allocate(1, 1, arena)
    plume.begin(state, scene, rows, seeds)
    gas, clock = [], 0
    for time in times:
        while clock * plume.tick < time:
            clock += 1
            wind.advance(air, due, np.full(1, clock * plume.tick), plume.tick)
            plume.advance(state, scene, due)
        gas.append(plume.at(state, scene, 0, points))
    return np.array(gas)


def of_gas(gas: FloatArray) -> dict[str, Any]:
    """How intermittent the gas (n_times, n) is, over the points whose mean is above a hundredth of the largest one.

    Coefficient of variation in time, and the share of the time with more than a tenth of the point's mean: as in
    `osl_env.fields.statistics`.
    """
    mean = gas.mean(axis=0)
    plume = gas[:, mean > 0.01 * mean.max()]
    local = plume.mean(axis=0)
    return {
        "coefficient_of_variation": _digits((plume.std(axis=0) / local).mean()),
        "intermittency": _digits((plume > 0.1 * local).mean()),
    }
