"""A meandering wind: the same everywhere, its speed and its angle two independent Ornstein-Uhlenbeck processes.

    ds = -(s - V) / T_s dt + sigma_s sqrt(2 / T_s) dW,    dphi = -phi / T_phi dt + sigma_phi sqrt(2 / T_phi) dW'
    u = s (cos(phi0 + phi), sin(phi0 + phi))

with V and phi0 the speed and direction of the mean velocity, sigma the stationary standard deviations and T the
correlation times (autocorrelation exp(-lag / T)); the vertical wind, if any, is a third such process about 0. A
horizontal wind that turns slowly as a whole is what moves a plume's centre line in Gifford's meandering plume
(Adv. Geophys. 6, 1959). The processes begin stationary and are advanced by their exact solution (Gillespie 1996, Phys.
Rev. E 54, eq 1.9), so that the tick changes neither the distribution nor the autocorrelation:

    x(t + dt) = a x(t) + sigma sqrt(1 - a^2) N(0, 1),    a = exp(-dt / T)

A speed is never negative: where s falls below 0, the lull has gone on into air that flows the other way, with speed
|s|. So the velocity has no jump and simple moments: E[u] = V exp(-sigma_phi^2 / 2), a little less than V, and
E[|u|^2] = V^2 + sigma_s^2. Without a mean wind the axis phi0 is drawn uniformly for each episode, and E[u] = 0.
Assumptions: no shear, no dependence on the place; for that, see `turbulence`.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from osl_env.air import uniform_air
from osl_env.arena import Arena
from osl_env.numerics import normal
from osl_env.parameters import FloatArray, quantity
from osl_env.state import BoolArray, IntArray
from osl_env.streams import Purpose, derive
from osl_env.winds.base import WindState
from osl_env.winds.mean_wind import FLUCTUATION, MeanWind, random_directions

_WIND = int(Purpose.WIND)
_PROCESSES = 3  # speed, angle, vertical: deviations in units of their standard deviations
_AXIS = _PROCESSES  # the first of two columns: cosine and sine of phi0


@njit(inline="always", error_model="numpy")
def _set_velocity(memory: FloatArray, speed: float, deviations: FloatArray, mean: FloatArray, e: int) -> None:
    """The velocity of world `e`, m/s, from its processes."""
    s = speed + deviations[0] * memory[e, 0]
    phi = deviations[1] * memory[e, 1]
    cosine, sine = math.cos(phi), math.sin(phi)
    mean[e, 0] = s * (memory[e, _AXIS] * cosine - memory[e, _AXIS + 1] * sine)
    mean[e, 1] = s * (memory[e, _AXIS + 1] * cosine + memory[e, _AXIS] * sine)
    mean[e, 2] = deviations[2] * memory[e, 2]


@njit(cache=True, error_model="numpy")
def _begin(
    rows: IntArray,
    seeds: IntArray,
    axes: FloatArray,
    speed: float,
    deviations: FloatArray,
    memory: FloatArray,
    streams: NDArray[np.uint64],
    mean: FloatArray,
) -> None:
    for k in range(rows.size):
        e = rows[k]
        stream = derive(seeds[k], _WIND, FLUCTUATION)
        for process in range(_PROCESSES):
            stream, memory[e, process] = normal(stream)
        streams[e] = stream
        memory[e, _AXIS], memory[e, _AXIS + 1] = axes[k, 0], axes[k, 1]
        _set_velocity(memory, speed, deviations, mean, e)


@njit(cache=True, error_model="numpy")
def _advance(
    due: BoolArray,
    tick: float,
    times: FloatArray,
    speed: float,
    deviations: FloatArray,
    memory: FloatArray,
    streams: NDArray[np.uint64],
    mean: FloatArray,
) -> None:
    kept, added = np.empty(_PROCESSES), np.empty(_PROCESSES)
    for process in range(_PROCESSES):
        kept[process] = math.exp(-tick / times[process])
        added[process] = math.sqrt(-math.expm1(-2.0 * tick / times[process]))
    for e in range(due.size):
        if not due[e]:
            continue
        stream = streams[e]
        for process in range(_PROCESSES):  # all three, also where one is 0: no parameter shifts another's draws
            stream, draw = normal(stream)
            memory[e, process] = kept[process] * memory[e, process] + added[process] * draw
        streams[e] = stream
        _set_velocity(memory, speed, deviations, mean, e)


class MeanderingWind(MeanWind):
    """A wind that is uniform in space and whose speed and angle wander about a mean. Zero mean wind is allowed."""

    kind: Literal["meander"] = "meander"
    speed_std: float = quantity(0.2, "m/s", ge=0)  # sigma_s
    speed_time: float = quantity(20.0, "s", gt=0)  # T_s
    angle_std: float = quantity(0.3, "rad", ge=0)  # sigma_phi
    angle_time: float = quantity(60.0, "s", gt=0)  # T_phi
    vertical_std: float = quantity(0.0, "m/s", ge=0)
    vertical_time: float = quantity(5.0, "s", gt=0)
    step: float = quantity(0.1, "s", gt=0)  # between two changes, where the plume does not set it

    @property
    def changes(self) -> bool:
        """Whether anything wanders."""
        return bool(self._deviations.max() > 0)

    @property
    def _deviations(self) -> FloatArray:
        return np.array([self.speed_std, self.angle_std, self.vertical_std])

    def allocate(self, n_envs: int, arena: Arena) -> WindState:
        """Still air, three processes and the axis of each world."""
        return WindState(uniform_air(n_envs), np.zeros((n_envs, _AXIS + 2)), np.zeros(n_envs, np.uint64))

    def begin(self, state: WindState, rows: IntArray, seeds: IntArray, start: float) -> None:
        """Draw the processes of the worlds `rows` from their stationary distribution, whatever `start`."""
        axes = self.draw(seeds)
        if self.speed > 0:
            axes /= self.speed
        else:
            random_directions(seeds, 1.0, axes)
        _begin(rows, seeds, axes, self.speed, self._deviations, state.memory, state.streams, state.air.mean)

    def advance(self, state: WindState, due: BoolArray, clock: FloatArray, tick: float) -> None:
        """Move the processes of the worlds of `due` (n_envs,) on by `tick` s."""
        times = np.array([self.speed_time, self.angle_time, self.vertical_time])
        _advance(due, tick, times, self.speed, self._deviations, state.memory, state.streams, state.air.mean)
