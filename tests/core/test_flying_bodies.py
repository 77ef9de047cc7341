"""Quadrotors in a World: periods and legs, bounds, obstacles, batteries, and flights that become unstable."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from osl_env import InputError, Scenario, World, load_scenario
from osl_env.record import EpisodeRecord
from osl_env.state import DIVERGED, FLYING, FLYING_ON, HOVERING, LEFT
from tests.worlds import advance, begun, differences, random_commands, small

BODY: dict[str, Any] = {"kind": "quadrotor", "speed": 3.0, "decision_period": 0.1}
UNSTABLE = {"base": "crazyflie", "inertia": [1e-8, 1e-8, 1.5e-8]}  # motors are too slow for it: it spins up
WALL = {"kind": "box", "low": [8.0, 0.0, 0.0], "high": [10.0, 20.0, 10.0]}


def flown(action: str = "setpoint", **changes: Any) -> Scenario:
    """One quadrotor at (4, 4, 4) m in `small` without wind."""
    vehicle = BODY | changes.pop("vehicle", {})
    settings = {"team.n_uavs": 1, "wind.velocity": (0.0, 0.0, 0.0), "vehicle": vehicle, "action": action}
    return small(**(settings | changes))


def steer(world: World, place: tuple[float, float, float], seconds: float) -> None:
    """All UAVs steer to (or fly with) `place` for `seconds`."""
    commands = np.broadcast_to(np.array(place), (*world.motion.shape, 3)).copy()
    for _ in range(round(seconds / world.scenario.decision_time)):
        advance(world, (commands,))


@pytest.mark.parametrize("airframe", ["crazyflie", "hummingbird", "matrice-100"])
def test_a_setpoint_is_reached_and_held(airframe: str) -> None:
    world = begun(flown(vehicle={"airframe": airframe}))
    steer(world, (12.0, 9.0, 6.0), 25.0)
    assert world.motion["fate"][0, 0] == FLYING_ON
    # 1 cm: what the slowest of the three controllers has left after 25 s for 9.6 m
    np.testing.assert_allclose(world.motion["position"][0, 0], (12.0, 9.0, 6.0), atol=0.01)
    np.testing.assert_allclose(world.motion["velocity"][0, 0], 0.0, atol=0.01)


def test_the_steady_speed_is_that_of_the_vehicle_less_its_drag() -> None:
    world = begun(flown(vehicle={"speed": 2.0}))
    steer(world, (4.0, 19.0, 4.0), 4.0)
    frame = world.scenario.vehicle.airframe
    # balance of the position loop: m kp lookahead = (m kd + k_d sum of rotor speeds) v; rotors at hover within 2 %
    drag = frame.k_d * 4 * frame.hover_speed / frame.mass
    expected = frame.position_gain[0] * world.scenario.vehicle.lookahead / (frame.velocity_gain[0] + drag)
    assert world.motion["velocity"][0, 0, 1] == pytest.approx(expected, rel=0.02)
    assert expected == pytest.approx(2.0 / (1 + drag / frame.velocity_gain[0]))


def test_velocities_are_flown_and_cut_to_the_speed() -> None:
    world = begun(flown("velocity", vehicle={"speed": 2.0}))
    steer(world, (0.0, 30.0, 0.0), 3.0)
    speed = world.motion["velocity"][0, 0, 1]
    assert 1.7 < speed <= 2.0  # less the drag, as above
    assert world.ledger["path"][0, 0] > 4.0


def test_a_wind_pushes_only_those_that_feel_it() -> None:
    offsets = []
    for feels in (True, False):
        world = begun(flown(vehicle={"feels_wind": feels}, **{"wind.velocity": (2.0, 0.0, 0.0)}))
        steer(world, (4.0, 4.0, 4.0), 10.0)
        offsets.append(world.motion["position"][0, 0, 0] - 4.0)
    frame = world.scenario.vehicle.airframe
    # at rest: m kp offset = k_d sum of rotor speeds times wind
    expected = frame.k_d * 4 * frame.hover_speed * 2.0 / (frame.mass * frame.position_gain[0])
    assert offsets[0] == pytest.approx(expected, rel=0.02)
    assert abs(offsets[1]) < 1e-9


@pytest.mark.parametrize("action", ["setpoint", "velocity"])
def test_bounds_hold_or_end_a_flight(action: str) -> None:
    command = (-20.0, 4.0, 4.0) if action == "setpoint" else (-3.0, 0.0, 0.0)
    held = begun(flown(action))
    steer(held, command, 5.0)
    assert held.running[0]
    assert held.motion["position"][0, 0, 0] == 0.0
    ended = begun(flown(action, **{"arena.bounds": "end", "arena.margin": 0.5}))
    steer(ended, command, 5.0)
    assert not ended.running[0]
    motion = ended.motion[0, 0]
    assert motion["fate"] == LEFT
    assert motion["terminated"]
    assert -0.5 - 3.0 * 0.02 < motion["position"][0] < -0.5
    assert EpisodeRecord.of(ended, 0, "test").ended == "out_of_bounds"


def test_within_the_margin_a_flight_goes_on() -> None:
    world = begun(flown(**{"arena.bounds": "end", "arena.margin": 0.5}))
    steer(world, (-0.3, 4.0, 4.0), 8.0)
    assert world.running[0]
    assert world.motion["position"][0, 0, 0] == pytest.approx(-0.3, abs=0.02)
    assert np.abs(world.layout.flat(world)).max() <= 1.0


@pytest.mark.parametrize("action", ["setpoint", "velocity", "waypoint"])
def test_a_flight_that_becomes_unstable_ends_where_it_last_was_sound(action: str) -> None:
    vehicle = {"airframe": UNSTABLE, "speed": 10.0}
    world = begun(flown(action, vehicle=vehicle, **{"wind.velocity": (3.0, 1.0, 0.0)}), [1, 2])
    rng, steps = np.random.default_rng(0), 0
    while world.running.any():
        advance(world, random_commands(world, rng))
        assert np.isfinite(world.physical).all()
        assert np.isfinite(world.layout.flat(world)).all()
        steps += 1
        assert steps < 1000
    assert np.all(world.motion["fate"] == DIVERGED)
    assert np.all(world.motion["terminated"])
    assert np.all(world.motion["samples"] == 0)
    assert EpisodeRecord.of(world, 0, "test").ended == "diverged"


@pytest.mark.parametrize("rule", ["stop", "slide", "end"])
@pytest.mark.parametrize("action", ["setpoint", "velocity", "waypoint"])
def test_bodies_do_not_pass_walls(action: str, rule: str) -> None:
    world = begun(flown(action, **{"arena.obstacles": [WALL], "arena.collision": rule}))
    for _ in range(60 if action != "waypoint" else 3):
        if not world.running[0]:
            break
        place = (3.0, 1.0, 0.0) if action == "velocity" else (15.0, 6.0, 4.0)
        commands = np.array([[place]])
        advance(world, (commands, np.ones((1, 1), np.int64)) if action == "waypoint" else (commands,))
        assert world.motion["position"][0, 0, 0] < 8.0
        assert world.body[0, 0, 0] < 8.0
    assert world.ledger["collisions"][0, 0] > 0
    assert world.motion["position"][0, 0, 0] > 7.5
    if rule == "end":
        assert EpisodeRecord.of(world, 0, "test").ended == "collision"
    if rule == "slide" and action == "velocity":
        assert world.motion["position"][0, 0, 1] > 6.0  # along the wall


@pytest.mark.parametrize("clock", ["barrier", "event"])
def test_legs_arrive_hover_and_sample(clock: str) -> None:
    world = begun(flown("waypoint", clock=clock))
    advance(world, (np.array([[[10.0, 4.0, 4.0]]]), np.full((1, 1), 3)))
    motion, book = world.motion[0, 0], world.ledger[0, 0]
    assert np.linalg.norm(motion["position"] - (10.0, 4.0, 4.0)) < 0.05  # three seconds of hovering after the arrival
    assert motion["samples"] == 3
    assert book["turns"] == 0
    assert book["hovering_time"] == pytest.approx(1.0 + 3.0)  # the first hover of a reset, then this one
    assert 6.0 / 3.0 < book["flying_time"] < 6.0 / 3.0 + 2.0
    assert book["path"] == pytest.approx(6.0, abs=0.2)
    assert world.episode["clock"][0] == pytest.approx(book["search_time"])


def test_a_leg_against_too_strong_a_wind_is_given_up() -> None:
    world = begun(flown("waypoint", **{"wind.velocity": (30.0, 0.0, 0.0), "energy.capacity": 1e9}))
    advance(world, (np.array([[[2.0, 4.0, 4.0]]]), np.ones((1, 1), np.int64)))
    assert world.ledger["flying_time"][0, 0] == pytest.approx(10.0 + 3.0 * 2.0 / 3.0, abs=0.05)
    assert np.isfinite(world.physical).all()


@pytest.mark.parametrize("action", ["setpoint", "waypoint"])
@pytest.mark.parametrize("kind", ["measured", "thrust"])
def test_batteries_end_flights_and_are_never_overdrawn(action: str, kind: str) -> None:
    power = {"flying_power": 9.0, "hovering_power": 7.0, "turn_energy": 0.0} if kind == "measured" else {}
    world = begun(flown(action, energy={"kind": kind, "capacity": 100.0} | power), [1, 2, 3])
    rng = np.random.default_rng(0)
    while world.running.any():
        advance(world, random_commands(world, rng))
    book = world.ledger
    assert np.all(book["spent"] <= 100.0 * (1 + 1e-12))
    np.testing.assert_allclose(book["energy"].sum(axis=-1), book["spent"], rtol=1e-9)
    assert np.all(world.motion["exhausted"])
    assert EpisodeRecord.of(world, 0, "test").ended == "battery"
    # a crazyflie hovers with about 7 W, and flies with about as much: within a factor of two
    np.testing.assert_allclose(book["spent"] / book["search_time"], 7.5, atol=3.5)


def test_measured_powers_go_by_the_speed() -> None:
    energy = {"kind": "measured", "flying_power": 9.0, "hovering_power": 5.0}
    world = begun(flown(energy=energy))
    steer(world, (8.0, 4.0, 4.0), 12.0)
    book = world.ledger[0, 0]
    assert book["energy"][FLYING] == pytest.approx(9.0 * book["flying_time"])
    assert book["energy"][HOVERING] == pytest.approx(5.0 * book["hovering_time"])
    assert book["hovering_time"] > 2.0


def test_bodies_fly_the_same_in_a_batch_after_a_reset_of_some() -> None:
    many, alone = begun(flown(), [4, 5]), begun(flown(), 5)
    rng = np.random.default_rng(1)
    steer(many, (9.0, 9.0, 9.0), 3.0)
    many.reset([7, 5], np.array([False, True]))
    for _ in range(100):
        commands = random_commands(many, rng)
        advance(many, commands)
        advance(alone, (commands[0][1:].copy(),))
    assert differences(many, 1, alone, 0) == []
    assert np.array_equal(many.body[1], alone.body[0])


BAD: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "airframe": ({"vehicle.airframe": "crazyfly"}, ("vehicle.airframe", "crazyfly", "crazyflie, hummingbird")),
    "mass": ({"vehicle.airframe": {"base": "crazyflie", "mass": 1.0}}, ("vehicle.airframe", "mass", "hovering needs")),
    "unknown": ({"vehicle.airframe": {"base": "crazyflie", "mas": 1.0}}, ("mas", "mass")),
    "steps": ({"vehicle.control_period": 0.03}, ("vehicle", "control_period = 0.03", "decision_period = 0.1")),
    "hops": ({"action": "hop"}, ("action", "hop", "waypoint, velocity, setpoint")),
    "bounds": ({"arena.bounds": "stop"}, ("arena.bounds", "stop", "'hold' or 'end'")),
    "margin": ({"arena.margin": -1.0}, ("arena.margin", "-1", "greater than or equal to 0")),
    "thrust": ({"energy.kind": "thrust", "vehicle": {"kind": "point_mass"}}, ("energy.kind", "thrust", "quadrotor")),
    "legs": ({"vehicle.backend": "rotorpy", "action": "waypoint"}, ("action", "rotorpy", "velocity, setpoint")),
    "start": ({"team.starts": [(4.0, 4.0, 40.0)]}, ("team.starts", "40", "inside the area")),
    "energy": ({"energy.kind": "nuclear"}, ("energy.kind", "nuclear", "thrust")),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_said_in_one_line(case: str) -> None:
    changes, words = BAD[case]
    with pytest.raises(InputError) as caught:
        flown().override(**changes)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message, message


def test_presets_of_the_chemotaxis_paper_fly_a_quadrotor_at_its_rates() -> None:
    for number in (1, 2, 3):
        scenario = load_scenario(f"puff-source{number}")
        vehicle = scenario.vehicle
        crazyflie = vehicle.airframe.model_copy(update={"tilt_limit": math.pi})  # but for this, RotorPy's
        assert (vehicle.kind, crazyflie.name) == ("quadrotor", "crazyflie")
        assert vehicle.airframe.tilt_limit == pytest.approx(math.pi / 3)
        assert (vehicle.control_period, scenario.decision_time, scenario.tick) == (0.01, 0.05, 0.05)
        assert vehicle.lookahead >= 2.5
