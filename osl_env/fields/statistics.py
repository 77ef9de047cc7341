"""What a field is like, in a few numbers: for cards, for `osl plume stats`, and to compare cases.

Means are over the cells that hold air and over the frames. Wind: u = U + u' with U the time mean in a cell; `rms` are
the root mean squares of u'. Concentration: the coefficient of variation of a cell (standard deviation over mean) is
averaged over the cells whose mean is above a hundredth of the largest; `intermittency` is the part of the time in which
such a cell has more than a tenth of its mean (1: never clean air).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_env.fields.field import Field

_DIGITS = 4


def statistics(field: Field) -> dict[str, Any]:
    """The numbers of `field` as a JSON mapping; its keys name the unit where there is one."""
    numbers: dict[str, Any] = {
        "cells": list(field.shape),
        "spacing_m": _rounded(field.spacing),
        "low_m": _rounded(field.low),
        "high_m": _rounded(field.high),
        "frames": field.n_frames,
        "duration_s": _rounded(field.duration),
        "period_s": _rounded(field.period),
        "solid_fraction": _rounded(1.0 - field.free.mean()),
    }
    if field.wind is not None:
        numbers["wind"] = _of_wind(field.wind, field.free)
    if field.concentration is not None:
        numbers["concentration"] = {"unit": field.unit} | _of_concentration(field.concentration, field.free)
    return numbers


def _of_wind(wind: NDArray[np.float32], free: NDArray[np.bool_]) -> dict[str, Any]:
    if not free.any():
        return {}
    sums, squares, speeds, fastest = np.zeros((*free.shape, 3)), np.zeros((*free.shape, 3)), 0.0, 0.0
    for frame in wind:
        exact = frame.astype(np.float64)
        sums += exact
        squares += exact**2
        speed = np.sqrt((exact**2).sum(axis=-1))[free]
        speeds += float(speed.mean())
        fastest = max(fastest, float(speed.max()))
    mean = sums / len(wind)
    variance = np.maximum(squares / len(wind) - mean**2, 0.0)
    rms = np.sqrt(variance[free].mean(axis=0))
    speed = speeds / len(wind)
    return {
        "mean_m_s": _rounded(mean[free].mean(axis=0)),
        "mean_speed_m_s": _rounded(speed),
        "largest_speed_m_s": _rounded(fastest),
        "rms_m_s": _rounded(rms),
        "turbulence_intensity": _rounded(np.sqrt((rms**2).mean()) / speed if speed > 0 else 0.0),
    }


def _of_concentration(concentration: NDArray[np.float32], free: NDArray[np.bool_]) -> dict[str, Any]:
    if not free.any():
        return {}
    sums, squares = np.zeros(free.shape), np.zeros(free.shape)
    for frame in concentration:
        sums += frame
        squares += frame.astype(np.float64) ** 2
    mean = sums / len(concentration)
    plume = free & (mean > 0.01 * mean[free].max()) & (mean > 0)
    present = np.zeros(free.shape)
    for frame in concentration:
        present += frame > 0.1 * mean
    deviation = np.sqrt(np.maximum(squares / len(concentration) - mean**2, 0.0))
    return {
        "mean": _rounded(mean[free].mean()),
        "largest": _rounded(concentration.max()),
        "plume_fraction": _rounded(plume.sum() / free.sum()),
        "coefficient_of_variation": _rounded((deviation[plume] / mean[plume]).mean()) if plume.any() else None,
        "intermittency": _rounded((present[plume] / len(concentration)).mean()) if plume.any() else None,
    }


def _rounded(value: Any) -> Any:
    """`value`, a number or an array, with a few significant digits, as JSON numbers."""
    if np.ndim(value):
        return [_rounded(entry) for entry in value]
    return float(f"{float(value):.{_DIGITS}g}") + 0.0
