"""Legs and observations relative to the wind: the agent `course`, for whom upwind is always the same way.

Actions are numbers 0 .. n-1: direction * (number of lengths) + length flies a leg of `lengths[length]` m in one of ten
directions (eight horizontal ones, 45 degrees apart, from upwind over the left; up; down) and samples `samples` times
at its end; the next number hovers and samples `hover_samples` times; the last one declares the UAV's own place if its
last sample read at least `declare_reading` hits, and hovers otherwise. A leg that would leave the area ends at its
boundary, on the nearest point to where it would have ended.

Observations are those of the features, turned about the vertical so that x points upwind and y to the left of it; only
the measured wind itself keeps the area's axes. `raw.position` becomes the offset from the area's centre and `raw.area`
the half widths of the area along those axes, both over half of its horizontal diagonal. Without wind, y is upwind.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.features import FeatureSpec, spec_names
from osl_env.errors import InputError
from osl_env.observation import AREA_SCALE, WIND_SCALE
from osl_env.parameters import FloatArray, Parameters, quantity
from osl_env.state import IntArray

Float32Array = NDArray[np.float32]
_CALM = 1e-3  # m/s: no wind
_DIAGONAL = math.sqrt(0.5)
# (10, 3): upwind, left of upwind, up
_DIRECTIONS = np.array([
    (1.0, 0.0, 0.0), (_DIAGONAL, _DIAGONAL, 0.0), (0.0, 1.0, 0.0), (-_DIAGONAL, _DIAGONAL, 0.0), (-1.0, 0.0, 0.0),
    (-_DIAGONAL, -_DIAGONAL, 0.0), (0.0, -1.0, 0.0), (_DIAGONAL, -_DIAGONAL, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0),
])  # fmt: skip


class Course(Parameters):
    """What the actions of a course agent mean."""

    lengths: tuple[float, ...] = quantity((3.0, 9.0), "m", min_length=1, max_length=16)
    samples: int = quantity(2, "", ge=1)  # at the end of a leg
    hover_samples: int = quantity(4, "", ge=1)
    declare_reading: int = quantity(0, "", ge=0)  # hits

    @property
    def n_actions(self) -> int:
        """How many actions there are."""
        return len(_DIRECTIONS) * len(self.lengths) + 2

    def boxes(
        self, actions: IntArray, positions: FloatArray, winds: FloatArray, readings: FloatArray, area: FloatArray,
        max_samples: int,
    ) -> FloatArray:  # fmt: skip
        """What `actions` (n,) mean as actions of `waypoint` (n, 5), of UAVs at `positions` (n, 3), m.

        `winds` (n, 3), m/s, as measured; `readings` (n,), hits; `area` (3,), m. See `osl_env.agent_actions`.
        """
        hover = self.n_actions - 2
        legs = np.minimum(actions, hover - 1)
        steps = _DIRECTIONS[legs // len(self.lengths)] * np.array(self.lengths)[legs % len(self.lengths), None]
        up = upwind(winds[:, :2])
        moves = np.stack(
            [
                steps[:, 0] * up[:, 0] - steps[:, 1] * up[:, 1],
                steps[:, 0] * up[:, 1] + steps[:, 1] * up[:, 0],
                steps[:, 2],
            ],
            axis=-1,
        )
        moves[actions >= hover] = 0.0
        samples = np.minimum(np.where(actions >= hover, self.hover_samples, self.samples), max_samples)
        boxes = np.empty((len(actions), 5))
        boxes[:, :3] = np.clip(2.0 * np.clip(positions + moves, 0.0, area) / area - 1.0, -1.0, 1.0)
        boxes[:, 3] = 2.0 * (samples - 1) / max(max_samples - 1, 1) - 1.0
        boxes[:, 4] = np.where((actions > hover) & (readings >= self.declare_reading), 1.0, -1.0)
        return boxes


def upwind(winds: Any) -> Any:
    """Unit vectors (n, 2) against the horizontal `winds` (n, 2), m/s; (0, 1) where there is none."""
    speed = np.hypot(winds[:, 0], winds[:, 1])
    calm = speed < _CALM
    vectors = -winds / np.where(calm, 1.0, speed)[:, None]
    vectors[calm] = (0.0, 1.0)
    return vectors


class WindFrame:
    """Turns the rows of a composition of features into the wind's frame. Needs the feature `raw`."""

    def __init__(self, spec: FeatureSpec) -> None:
        """Raises InputError if `raw`, which holds the wind, is not among the features."""
        names = spec_names(spec)
        if "raw.wind.x" not in names:
            raise InputError("features: a course agent needs {kind: raw}")
        if any(feature.kind == "belief" for feature in spec):
            raise InputError("features: a course agent takes no {kind: belief}, whose map does not turn")
        self._wind, self._position, self._area = (names.index(f"raw.{name}.x") for name in ("wind", "position", "area"))
        kept = (self._wind, self._position, self._area)
        self._x = np.array([k for k, name in enumerate(names) if name.endswith(".x") and k not in kept])

    def turned(self, rows: Float32Array) -> Float32Array:
        """`rows` (n, size) in the wind's frame, as new float32 rows; each depends on itself alone."""
        out = rows.copy()
        winds = _unscaled(rows[:, self._wind : self._wind + 2], WIND_SCALE)
        up = upwind(winds)
        c, s = up[:, :1], up[:, 1:]
        x, y = rows[:, self._x], rows[:, self._x + 1]
        out[:, self._x] = x * c + y * s
        out[:, self._x + 1] = y * c - x * s
        half = _unscaled(rows[:, self._area : self._area + 2], AREA_SCALE) / 2.0
        diagonal = np.maximum(np.hypot(half[:, 0], half[:, 1]), np.float32(1e-6))[:, None]
        offset = rows[:, self._position : self._position + 2] * half / diagonal
        half /= diagonal
        at = self._position
        out[:, at] = (offset * up).sum(axis=1)
        out[:, at + 1] = offset[:, 1] * up[:, 0] - offset[:, 0] * up[:, 1]
        at = self._area
        out[:, at] = (half * np.abs(up)).sum(axis=1)
        out[:, at + 1] = half[:, 1] * np.abs(up[:, 0]) + half[:, 0] * np.abs(up[:, 1])
        return np.clip(out, -1.0, 1.0)


def _unscaled(y: Any, scale: float) -> Any:
    """x of y = x / (|x| + scale)."""
    return np.float32(scale) * y / np.maximum(1.0 - np.abs(y), np.float32(1e-6))
