"""Legs and velocities: times, places, counts and limits of what a vehicle flies."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from worlds import advance, begun, fly, flying, hover, random_commands, small

from osl_env import World
from osl_env.actions import HOP_DIRECTIONS
from osl_env.parameters import FloatArray
from osl_env.vehicles.legs import flight_time

EAST = int(np.flatnonzero((HOP_DIRECTIONS == (1, 0, 0)).all(axis=1))[0])
NORTH = int(np.flatnonzero((HOP_DIRECTIONS == (0, 1, 0)).all(axis=1))[0])
UP_NORTH_EAST = 25


def lone(**changes: Any) -> World:
    return begun(small(**{"team.n_uavs": 1, "team.starts": [(4.0, 4.0, 4.0)]} | changes))


def hop(world: World, direction: int, length: int = 1) -> None:
    world.step_hops(np.array([[direction * world.scenario.vehicle.hop_lengths + length - 1]]))


def clock(world: World) -> float:
    return float(world.episode["clock"][0])


def test_directions_are_the_26_neighbours_in_lexicographic_order() -> None:
    expected = [step for step in itertools.product((-1, 0, 1), repeat=3) if step != (0, 0, 0)]
    assert HOP_DIRECTIONS.tolist() == [list(map(float, step)) for step in expected]


def test_the_episode_begins_with_one_hovering_point() -> None:
    world = lone(**{"vehicle.hover_time": 2.5})
    ledger = world.ledger[0, 0]
    assert clock(world) == 2.5
    assert (ledger["hovering_time"], ledger["search_time"], ledger["hovers"], ledger["decisions"]) == (2.5, 2.5, 1, 0)
    assert ledger["spent"] == ledger["energy"][1] == 2.5 * 470.0
    assert world.senses["sampling_time"][0, 0] == 2.5


def test_a_hop_is_fly_and_hover_and_turns_only_when_the_direction_changes() -> None:
    world = lone()
    legs = [(EAST, 1), (EAST, 2), (NORTH, 1), (NORTH, 1), (EAST, 1)]  # turns: first leg none, then at legs 3 and 5
    lengths, turns = [1.0, 2.0, 1.0, 1.0, 1.0], [0, 0, 1, 0, 1]
    for (direction, length), distance, turn in zip(legs, lengths, turns, strict=True):
        before, count = clock(world), int(world.ledger["turns"][0, 0])
        hop(world, direction, length)
        assert clock(world) - before == pytest.approx(distance + 1.0 + turn, abs=1e-12)
        assert world.ledger["turns"][0, 0] - count == turn
    ledger = world.ledger[0, 0]
    assert world.motion["position"][0, 0].tolist() == [8.0, 6.0, 4.0]
    assert (ledger["flights"], ledger["hovers"], ledger["decisions"]) == (5, 6, 5)
    assert (ledger["flying_time"], ledger["turning_time"], ledger["path"]) == (6.0, 2.0, 6.0)
    np.testing.assert_allclose(ledger["energy"], [6 * 663.0, 6 * 470.0, 2 * 3415.0, 0, 0, 0], rtol=1e-12)


def test_hovering_keeps_the_heading() -> None:
    world = lone()
    hop(world, EAST)
    before = clock(world)
    world.step_hops(hover(world))
    assert clock(world) - before == 1.0
    hop(world, EAST)
    assert world.ledger["turns"][0, 0] == 0
    assert world.ledger["flights"][0, 0] == 2


def test_diagonal_hops_are_longer() -> None:
    world = lone()
    hop(world, UP_NORTH_EAST, 2)
    assert world.ledger["path"][0, 0] == pytest.approx(2 * np.sqrt(3))
    assert world.motion["position"][0, 0].tolist() == [6.0, 6.0, 6.0]


@pytest.mark.parametrize("vehicle", ["grid_hop", "point_mass"])
def test_a_hop_is_the_way_point_it_ends_at_bit_for_bit(vehicle: str) -> None:
    kind = {"vehicle": {"kind": vehicle, "hop_lengths": 2}, "team.starts": [(4.0, 4.0, 4.0)] * 3}
    hops = begun(small(action="hop", **kind), [1, 2, 3])
    legs = begun(small(action="waypoint", **kind), [1, 2, 3])
    rng = np.random.default_rng(0)
    for _ in range(15):
        (actions,) = random_commands(hops, rng)
        hops.step_hops(actions)
        legs.step_waypoints(hops.motion["position"].copy(), np.ones(actions.shape, np.int64))
        for group in ("motion", "ledger", "senses", "episode", "rewards"):
            assert getattr(hops, group).tobytes() == getattr(legs, group).tobytes(), group


def test_a_hop_out_of_the_area_is_shortened_to_the_longest_inside() -> None:
    world = lone(**{"team.starts": [(18.5, 4.0, 10.0)], "vehicle.hop_lengths": 4})
    hop(world, EAST, 4)
    assert world.motion["position"][0, 0].tolist() == [19.5, 4.0, 10.0]
    assert world.ledger["path"][0, 0] == 1.0
    before = clock(world)
    hop(world, EAST, 4)  # no hop east is left: hovers
    assert world.motion["position"][0, 0].tolist() == [19.5, 4.0, 10.0]
    assert clock(world) - before == 1.0
    assert world.ledger["flights"][0, 0] == 1
    hop(world, UP_NORTH_EAST, 3)  # up is barred too
    assert world.motion["position"][0, 0].tolist() == [19.5, 4.0, 10.0]


def test_way_points_outside_are_clipped_into_the_area() -> None:
    world = lone(action="waypoint")
    world.step_waypoints(np.array([[[-50.0, 10.0, 99.0]]]), np.array([[1]]))
    assert world.motion["position"][0, 0].tolist() == [0.0, 10.0, 10.0]


def test_samples_lengthen_the_hover_and_are_limited() -> None:
    world = lone(action="waypoint", **{"vehicle.max_samples": 6})
    here = world.motion["position"].copy()
    for asked, taken in ((3, 3), (1, 1), (100, 6), (0, 1), (-5, 1)):
        before = clock(world)
        world.step_waypoints(here, np.array([[asked]]))
        assert clock(world) - before == taken
        assert world.senses["sampling_time"][0, 0] == taken
    assert world.ledger["hovers"][0, 0] == 6  # hovering points, the first included


@pytest.mark.parametrize(("distance", "expected"), [(9.0, 9 / 2 + 2 / 0.5), (8.0, 8.0), (2.0, 4.0), (0.5, 2.0)])
def test_flight_from_rest_to_rest_is_a_trapezoid_or_a_triangle(distance: float, expected: float) -> None:
    assert flight_time(distance, 2.0, 0.5) == pytest.approx(expected, rel=1e-12)


def test_flight_time_grows_with_distance_without_a_jump() -> None:
    distances = np.linspace(0.01, 20, 4000)
    times = np.array([flight_time(d, 2.0, 0.5) for d in distances])
    assert np.all(np.diff(times) > 0)
    assert np.max(np.diff(times[100:])) < 0.02


def test_infinite_acceleration_is_distance_over_speed() -> None:
    assert flight_time(7.0, 2.0, np.inf) == 3.5


def test_the_point_mass_pays_for_acceleration_on_its_legs() -> None:
    world = lone(vehicle={"kind": "point_mass", "acceleration": 0.5})
    before = clock(world)
    hop(world, EAST)
    assert clock(world) - before == pytest.approx(1.0 + 2 * np.sqrt(1.0 / 0.5))


def track(world: World, commands: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities (steps, 3) of the lone UAV under `commands` (steps, 3)."""
    positions, velocities = [], []
    for command in commands:
        world.step_velocities(command.reshape(1, 1, 3))
        positions.append(world.motion["position"][0, 0].copy())
        velocities.append(world.motion["velocity"][0, 0].copy())
    return np.array(positions), np.array(velocities)


