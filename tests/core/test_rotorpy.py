"""The native quadrotor against RotorPy 3.0.0's `Multirotor` under its `SE3Control`, over the same flights.

RotorPy integrates with scipy's RK45 at rtol 1e-3 and atol 1e-6; with tight tolerances instead, its flight is exact to
1e-10 and tells our error from its own. Way points change at given times: changing them by distance would turn an error
of 1e-9 m into one of a control period's flight. A period of RotorPy takes 1.5 ms: 20 s of flight some 3 s.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest
from bodies import flight, hovering
from worlds import small

from osl_env import InputError, World
from osl_env.parameters import FloatArray
from osl_env.vehicles.airframe import AIRFRAMES
from osl_env.vehicles.quadrotor import Quadrotor
from osl_env.vehicles.rotorpy_backend import RotorpyBody, rotorpy_parameters

WAY_POINTS = ((12.0, 0.0, 5.0), (12.0, 4.0, 5.3), (0.0, 4.0, 4.9), (0.0, 0.0, 5.5), (6.0, -6.0, 5.0))
LEG = 4.2  # s for each way point: 21 s in all
LOOKAHEAD = 2.5  # m, to which the way to a way point is cut
WIND = (0.5, -0.3, 0.1)  # m/s
TIGHT = {"rtol": 1e-10, "atol": 1e-12}


@pytest.fixture(autouse=True)
def _installed() -> None:
    rotorpy = pytest.importorskip("rotorpy", reason="RotorPy is not installed: pip install 'osl-env[quadrotor]'")
    assert rotorpy is not None


def goals(seconds: float = LEG * len(WAY_POINTS)) -> FloatArray:
    """The place to fly to in every control period, (n, 3) m."""
    return np.repeat(WAY_POINTS, round(LEG / 0.01), axis=0)[: round(seconds / 0.01)]


def reference(vehicle: Quadrotor, targets: FloatArray, *, tracks: bool = True, **integrator: Any) -> FloatArray:
    """States (n, 17) of RotorPy's flight over `targets` (n, 3)."""
    body, state = RotorpyBody(vehicle, **integrator), hovering(vehicle.numbers(), (0.0, 0.0, 5.0))
    states = np.empty((len(targets), 17))
    for k, target in enumerate(targets):
        body.steer(state, target, tracks, LOOKAHEAD if tracks else np.inf, np.array(WIND))
        states[k] = state
    return states


def native(vehicle: Quadrotor, targets: FloatArray, *, tracks: bool = True) -> FloatArray:
    begin = hovering(vehicle.numbers(), (0.0, 0.0, 5.0))
    return flight(vehicle.numbers(), targets, tracks=tracks, state=begin, longest=LOOKAHEAD, wind=WIND)


def farthest(states: FloatArray, others: FloatArray) -> float:
    """m, the greatest distance between two flights at the same time."""
    return float(np.linalg.norm(states[:, :3] - others[:, :3], axis=1).max())


@pytest.mark.parametrize("name", ["crazyflie", "hummingbird"])
def test_our_parameters_are_rotorpys(name: str) -> None:
    import importlib

    theirs = importlib.import_module(f"rotorpy.vehicles.{name}_params").quad_params
    ours = rotorpy_parameters(AIRFRAMES[name])
    for key, value in ours.items():
        if key == "rotor_pos":
            for rotor, place in value.items():
                np.testing.assert_allclose(place, theirs[key][rotor], atol=1e-12)
        else:
            np.testing.assert_array_equal(value, theirs[key], err_msg=key)


@functools.cache
def flown(name: str, seconds: float, exact: bool) -> FloatArray:
    """RotorPy's flight by the way points, for all the tests that compare with it."""
    return reference(Quadrotor(airframe=name), goals(seconds), **(TIGHT if exact else {}))


