"""What a plume is like on the line downwind of its source, and the wind in it, measured over time.

At every station: mean and peak reading; intermittency, the part of the time above the threshold; coefficient of
variation, standard deviation over mean; whiffs, how often a minute the reading rises through the threshold. The
threshold is the gas sensor's, or where there is none a tenth of the station's own mean. Wind: mean velocity, root
mean square of its deviations from each place's own mean, and the largest speed, over a grid at the source's height.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

from osl_env.parameters import FloatArray
from training.plume_pictures import horizontal, upright
from training.plume_subjects import Subject

_STEPS = (1.0, 2.0, 5.0)  # distances are these, times powers of ten
_SHARE_OF_MEAN = 0.1
_WIND_PLACES = 8  # along the longer side
_NEAREST = 0.01  # of the way to the bounds: the first station


@dataclass(frozen=True)
class Station:
    """The plume at one distance downwind. None: the plume does not change, or was never there."""

    distance: float  # m
    mean: float  # in the plume's unit
    peak: float
    intermittency: float | None
    variation: float | None
    whiffs: float | None  # 1/min


@dataclass(frozen=True)
class Measurement:
    """What `measure` found. Winds in m/s, times in s."""

    unit: str
    seconds: float
    samples: int
    threshold: float | None  # in `unit`; None: a tenth of each station's mean
    stations: tuple[Station, ...]
    mean_wind: tuple[float, ...]
    wind_rms: tuple[float, ...]
    largest_wind: float

    def to_dict(self) -> dict[str, object]:
        """For JSON."""
        return asdict(self)


def distances(reach: float) -> FloatArray:
    """1, 2, 5, 10, .. m (or 0.1, 0.2, ..) up to `reach`, m, from a hundredth of it on."""
    powers = 10.0 ** np.arange(-3, 5)
    all_steps = np.outer(powers, _STEPS).ravel()
    return np.asarray(all_steps[(all_steps >= _NEAREST * reach) & (all_steps <= reach)])


def measure(
    subject: Subject, seconds: float, interval: float, threshold: float | None = None, tell: Callable[[], object] = int
) -> Measurement:
    """Sample `subject` every `interval` s for `seconds` s, calling `tell` after each; once if it does not change."""
    plane = upright(subject)
    away = distances(plane.a[1])
    has_gas = subject.unit != "m/s"
    line = plane.start + away[:, None] * plane.along + subject.centre[2] * plane.across
    flat = horizontal(subject, float(subject.centre[2]))
    grid = flat.places(*flat.cells(_WIND_PLACES))[2].reshape(-1, 3)
    grid = np.ascontiguousarray(grid[~subject.solid(grid)])
    n = max(2, round(seconds / interval)) if subject.changes else 1
    readings, winds = [], []
    for k in range(n):
        if k > 0:
            subject.go_on(interval)
        readings.append(subject.readings(line) if has_gas else np.zeros(len(line)))
        winds.append(subject.winds(grid))
        tell()
    heard, blown = np.array(readings), np.array(winds)
    deviations = blown - blown.mean(axis=0)
    return Measurement(
        unit=subject.unit,
        seconds=(n - 1) * interval,
        samples=n,
        threshold=threshold,
        stations=tuple(
            _station(d, column, interval, threshold) for d, column in zip(away, heard.T, strict=True) if has_gas
        ),
        mean_wind=tuple(map(float, blown.mean(axis=(0, 1)))),
        wind_rms=tuple(map(float, np.sqrt((deviations**2).mean(axis=(0, 1))))),
        largest_wind=float(np.linalg.norm(blown, axis=-1).max()),
    )


def _station(distance: float, readings: FloatArray, interval: float, threshold: float | None) -> Station:
    """`readings` (n,) at `distance` m, taken every `interval` s."""
    mean, peak = float(readings.mean()), float(readings.max())
    if len(readings) < 2 or mean <= 0:
        return Station(float(distance), mean, peak, None, None, None)
    above = readings > (_SHARE_OF_MEAN * mean if threshold is None else threshold)
    rises = int(np.sum(above[1:] & ~above[:-1]))
    minutes = (len(readings) - 1) * interval / 60.0
    return Station(float(distance), mean, peak, float(above.mean()), float(readings.std() / mean), rises / minutes)
