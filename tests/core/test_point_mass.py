"""The point mass steers to setpoints by proportional control, and is held at the bounds or lost beyond them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from worlds import advance, begun, flying, random_commands

from osl_env import InputError, World
from osl_env.parameters import FloatArray
from osl_env.state import FLYING_ON, LEFT
from osl_env.vehicles.point_mass import PointMass

START = (10.0, 10.0, 5.0)
AGILE = {"acceleration": 1e6}  # takes any velocity within a physics step


def lone(action: str = "setpoint", vehicle: dict[str, Any] | None = None, **changes: Any) -> World:
    """One UAV at START."""
    settings = {"team.n_uavs": 1, "team.starts": [START], "vehicle": {"kind": "point_mass"} | (vehicle or {})}
    return begun(flying(action=action, **settings | changes))


def track(world: World, setpoint: Any, periods: int) -> FloatArray:
    """Places (periods + 1, 3) m of the lone UAV on its way to `setpoint` (3,) m."""
    target = np.array(setpoint, dtype=np.float64).reshape(1, 1, 3)
    places = [world.motion["position"][0, 0].copy()]
    for _ in range(periods):
        world.step_setpoints(target)
        places.append(world.motion["position"][0, 0].copy())
    return np.array(places)


@pytest.mark.parametrize("offset", [(0.5, 0.0, 0.0), (0.2, -0.3, 0.4), (0.0, 0.0, -0.6)])
def test_a_setpoint_is_neared_exponentially(offset: tuple[float, float, float]) -> None:
    gain, errors = 1.6, []
    for step in (0.1, 0.05, 0.025):
        # all of the way is slower than the greatest speed, so that nothing is cut
        world = lone(vehicle=AGILE | {"position_gain": gain, "physics_step": step})
        left = np.add(START, offset) - track(world, np.add(START, offset), 4)
        n = round(1.0 / step)
        expected = np.array(offset) * (1.0 - gain * step) ** (n * np.arange(5))[:, None]
        np.testing.assert_allclose(left, expected, atol=1e-12)
        errors.append(np.abs(left - np.array(offset) * np.exp(-gain * np.arange(5))[:, None]).max())
    assert errors[0] < 0.05 * np.linalg.norm(offset)  # exp(-1) (K dt / 2) at the time constant: 0.03
    assert errors[2] < 0.55 * errors[1] < 0.55**2 * errors[0]  # first order in the step


@pytest.mark.parametrize(
    "vehicle",
    [{}, AGILE, {"position_gain": 50.0} | AGILE, {"speed": 4.0, "acceleration": 6.4}],
    ids=["default", "agile", "stiff", "fast"],
)
@pytest.mark.parametrize("offset", [(6.0, 0.0, 0.0), (-5.0, 4.0, 2.0), (0.3, 0.0, 0.1)])
def test_it_does_not_fly_past_the_setpoint(vehicle: dict[str, Any], offset: tuple[float, float, float]) -> None:
    """Where K speed <= a; a gain beyond one over the physics step arrives within a step."""
    world = lone(vehicle=vehicle | {"decision_period": 0.1})
    places = track(world, np.add(START, offset), 300)
    along = np.array(offset) / np.linalg.norm(offset)
    left = (np.add(START, offset) - places) @ along
    assert left.min() >= -1e-12
    assert np.diff(left).max() <= 1e-12
    assert left[-1] < 1e-6
    np.testing.assert_allclose(np.cross(places - START, along), 0.0, atol=1e-9)  # straight


def test_without_the_brakes_for_its_gain_it_flies_past_and_comes_back() -> None:
    world = lone(vehicle={"acceleration": 0.1, "decision_period": 0.1})
    left = 3.0 - (track(world, np.add(START, (3.0, 0.0, 0.0)), 580)[:, 0] - START[0])
    assert left.min() < -0.1
    assert np.abs(left[-100:]).max() < np.abs(left[:100]).max()


@pytest.mark.parametrize("gain", [0.4, 1.6, 8.0, 30.0])
def test_beyond_the_lookahead_it_flies_at_its_greatest_speed(gain: float) -> None:
    parameters = {"speed": 2.0, "position_gain": gain, "decision_period": 0.1, **AGILE}
    lookahead = PointMass(**parameters).lookahead
    assert lookahead == pytest.approx(2.0 / min(gain, 10.0))
    for distance, speed in ((4.0 * lookahead, 2.0), (1.01 * lookahead, 2.0), (0.5 * lookahead, 1.0)):
        world = lone(vehicle=parameters, **{"arena.size": (200.0, 200.0, 100.0)})
        world.step_setpoints(np.add(START, (0.6 * distance, 0.0, 0.8 * distance)).reshape(1, 1, 3))
        np.testing.assert_allclose(world.motion["velocity"][0, 0], [0.6 * speed, 0.0, 0.8 * speed], rtol=1e-9)


def test_a_setpoint_is_flown_the_same_whatever_the_decision_period() -> None:
    target = np.add(START, (3.0, -2.0, 1.0))
    often, seldom = (lone(vehicle={"decision_period": period}) for period in (0.2, 1.0))
    assert np.array_equal(track(often, target, 30)[::5], track(seldom, target, 6))


def test_steering_is_giving_the_velocities_of_the_law() -> None:
    vehicle = {"decision_period": 0.1, "physics_step": 0.1}
    steered, told = lone(vehicle=vehicle), lone("velocity", vehicle=vehicle)
    rng, gain = np.random.default_rng(0), steered.scenario.vehicle.position_gain  # type: ignore[union-attr]
    for _ in range(100):
        setpoint = rng.uniform((-3, -3, -3), (23, 23, 13), (1, 1, 3))
        steered.step_setpoints(setpoint)
        told.step_velocities(gain * (setpoint - told.motion["position"]))
        assert np.array_equal(steered.motion["position"], told.motion["position"])
    assert steered.ledger.tobytes() == told.ledger.tobytes()


def test_at_bounds_that_hold_a_setpoint_outside_is_neared_along_them() -> None:
    world = lone()
    places = track(world, (25.0, 13.0, 5.0), 40)
    assert places[:, 0].max() == places[-1, 0] == 20.0
    # with the setpoint 5 m beyond the bounds, the share (13 - y) / 5 m of the speed is along them: 6 time constants
    assert np.all(np.diff(places[:, 1]) > 0)
    assert 0 < 13.0 - places[-1, 1] < 3.0 * np.exp(-5)
    assert world.motion["fate"][0, 0] == FLYING_ON


ENDING_BOUNDS = {"arena.bounds": "end", "arena.margin": 0.5}
OUTWARDS = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]


@pytest.mark.parametrize("direction", OUTWARDS)
@pytest.mark.parametrize("action", ["velocity", "setpoint"])
def test_beyond_the_margin_a_uav_is_lost_where_it_is(action: str, direction: tuple[int, int, int]) -> None:
    half = np.array(START)  # START is the centre
    gap = float(half @ np.abs(direction))
    world = lone(action, vehicle=AGILE | {"physics_step": 0.05}, **ENDING_BOUNDS)
    command = np.array(direction, float) if action == "velocity" else half + 50.0 * np.array(direction)
    steps = 0
    while world.running[0]:
        advance(world, (command.reshape(1, 1, 3),))
        steps += 1
    # at 1 m/s, the first physics step whose end is beyond the margin; rounding may take it one earlier
    out = world.motion["position"][0, 0] - half
    flown = float(out @ direction)
    assert gap + 0.5 < flown <= gap + 0.5 + 0.05 + 1e-9
    np.testing.assert_allclose(out, flown * np.array(direction), atol=1e-12)
    assert steps == math.ceil(flown)
    assert world.motion["fate"][0, 0] == LEFT
    assert not world.motion["active"][0, 0]
    assert world.ledger["search_time"][0, 0] == pytest.approx(flown, abs=1e-9)  # the period ended with it
    assert world.ledger["path"][0, 0] == pytest.approx(flown, abs=1e-9)
    assert np.isfinite(world.physical).all()
    assert np.abs(world.layout.flat(world)).max() <= 1.0


def test_within_the_margin_a_uav_may_come_back() -> None:
    world = lone(**ENDING_BOUNDS)
    assert track(world, (20.4, 10.0, 5.0), 25)[-1, 0] > 20.3
    assert world.motion["fate"][0, 0] == FLYING_ON
    assert track(world, START, 20)[-1, 0] < 12.0
    assert world.running[0]


def test_the_others_fly_on() -> None:
    world = begun(flying(action="setpoint", **ENDING_BOUNDS))
    setpoints = world.motion["position"].copy()
    setpoints[0, 0] = (-9.0, 4.0, 4.0)
    for _ in range(8):
        world.step_setpoints(setpoints)
    assert world.motion["active"][0].tolist() == [False, True, True]
    assert world.motion["terminated"][0].tolist() == [True, False, False]
    assert world.running[0]


@pytest.mark.parametrize("action", ["velocity", "setpoint"])
@pytest.mark.parametrize("rule", ["stop", "slide", "end"])
def test_among_obstacles_bounds_may_end_flights_too(action: str, rule: str) -> None:
    boxes = [{"kind": "box", "low": [8.0, 0.0, 0.0], "high": [9.0, 20.0, 6.0]}]
    arena = {"size": (20.0, 20.0, 10.0), "obstacles": boxes, "collision": rule, "bounds": "end", "margin": 0.5}
    vehicle = {"kind": "point_mass", "speed": 3.0, "acceleration": 8.0}
    world = begun(flying(action=action, arena=arena, vehicle=vehicle), list(range(8)))
    rng, geometry = np.random.default_rng(1), world.scenario.arena
    for _ in range(40):
        commands = random_commands(world, rng)[0]
        if action == "setpoint":  # farther out
            commands = 1.5 * commands - 4.0
        advance(world, (commands,))
        for place in world.motion["position"].reshape(-1, 3):
            assert geometry.is_free(tuple(place)), place
    fate, place = world.motion["fate"], world.motion["position"]
    outside = np.maximum(-place, place - np.array(geometry.size)).max(axis=-1)
    assert np.array_equal(fate == LEFT, outside > 0.5)
    assert (fate == LEFT).any()
    assert world.ledger["collisions"].any()
    assert not (world.motion["active"] & (fate == LEFT)).any()


@pytest.mark.parametrize("gain", [0.0, -1.0, float("nan"), float("inf")])
def test_bad_gains_are_refused_in_one_line(gain: float) -> None:
    with pytest.raises(InputError, match="position_gain") as caught:
        flying(vehicle={"kind": "point_mass", "position_gain": gain})
    assert "\n" not in str(caught.value)