def lone_mass(**vehicle: Any) -> World:
    return begun(
        flying(**{"team.n_uavs": 1, "team.starts": [(10.0, 10.0, 5.0)]}, vehicle={"kind": "point_mass"} | vehicle)
    )


def test_velocity_mode_starts_unsampled_and_its_clock_counts_periods() -> None:
    world = lone_mass(decision_period=0.5, physics_step=0.1)
    assert clock(world) == 0.0
    assert world.senses["sampling_time"][0, 0] == 0.0
    track(world, np.zeros((4, 3)))
    assert clock(world) == pytest.approx(2.0)
    assert world.senses["sampling_time"][0, 0] == 0.5


def test_speed_is_limited_and_the_command_is_reached() -> None:
    world = lone_mass(acceleration=4.0)
    positions, velocities = track(world, np.tile([2.0, 2.0, 0.0], (4, 1)))  # the command is over the limit of 1 m/s
    np.testing.assert_allclose(velocities[1:], np.tile([np.sqrt(0.5), np.sqrt(0.5), 0], (3, 1)), rtol=1e-12)
    np.testing.assert_allclose(np.diff(positions, axis=0)[1:], velocities[2:], rtol=1e-9)


def test_acceleration_is_limited() -> None:
    world = lone_mass(acceleration=0.2)
    _, velocities = track(world, np.tile([1.0, 0.0, 0.0], (7, 1)))
    np.testing.assert_allclose(velocities[:, 0], [0.2, 0.4, 0.6, 0.8, 1.0, 1.0, 1.0], rtol=1e-9)
    _, velocities = track(world, np.tile([0.0, -1.0, 0.0], (2, 1)))
    assert np.linalg.norm(np.diff([[1.0, 0, 0], *velocities], axis=0), axis=1).max() <= 0.2 + 1e-12


