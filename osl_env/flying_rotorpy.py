"""Periods flown by RotorPy's own vehicle and controller: the reference that the native bodies are held against.

One body after the other, in Python: for single flights. Everything around the body (bounds, obstacles, energy, ledger)
is that of the native kernels.
"""

from __future__ import annotations

from numba import njit

from osl_env.flying_bodies import begin_period, body_power, book_step, end_period, settle_body
from osl_env.geometry import Geometry
from osl_env.parameters import FloatArray
from osl_env.state import RUNNING, BoolArray, StateArray
from osl_env.vehicles.quadrotor import Quadrotor


@njit(cache=True, error_model="numpy")
def _begin(motion: StateArray, e: int, i: int) -> None:
    begin_period(motion[e, i])


@njit(cache=True, error_model="numpy")
def _end(motion: StateArray, ledger: StateArray, constants: StateArray, e: int, i: int) -> None:
    end_period(motion[e, i], ledger[e, i], constants[0])


@njit(cache=True, error_model="numpy")
def _after_step(
    motion: StateArray,
    ledger: StateArray,
    constants: StateArray,
    geometry: Geometry | None,
    frames: StateArray,
    rotors: StateArray | None,
    state: FloatArray,
    wind: FloatArray,
    begin: FloatArray,
    e: int,
    i: int,
) -> bool:
    """What follows one control step of one body from `begin` (3,), m; whether it flies on."""
    m, c, frame = motion[e, i], constants[0], frames[0]
    path = settle_body(m, c, geometry, frame, state, begin[0], begin[1], begin[2], c.bounds_end)
    power = body_power(c, frame, rotors, state, wind[0], wind[1], wind[2])
    return bool(book_step(m, ledger[e, i], c, frame, state, power, path))


class RotorpyFleet:
    """The bodies of a World's UAVs, flown by RotorPy. Raises InputError if it is not installed."""

    def __init__(self, vehicle: Quadrotor) -> None:
        """For UAVs of kind `vehicle`."""
        from osl_env.vehicles.rotorpy_backend import RotorpyBody

        self._vehicle, self._body = vehicle, RotorpyBody(vehicle)
        self._steps = round(vehicle.decision_period / vehicle.control_period)

    def fly_periods(
        self,
        motion: StateArray,
        ledger: StateArray,
        episode: StateArray,
        constants: StateArray,
        geometry: Geometry | None,
        body: FloatArray,
        frames: StateArray,
        rotors: StateArray | None,
        winds: FloatArray,
        stepping: BoolArray,
        targets: FloatArray,
        tracks: bool,
    ) -> None:
        """As `flying_bodies.fly_body_periods`."""
        stepping[:] = episode["outcome"] == RUNNING
        longest = self._vehicle.lookahead if tracks else self._vehicle.speed
        for e in stepping.nonzero()[0].tolist():
            for i in range(motion.shape[1]):
                if not motion["active"][e, i]:
                    continue
                state, wind = body[e, i], winds[e, i if winds.shape[1] > 1 else 0] * self._vehicle.feels_wind
                _begin(motion, e, i)
                for _ in range(self._steps):
                    begin = state[:3].copy()
                    self._body.steer(state, targets[e, i], tracks, longest, wind)
                    if not _after_step(motion, ledger, constants, geometry, frames, rotors, state, wind, begin, e, i):
                        break
                _end(motion, ledger, constants, e, i)
            episode["clock"][e] += self._vehicle.decision_period
