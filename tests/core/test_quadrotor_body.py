"""Laws of the quadrotor's body and its controller: rest, free fall, convergence, symmetries, wind, damping."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from bodies import coasted, flight, hovering, numbers_of
from worlds import small

from osl_env import InputError
from osl_env.parameters import FloatArray
from osl_env.vehicles.airframe import AIRFRAMES, GRAVITY
from osl_env.vehicles.quadrotor import Quadrotor
from osl_env.vehicles.rigid_body import has_diverged

ALL = sorted(AIRFRAMES)
POSITION, VELOCITY, ATTITUDE, RATES, ROTORS = (slice(*ends) for ends in ((0, 3), (3, 6), (6, 10), (10, 13), (13, 17)))


def tumbling(name: str) -> FloatArray:
    """A body in the middle of a manoeuvre: tilted, turning, moving, its rotors at four speeds near hovering."""
    state = hovering(numbers_of(name), (1.0, 2.0, 3.0))
    state[VELOCITY] = (1.5, -0.7, 0.4)
    state[ATTITUDE] = np.array([0.2, -0.15, 0.3, 0.9]) / np.linalg.norm([0.2, -0.15, 0.3, 0.9])
    state[RATES] = (1.0, -2.0, 0.5)
    state[ROTORS] *= (1.1, 0.9, 1.05, 0.95)
    return state


def commands_of(name: str) -> FloatArray:
    return AIRFRAMES[name].hover_speed * np.array([0.9, 1.1, 0.95, 1.05])


def rotation(quaternion: FloatArray) -> FloatArray:
    """Rotation matrix (3, 3), body to world, of a unit quaternion x, y, z, w."""
    x, y, z, w = quaternion
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def turned(state: FloatArray, angle: float) -> FloatArray:
    """The state seen in a world that is turned about z by `angle`, rad."""
    c, s = math.cos(angle), math.sin(angle)
    about_z = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    h, g = math.cos(angle / 2), math.sin(angle / 2)
    x, y, z, w = state[ATTITUDE]
    result = state.copy()
    result[POSITION], result[VELOCITY] = about_z @ state[POSITION], about_z @ state[VELOCITY]
    result[ATTITUDE] = (h * x - g * y, h * y + g * x, h * z + g * w, h * w - g * z)
    return result


@pytest.mark.parametrize("name", ALL)
def test_hovering_stays_put_without_wind(name: str) -> None:
    numbers = numbers_of(name)
    begin = hovering(numbers, (1.0, 2.0, 3.0))
    states = flight(numbers, begin[POSITION], seconds=20.0, state=begin)
    np.testing.assert_allclose(states, np.broadcast_to(begin, states.shape), atol=1e-9)  # rounding, 1e-13 of 2000 rad/s


def test_free_fall_is_a_parabola_and_keeps_energy_and_angular_momentum() -> None:
    numbers, airframe = numbers_of("crazyflie"), AIRFRAMES["crazyflie"]  # its drag is all of the rotors
    begin = tumbling("crazyflie")
    begin[ROTORS] = 0.0
    end = coasted(numbers, begin, np.zeros(4), 1.0, 0.001)
    fallen = begin[POSITION] + begin[VELOCITY] - [0, 0, GRAVITY / 2]
    np.testing.assert_allclose(end[POSITION], fallen, atol=1e-10)  # a polynomial of degree 2: exact but for rounding
    inertia = np.array(airframe.inertia)

    def kept(state: FloatArray) -> FloatArray:
        momentum = rotation(state[ATTITUDE]) @ (inertia * state[RATES])
        spin = float(inertia @ state[RATES] ** 2) / 2
        speed = float(state[VELOCITY] @ state[VELOCITY]) / 2 + GRAVITY * state[2]
        return np.array([*momentum, spin, airframe.mass * speed])

    np.testing.assert_allclose(kept(end), kept(begin), rtol=1e-9)  # h^4 |omega|^5 / 120 a second: 5e-13


@pytest.mark.parametrize("name", ALL)
def test_drag_only_takes_energy(name: str) -> None:
    changed = {"base": name, "k_h": 0.0}  # translational lift is thrust without a rotor's work: not of this law
    numbers, airframe = numbers_of(changed), AIRFRAMES[name]
    state = tumbling(name)
    state[VELOCITY] *= 5
    state[ROTORS] = 0.0
    last = np.inf
    for _ in range(50):
        speed = float(state[VELOCITY] @ state[VELOCITY]) / 2 + GRAVITY * state[2]
        energy = airframe.mass * speed + float(np.array(airframe.inertia) @ state[RATES] ** 2) / 2
        assert energy <= last * (1 + 1e-9)
        last, state = energy, coasted(numbers, state, np.zeros(4), 0.02, 0.01)


@pytest.mark.parametrize("name", ALL)
def test_halving_the_step_divides_the_error_by_sixteen(name: str) -> None:
    numbers, begin, commands = numbers_of(name), tumbling(name), commands_of(name)
    fastest = AIRFRAMES[name].motor_time_constant
    steps = [min(0.02, fastest / 2) / 2**k for k in range(4)]
    exact = coasted(numbers, begin, commands, 16 * steps[0], steps[0] / 256)
    errors = [np.abs(coasted(numbers, begin, commands, 16 * steps[0], dt) - exact)[:13].max() for dt in steps]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 4.0, atol=0.35)  # fourth order; the next term fades with the step
    assert errors[-1] > 1e-13  # else the orders were those of rounding


@pytest.mark.parametrize("name", ALL)
def test_rotors_follow_their_commands_exactly_and_within_their_limits(name: str) -> None:
    numbers, begin, airframe = numbers_of(name), tumbling(name), AIRFRAMES[name]
    decay = math.exp(-0.1 / airframe.motor_time_constant)
    expected = commands_of(name) + decay * (begin[ROTORS] - commands_of(name))
    for dt in (0.01, 0.02):
        end = coasted(numbers, begin, commands_of(name), 0.1, dt)
        np.testing.assert_allclose(end[ROTORS], expected, rtol=1e-12)
    end = coasted(numbers, begin, [-1e9, 1e9, -1.0, 1e9], 1.0, 0.01)
    assert np.all(end[ROTORS] >= airframe.rotor_speed_min)
    assert np.all(end[ROTORS] <= airframe.rotor_speed_max)


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("degrees", [90, 180, 270, 33])
def test_turning_the_world_about_z_turns_the_flight(name: str, degrees: int) -> None:
    numbers, begin, commands = numbers_of(name), tumbling(name), commands_of(name)
    angle, wind = math.radians(degrees), np.array([1.0, 2.0, -0.5])
    blown = (
        math.cos(angle) * wind[0] - math.sin(angle) * wind[1],
        math.sin(angle) * wind[0] + math.cos(angle) * wind[1],
        float(wind[2]),
    )
    end = coasted(numbers, begin, commands, 0.3, 0.01, wind=tuple(wind))
    other = coasted(numbers, turned(begin, angle), commands, 0.3, 0.01, wind=blown)
    expected = turned(end, angle)
    expected[ATTITUDE] *= np.sign(expected[ATTITUDE] @ other[ATTITUDE])
    np.testing.assert_allclose(other, expected, rtol=1e-11, atol=1e-11)  # rounding


@pytest.mark.parametrize("name", ["crazyflie", "matrice-100"])  # Jx = Jy; the hummingbird's differ by 1 %
def test_the_controller_flies_alike_in_the_four_directions(name: str) -> None:
    numbers = numbers_of(name)
    forward = flight(numbers, (1.0, 0.0, 0.3), seconds=3.0)
    for x, y in ((0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)):
        other = flight(numbers, (x, y, 0.3), seconds=3.0)
        along, across = x * other[:, 0] + y * other[:, 1], y * other[:, 0] - x * other[:, 1]
        np.testing.assert_allclose(along, forward[:, 0], atol=1e-9)
        np.testing.assert_allclose(other[:, 2], forward[:, 2], atol=1e-9)
        np.testing.assert_allclose(across, 0.0, atol=1e-9)


@pytest.mark.parametrize("name", ALL)
def test_a_body_in_wind_flies_as_one_in_still_air_that_moves(name: str) -> None:
    numbers, commands, wind = numbers_of(name), commands_of(name), (2.0, -1.0, 0.5)
    begin = tumbling(name)
    carried = begin.copy()
    carried[VELOCITY] += wind
    calm = coasted(numbers, begin, commands, 0.3, 0.01)
    blown = coasted(numbers, carried, commands, 0.3, 0.01, wind=wind)
    blown[POSITION] -= 0.3 * np.array(wind)
    blown[VELOCITY] -= wind
    np.testing.assert_allclose(blown, calm, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("name", ALL)
def test_wind_pushes_a_hovering_body_away_by_the_drag_over_the_gain(name: str) -> None:
    airframe, speed = AIRFRAMES[name], 1.0
    numbers = numbers_of({"base": name, "k_h": 0.0})
    end = flight(numbers, (0.0, 0.0, 0.0), seconds=15.0, wind=(speed, 0.0, 0.0))[-1]
    drag = 4 * airframe.k_d * airframe.hover_speed * speed + airframe.parasitic_drag[0] * speed**2
    offset = drag / (airframe.mass * airframe.position_gain[0])
    assert end[0] == pytest.approx(offset, rel=0.01)  # the tilt, 1 to 3 degrees, turns the axes of the drag
    np.testing.assert_allclose(end[VELOCITY], 0.0, atol=1e-6)


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_steps_are_well_damped(name: str, axis: int) -> None:
    numbers, goal = numbers_of(name), np.zeros(3)
    goal[axis] = 1.0
    states = flight(numbers, goal, seconds=8.0)
    assert states[:, axis].max() < 1.02
    np.testing.assert_allclose(states[-1, POSITION], goal, atol=1e-3)
    assert np.abs(np.delete(states[:, POSITION], axis, axis=1)).max() < 0.02
    # a carrot of 2.5 m on the way to a place 15 m off: steady flight, and a stop without running over
    far = flight(numbers, 15 * goal, seconds=25.0, longest=2.5)
    assert far[:, axis].max() < 15.05
    np.testing.assert_allclose(far[-1, POSITION], 15 * goal, atol=1e-3)
    assert not any(has_diverged(state) for state in far[::50])


@pytest.mark.parametrize(("name", "share"), [("crazyflie", 0.94), ("hummingbird", 0.90), ("matrice-100", 0.905)])
def test_velocities_are_held_but_for_the_drag(name: str, share: float) -> None:
    numbers = numbers_of(name)
    for velocity in ((3.0, 0.0, 0.0), (0.0, -3.0, 0.0), (2.0, 2.0, 0.5), (0.0, 0.0, -1.0)):
        end = flight(numbers, velocity, seconds=10.0, tracks=False)
        reached = end[-1, VELOCITY]
        np.testing.assert_allclose(end[-100:, VELOCITY], np.broadcast_to(reached, (100, 3)), atol=1e-3)  # steady
        aligned = reached @ velocity / np.linalg.norm(velocity) ** 2
        assert share - 0.03 < aligned < 1.0, velocity
        assert np.linalg.norm(np.cross(reached, velocity)) < 0.03 * np.linalg.norm(velocity) ** 2


def test_a_limit_of_tilt_holds_and_no_target_turns_the_vehicle_over() -> None:
    numbers, limit = numbers_of("matrice-100"), AIRFRAMES["matrice-100"].tilt_limit
    for target in ((500.0, 0.0, 0.0), (300.0, -300.0, -500.0), (0.0, 0.1, -1000.0)):
        states = flight(numbers, target, seconds=5.0)
        tilt = np.arccos(1 - 2 * (states[:, 6] ** 2 + states[:, 7] ** 2))
        assert tilt.max() < limit * 1.05, target  # the attitude may overshoot by a few per cent


def test_the_speed_of_a_vehicle_is_that_from_its_lookahead() -> None:
    vehicle = Quadrotor(airframe={"base": "crazyflie", "k_d": 0.0, "k_z": 0.0}, speed=3.0)
    assert vehicle.lookahead == pytest.approx(3.0 * 4.0 / 6.5)
    states = flight(vehicle.numbers(), (1000.0, 0.0, 0.0), seconds=10.0, longest=vehicle.lookahead)
    assert states[-1, 3] == pytest.approx(3.0, rel=1e-6)  # no drag: exactly


def test_divergence_is_noticed() -> None:
    calm = hovering(numbers_of("crazyflie"))
    assert not has_diverged(calm)
    for index, value in ((0, np.nan), (4, np.inf), (16, np.nan), (3, 101.0), (12, -101.0)):
        state = calm.copy()
        state[index] = value
        assert has_diverged(state), (index, value)


BAD: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "name": ({"airframe": "crazyfly"}, ("vehicle.airframe", "'crazyfly'", "hummingbird")),
    "number": ({"airframe": 3}, ("vehicle.airframe", "3", "hummingbird")),
    "base": ({"airframe": {"base": "big"}}, ("vehicle.airframe.base", "'big'", "hummingbird")),
    "unknown key": ({"airframe": {"base": "crazyflie", "masss": 1.0}}, ("vehicle.airframe.masss", "mass")),
    "too heavy": ({"airframe": {"base": "crazyflie", "mass": 5.0}}, ("vehicle.airframe.mass", "5.0", "2500 rad/s")),
    "negative": ({"airframe": {"base": "crazyflie", "k_eta": -1.0}}, ("vehicle.airframe.k_eta", "-1.0", "0")),
    "inertia": ({"airframe": {"base": "crazyflie", "inertia": [1, 0, 1]}}, ("vehicle.airframe.inertia", "above 0")),
    "drag": ({"airframe": {"base": "crazyflie", "parasitic_drag": [0, 0, -1]}}, ("parasitic_drag", "0 or above")),
    "gain": ({"airframe": {"base": "crazyflie", "position_gain": [1, 1, 0]}}, ("position_gain", "above 0")),
    "rotor limits": ({"airframe": {"base": "crazyflie", "rotor_speed_min": 3000}}, ("rotor_speed_min", "2500")),
    "nan": ({"airframe": {"base": "crazyflie", "mass": math.nan}}, ("vehicle.airframe.mass", "finite")),
    "incomplete": ({"airframe": {"mass": 1.0}}, ("vehicle.airframe.inertia", "missing")),
    "physics step": ({"physics_step": 0.003}, ("vehicle.physics_step", "0.003", "control_period = 0.01")),
    "control period": ({"control_period": 0.03}, ("vehicle.", "0.03", "whole steps")),
    "backend": ({"backend": "gazebo"}, ("vehicle.backend", "gazebo", "rotorpy")),
    "arrival": ({"arrival_radius": 0.0}, ("vehicle.arrival_radius", "0.0", "greater than 0")),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_parameters_are_refused_in_one_line(case: str) -> None:
    changes, words = BAD[case]
    with pytest.raises(InputError) as error:
        small(**{"vehicle": {"kind": "quadrotor", **changes}, "action": "velocity"})
    assert "\n" not in str(error.value)
    for word in words:
        assert word in str(error.value), str(error.value)


def test_airframes_are_named_changed_and_written_in_full() -> None:
    light = Quadrotor(airframe={"base": "hummingbird", "mass": "400 g"})
    assert light.airframe.mass == 0.4
    assert light.airframe.k_eta == AIRFRAMES["hummingbird"].k_eta
    assert (light.airframe.name, Quadrotor().airframe.name) == ("custom", "crazyflie")
    for vehicle in (light, Quadrotor(airframe="matrice-100")):
        written = vehicle.model_dump(mode="json")
        assert set(written["airframe"]) == set(type(vehicle.airframe).model_fields)
        assert Quadrotor.model_validate(written) == vehicle


def test_numbers_for_the_kernels_are_those_of_the_model() -> None:
    vehicle = Quadrotor(airframe="matrice-100", speed=2.0, control_period=0.01, physics_step=0.0025, feels_wind=False)
    record = vehicle.numbers()[0]
    assert record["physics_steps"] == 4
    assert (record["speed"], record["lookahead"], record["feels_wind"]) == (2.0, vehicle.lookahead, 0.0)
    assert record["tilt_tangent"] == pytest.approx(math.tan(vehicle.airframe.tilt_limit))
    for name in ("mass", "k_eta", "motor_time_constant", "rotor_speed_max", "attitude_gain", "solidity"):
        assert record[name] == getattr(vehicle.airframe, name)
    np.testing.assert_allclose(record["inverse_inertia"] * vehicle.airframe.inertia, 1.0)