@pytest.mark.parametrize(("step", "distance"), [(0.01, 2e-6), (0.005, 1e-6), (0.001, 1e-6)])
def test_crazyflie_flies_as_in_rotorpy_to_a_micrometre(step: float, distance: float) -> None:
    """Way points change at full speed; a steadier flight is within 1e-6 m at the default step of 10 ms, too."""
    theirs = flown("crazyflie", 21.0, False)
    ours = native(Quadrotor(airframe="crazyflie", physics_step=step), goals())
    assert len(ours) == len(theirs) > 2000  # 20 s
    assert np.linalg.norm(theirs[:, 3:6], axis=1).max() > 3.5  # it did fly
    assert farthest(theirs, ours) < distance
    np.testing.assert_allclose(ours[:, 3:6], theirs[:, 3:6], atol=5e-6)
    np.testing.assert_allclose(ours[:, 6:10], theirs[:, 6:10], atol=1e-5)


@pytest.mark.slow
def test_hummingbird_flies_as_in_rotorpy() -> None:
    """RotorPy's own tolerances leave it about 1 mm off the exact flight, for its motors (5 ms) are fast."""
    ours = native(Quadrotor(airframe="hummingbird", physics_step=0.001), goals())
    assert farthest(flown("hummingbird", 21.0, False), ours) < 3e-3


@pytest.mark.parametrize(
    ("name", "step", "ours_off"),
    [("crazyflie", 0.01, 1e-6), ("crazyflie", 0.001, 1e-9), ("hummingbird", 0.01, 2e-3), ("hummingbird", 0.001, 1e-6)],
)
def test_errors_of_both_against_the_exact_flight(name: str, step: float, ours_off: float) -> None:
    exact = flown(name, 1.2, True)
    theirs_off = {"crazyflie": 1e-6, "hummingbird": 1e-3}[name]
    assert farthest(native(Quadrotor(airframe=name, physics_step=step), goals(1.2)), exact) < ours_off
    assert farthest(flown(name, 1.2, False), exact) < theirs_off


@pytest.mark.parametrize("name", ["crazyflie", "hummingbird"])
def test_velocities_are_tracked_as_by_rotorpys_controller(name: str) -> None:
    vehicle = Quadrotor(airframe=name, physics_step=0.001)
    commands = np.repeat([(2.0, 0.0, 0.0), (0.0, -1.0, 0.5), (-1.0, 1.0, -0.5)], 30, axis=0)
    theirs, ours = reference(vehicle, commands, tracks=False, **TIGHT), native(vehicle, commands, tracks=False)
    assert farthest(theirs, ours) < 1e-6


def test_an_airframe_of_ones_own_flies_in_rotorpy() -> None:
    free = {"base": "matrice-100", "tilt_limit": 3.14159}
    vehicle = Quadrotor(airframe=free, physics_step=0.001)
    assert farthest(reference(vehicle, goals(0.6), **TIGHT), native(vehicle, goals(0.6))) < 1e-6
    with pytest.raises(InputError, match="tilt_limit"):
        RotorpyBody(Quadrotor(airframe="matrice-100"))


def test_a_world_flown_by_rotorpy_is_the_native_one() -> None:
    """The whole path through World: periods, energy and ledger around either backend."""
    ends = []
    for backend in ("native", "rotorpy"):
        vehicle = {"kind": "quadrotor", "speed": 3.0, "backend": backend}
        world = World(small(vehicle=vehicle, action="setpoint", **{"team.n_uavs": 1, "energy": {"kind": "thrust"}}), 1)
        world.reset([1])
        for k in range(20):
            world.step_setpoints(np.array([[[8.0, 6.0, 4.0 + 0.05 * k]]]))
        ends.append((world.motion["position"].copy(), world.ledger["spent"].copy()))
    np.testing.assert_allclose(ends[1][0], ends[0][0], atol=1e-6)
    np.testing.assert_allclose(ends[1][1], ends[0][1], rtol=1e-6)


def test_a_body_out_of_control_is_left_not_finite_rather_than_raising() -> None:
    body, state = RotorpyBody(Quadrotor()), hovering(Quadrotor().numbers())
    state[3] = np.nan
    with np.errstate(all="ignore"):
        body.fly_step(state, np.zeros(3), True, np.zeros(3))
    assert not np.all(np.isfinite(state))