def test_at_the_bounds_the_position_is_held_and_the_speed_across_them_lost() -> None:
    world = lone_mass()
    positions, velocities = track(world, np.tile([1.0, 0.3, 0.0], (15, 1)))
    assert positions[-1, 0] == 20.0
    assert velocities[-1, 0] == 0.0
    assert velocities[-1, 1] > 0.2


def test_the_path_is_the_way_flown_also_against_a_wall() -> None:
    world = lone_mass()
    track(world, np.tile([1.0, 0.0, 0.0], (30, 1)))
    assert world.motion["position"][0, 0].tolist() == [20.0, 10.0, 5.0]
    assert world.ledger["path"][0, 0] == pytest.approx(10.0, abs=1e-9)


def test_halving_the_physics_step_changes_little() -> None:
    commands = np.random.default_rng(1).uniform(-0.6, 0.6, (15, 3))
    ends = [track(lone_mass(acceleration=0.5, physics_step=dt), commands)[0] for dt in (0.1, 0.05, 0.025)]
    coarse, fine = np.abs(ends[0] - ends[2]).max(), np.abs(ends[1] - ends[2]).max()
    assert coarse < 0.25  # m, after 15 s
    assert fine < 0.6 * coarse  # first order in the step


@pytest.mark.parametrize("mode", ["hop", "waypoint", "velocity", "setpoint"])
@pytest.mark.parametrize("clock_rule", ["barrier", "event"])
def test_nobody_leaves_the_area_or_outflies_the_clock(mode: str, clock_rule: str) -> None:
    world = begun(flying(action=mode, clock=clock_rule), [1, 2, 3, 4])
    rng, before = np.random.default_rng(2), world.motion["position"].copy()
    area, speed = np.array(world.scenario.arena.size), world.scenario.vehicle.speed
    while world.running.any():
        flown = world.ledger["flying_time"].copy()
        advance(world, random_commands(world, rng))
        position = world.motion["position"]
        assert np.all((position >= 0) & (position <= area))
        moved = np.linalg.norm(position - before, axis=-1)
        slow = 0.05 if mode in ("velocity", "setpoint") else 0.0  # m in 1 s that counts as hovering
        assert np.all(moved <= speed * (world.ledger["flying_time"] - flown) + slow + 1e-9)
        before = position.copy()


def test_parts_of_the_search_time_add_up() -> None:
    world = begun(small(), [1, 2, 3])
    fly(world)
    ledger = world.ledger
    parts = ledger["flying_time"] + ledger["hovering_time"] + ledger["turning_time"]
    np.testing.assert_allclose(parts, ledger["search_time"], rtol=1e-12)
    np.testing.assert_allclose(ledger["turning_time"], ledger["turns"] * 1.0)
    np.testing.assert_allclose(ledger["flying_time"], ledger["path"] / 1.0, rtol=1e-12)
    np.testing.assert_allclose(ledger["hovering_time"], ledger["hovers"] * 1.0)
