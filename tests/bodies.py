"""Flights of single quadrotors for the tests: a body and its controller, with nothing of a World around them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from osl_env.energy import ThrustEnergy
from osl_env.parameters import FloatArray
from osl_env.state import StateArray
from osl_env.vehicles.quadrotor import Quadrotor
from osl_env.vehicles.rigid_body import SCRATCH_SIZE, STATE_SIZE, fly_step, hover_at, integrate
from osl_env.vehicles.rotor_power import electrical_power

STILL = (0.0, 0.0, 0.0)  # m/s


@njit(error_model="numpy")
def _hovering(numbers: Any, state: Any, x: float, y: float, z: float) -> None:
    hover_at(numbers[0], state, x, y, z)


@njit(error_model="numpy")
def _fly(numbers: Any, state: Any, targets: Any, tracks: Any, longest: float, wind: Any, states: Any) -> None:
    scratch = np.empty(SCRATCH_SIZE)
    for k in range(len(targets)):
        x, y, z = targets[k]
        if tracks:
            x, y, z = x - state[0], y - state[1], z - state[2]
            share = min(1.0, longest / max(np.sqrt(x * x + y * y + z * z), 1e-9))
            x, y, z = state[0] + share * x, state[1] + share * y, state[2] + share * z
        fly_step(numbers[0], state, x, y, z, tracks, wind[0], wind[1], wind[2], scratch)
        states[k] = state


@njit(error_model="numpy")
def _integrate(numbers: Any, state: Any, commands: Any, wind: Any, dt: float, n_steps: int) -> None:
    scratch = np.empty(SCRATCH_SIZE)
    for _ in range(n_steps):
        integrate(numbers[0], state, commands, wind[0], wind[1], wind[2], dt, scratch)


@njit(error_model="numpy")
def _powers(numbers: Any, rotors: Any, states: Any, wind: Any, powers: Any) -> None:
    for k in range(len(states)):
        powers[k] = electrical_power(numbers[0], rotors[0], states[k], wind[0], wind[1], wind[2])


def numbers_of(airframe: Any, physics_step: float = 0.01) -> StateArray:
    """AIRFRAME (1,) of an airframe given by name or as a mapping."""
    return Quadrotor(airframe=airframe, physics_step=physics_step).numbers()


def hovering(numbers: StateArray, place: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> FloatArray:
    """State (17,) of a body that hovers at `place`, m."""
    state = np.empty(STATE_SIZE)
    _hovering(numbers, state, *place)
    return state


def flight(
    numbers: StateArray,
    targets: Any,
    *,
    tracks: bool = True,
    seconds: float | None = None,
    state: FloatArray | None = None,
    longest: float = np.inf,
    wind: tuple[float, float, float] = STILL,
) -> FloatArray:
    """States (n, 17), one a control period, of a body that begins hovering at 0 (or at `state`).

    `targets` (n, 3) or, with `seconds`, (3,): places, m, cut to `longest`, or velocities, m/s, unless it `tracks`.
    """
    goals = np.atleast_2d(np.asarray(targets, np.float64))
    if seconds is not None:
        goals = np.repeat(goals, round(seconds / float(numbers["control_period"][0])), axis=0)
    states = np.empty((len(goals), STATE_SIZE))
    begin = hovering(numbers) if state is None else state.copy()
    _fly(numbers, begin, goals, tracks, longest, np.array(wind), states)
    return states


def coasted(
    numbers: StateArray,
    state: FloatArray,
    commands: Any,
    seconds: float,
    dt: float,
    wind: tuple[float, float, float] = STILL,
) -> FloatArray:
    """State (17,) after `seconds` with constant rotor `commands` (4,), rad/s, integrated in steps of `dt` s."""
    end = state.copy()
    _integrate(numbers, end, np.asarray(commands, np.float64), np.array(wind), dt, round(seconds / dt))
    return end


def powers(
    numbers: StateArray, energy: ThrustEnergy, states: FloatArray, wind: tuple[float, float, float] = STILL
) -> FloatArray:
    """Electrical power, W, (n,) in `states` (n, 17)."""
    out = np.empty(len(states))
    _powers(numbers, energy.numbers(), states, np.array(wind), out)
    return out
