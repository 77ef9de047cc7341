"""Workloads of the quadrotor: a control period (10 ms: controller and physics) of a batch of bodies, and in RotorPy."""

from __future__ import annotations

import importlib.util
from typing import Any

import numpy as np
from numba import njit
from workloads import Call, Workload

from osl_env.energy import ThrustEnergy
from osl_env.parameters import FloatArray
from osl_env.vehicles.quadrotor import Quadrotor
from osl_env.vehicles.rigid_body import SCRATCH_SIZE, STATE_SIZE, fly_step, hover_at
from osl_env.vehicles.rotor_power import electrical_power

BODIES = 1024


@njit(error_model="numpy")
def _begin(numbers: Any, bodies: Any, places: Any) -> None:
    for k in range(len(bodies)):
        hover_at(numbers[0], bodies[k], places[k, 0], places[k, 1], places[k, 2])


@njit(error_model="numpy")
def _fly(numbers: Any, bodies: Any, goals: Any, tracks: bool) -> None:
    scratch = np.empty(SCRATCH_SIZE)
    for k in range(len(bodies)):
        fly_step(numbers[0], bodies[k], goals[k, 0], goals[k, 1], goals[k, 2], tracks, 0.5, -0.3, 0.1, scratch)


@njit(error_model="numpy")
def _draw(numbers: Any, rotors: Any, bodies: Any, powers: Any) -> None:
    for k in range(len(bodies)):
        powers[k] = electrical_power(numbers[0], rotors[0], bodies[k], 0.5, -0.3, 0.1)


def _scattered(vehicle: Quadrotor) -> tuple[Any, FloatArray, FloatArray]:
    """The vehicle's numbers, `BODIES` hovering bodies, and a place for each to fly to, some metres away."""
    places = np.random.default_rng(0).uniform(0.0, 2.0, (2, BODIES, 3))
    numbers, bodies = vehicle.numbers(), np.empty((BODIES, STATE_SIZE))
    _begin(numbers, bodies, places[0])
    return numbers, bodies, places[1]


def control_period(airframe: str, target: float | None = None, *, tracks: bool = True) -> Workload:
    def prepare() -> Call:
        numbers, bodies, goals = _scattered(Quadrotor(airframe=airframe))
        return lambda: _fly(numbers, bodies, goals, tracks)

    return Workload(prepare, "s", BODIES, target)


def thrust_power() -> Call:
    numbers, bodies, _ = _scattered(Quadrotor(airframe="matrice-100"))
    rotors, powers = ThrustEnergy().numbers(), np.empty(BODIES)
    return lambda: _draw(numbers, rotors, bodies, powers)


def in_rotorpy() -> Call:
    from osl_env.vehicles.rotorpy_backend import RotorpyBody

    vehicle = Quadrotor()
    _, bodies, goals = _scattered(vehicle)
    body, wind = RotorpyBody(vehicle), np.array([0.5, -0.3, 0.1])
    return lambda: body.fly_step(bodies[0], goals[0], True, wind)


WORKLOADS_QUADROTOR = {
    "quadrotor, 10 ms of crazyflies": control_period("crazyflie", 1e-6),
    "quadrotor, 10 ms of crazyflies at a velocity": control_period("crazyflie", 1e-6, tracks=False),
    "quadrotor, 10 ms of matrice-100s": control_period("matrice-100", 1e-6),
    "quadrotor, power from thrust": Workload(thrust_power, "s", BODIES),
}
if importlib.util.find_spec("rotorpy") is not None:
    WORKLOADS_QUADROTOR["quadrotor, 10 ms of a crazyflie in RotorPy"] = Workload(in_rotorpy, "s")
