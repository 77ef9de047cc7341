"""A wind that is given: velocities at times, linear in between, the same everywhere.

Before the first time and after the last their velocities hold, unless the series loops: then it repeats with the
period times[-1] - times[0], and its ends must agree, since a measured series rarely closes on itself and a jump
would tear the plume.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Literal

import numpy as np
from numba import njit
from pydantic import model_validator

from osl_env.air import uniform_air
from osl_env.arena import Arena
from osl_env.parameters import FloatArray, Vector, quantity
from osl_env.state import BoolArray, IntArray
from osl_env.winds.base import Wind, WindState
from osl_env.winds.mean_wind import random_directions

_MAX_ENTRIES = 100_000


@njit(cache=True, error_model="numpy")
def _set_velocities(
    due: BoolArray,
    clock: FloatArray,
    times: FloatArray,
    velocities: FloatArray,
    loop: bool,
    turns: FloatArray,
    mean: FloatArray,
) -> None:
    """The series at `clock` (n_envs,), s, in the worlds of `due`, turned by `turns` (n_envs, 2): cosine, sine."""
    last = times.size - 1
    period = times[last] - times[0]
    for e in range(due.size):
        if not due[e]:
            continue
        t = clock[e]
        if loop:
            t = times[0] + (t - times[0]) - math.floor((t - times[0]) / period) * period
        t = min(max(t, times[0]), times[last])
        k = min(max(np.searchsorted(times, t, side="right") - 1, 0), max(last - 1, 0))
        weight = (t - times[k]) / (times[k + 1] - times[k]) if last > 0 else 0.0
        after = min(k + 1, last)
        u = velocities[k, 0] + weight * (velocities[after, 0] - velocities[k, 0])
        v = velocities[k, 1] + weight * (velocities[after, 1] - velocities[k, 1])
        mean[e, 0] = turns[e, 0] * u - turns[e, 1] * v
        mean[e, 1] = turns[e, 1] * u + turns[e, 0] * v
        mean[e, 2] = velocities[k, 2] + weight * (velocities[after, 2] - velocities[k, 2])


class SeriesWind(Wind):
    """A given wind: `velocities` at `times`, with linear interpolation, uniform in space."""

    kind: Literal["series"] = "series"
    times: tuple[float, ...] = quantity((0.0, 300.0, 600.0), "s", min_length=1, max_length=_MAX_ENTRIES)  # increasing
    velocities: tuple[Vector, ...] = quantity(((0.3, -1.0, 0.0), (-0.3, -1.0, 0.0), (0.3, -1.0, 0.0)), "m/s")
    loop: bool = False  # repeat; the last velocity must then be the first
    random_direction: bool = False  # turn the whole series about z by an angle drawn for each episode
    step: float = quantity(0.1, "s", gt=0)  # between two changes, where the plume does not set it

    @model_validator(mode="after")
    def _a_series(self) -> SeriesWind:
        times, velocities = self.times, self.velocities
        if len(velocities) != len(times):
            raise ValueError(f"velocities = {len(velocities)} entries: must be one for each of {len(times)} times")
        for k in range(1, len(times)):
            if times[k] <= times[k - 1]:
                raise ValueError(f"times[{k}] = {times[k]:g}: must be above times[{k - 1}] = {times[k - 1]:g}")
        if self.loop and (len(times) < 2 or velocities[0] != velocities[-1]):
            raise ValueError(
                f"velocities[{len(times) - 1}] = {list(velocities[-1])}: to loop, the series must have two entries"
                f" or more and end with its first velocity {list(velocities[0])}"
            )
        return self

    @property
    def changes(self) -> bool:
        """Whether the velocities differ."""
        return len(set(self.velocities)) > 1

    @cached_property
    def _series(self) -> tuple[FloatArray, FloatArray]:
        return np.array(self.times), np.array(self.velocities).reshape(-1, 3)

    def draw(self, seeds: IntArray) -> FloatArray:
        """Mean of the series over its times (n, 3), m/s, in the episodes with `seeds` (n,)."""
        times, velocities = self._series
        steps = np.diff(times)[:, None]
        middle = (velocities[1:] + velocities[:-1]) / 2
        mean = velocities[0] if len(times) == 1 else (middle * steps).sum(axis=0) / steps.sum()
        cosine, sine = self._turns(seeds).T
        across = np.stack([cosine * mean[0] - sine * mean[1], sine * mean[0] + cosine * mean[1]])
        return np.column_stack([*across, np.full(len(seeds), mean[2])])

    def _turns(self, seeds: IntArray) -> FloatArray:
        """Cosine and sine (n, 2) of the angles by which the series is turned."""
        turns = np.tile([1.0, 0.0, 0.0], (len(seeds), 1))
        if self.random_direction:
            random_directions(seeds, 1.0, turns)
        return turns[:, :2]

    def allocate(self, n_envs: int, arena: Arena) -> WindState:
        """Still air, and the turn of each world."""
        return WindState(uniform_air(n_envs), np.zeros((n_envs, 2)), np.zeros(n_envs, np.uint64))

    def begin(self, state: WindState, rows: IntArray, seeds: IntArray, start: float) -> None:
        """Set the air of the worlds `rows` to the series at the clock time `start`, s."""
        state.memory[rows] = self._turns(seeds)
        begun = np.zeros(len(state.memory), np.bool_)
        begun[rows] = True
        self.advance(state, begun, np.full(len(state.memory), start), 0.0)

    def advance(self, state: WindState, due: BoolArray, clock: FloatArray, tick: float) -> None:
        """Set the air of the worlds of `due` (n_envs,) to the series at their `clock` (n_envs,), s."""
        _set_velocities(due, clock, *self._series, self.loop, state.memory, state.air.mean)
