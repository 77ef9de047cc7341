"""Energy laws: a ledger never decreases, adds up, never exceeds the battery; an empty battery ends one flight."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from worlds import advance, begun, differences, fly, flying, hover, random_commands, small

from osl_env import World
from osl_env.energy import EnergyModel
from osl_env.state import COMMUNICATING, COMPUTING, ENDED, FLYING, HOVERING, TURNING, WAITING

MODES = [("hop", "barrier"), ("hop", "event"), ("waypoint", "barrier"), ("waypoint", "event"), ("velocity", "barrier"),
         ("setpoint", "barrier")]  # fmt: skip
COUNTS = ("spent", "search_time", "turning_time", "flying_time", "hovering_time", "waiting_time", "path", "turns",
          "hovers", "flights", "decisions", "messages", "bytes")  # fmt: skip


def exchange(world: World, rng: np.random.Generator) -> None:
    payloads = [[bytes(int(rng.integers(0, 500))) for _ in range(world.n_uavs)] for _ in range(world.n_envs)]
    world.exchange(payloads, rng.uniform(0, 1e9, world.motion.shape))


@pytest.mark.parametrize(("mode", "clock"), MODES)
@pytest.mark.parametrize("capacity", [2e6, 12e3, 3e3, 470.0, 100.0])
def test_ledger_laws(mode: str, clock: str, capacity: float) -> None:
    world = begun(flying(action=mode, clock=clock, **{"energy.capacity": capacity}), [1, 2, 3, 4, 5])
    rng, last = np.random.default_rng(0), world.ledger.copy()
    while world.running.any():
        exchange(world, rng)
        advance(world, random_commands(world, rng))
        ledger = world.ledger
        for name in COUNTS:
            assert np.all(ledger[name] >= last[name]), name
        assert np.all(ledger["energy"] >= last["energy"])
        np.testing.assert_allclose(ledger["energy"].sum(axis=-1), ledger["spent"], rtol=1e-9)
        assert np.all(ledger["spent"] <= capacity * (1 + 1e-12))
        last = ledger.copy()
    empty = world.motion["terminated"]
    np.testing.assert_allclose(world.ledger["spent"][empty], capacity, rtol=1e-9)
    assert np.all(empty != world.motion["truncated"])
    assert empty.all() == (capacity < 1e5)


@pytest.mark.parametrize("turn_time", [0.0, 1.0])
@pytest.mark.parametrize("capacity", [3000.0, 4000.0, 5000.0, 6500.0])
def test_a_turn_cannot_cost_more_than_is_left(turn_time: float, capacity: float) -> None:
    world = begun(small(**{"energy.capacity": capacity, "vehicle.turn_time": turn_time, "team.n_uavs": 1}))
    fly(world)
    assert world.ledger["spent"][0, 0] == pytest.approx(capacity, rel=1e-12)
    assert world.motion["terminated"][0, 0]


def test_powers_of_zero_do_not_break_the_ledger() -> None:
    free = {"energy.hovering_power": 0.0, "energy.flying_power": 0.0, "energy.turn_energy": 0.0, "energy.capacity": 1.0}
    for scenario in (small(**free), flying(**free)):
        world = begun(scenario)
        for _ in range(5):
            world.exchange([[bytes(10**7)] * 3])  # the radio alone empties the battery
            advance(world, random_commands(world, np.random.default_rng(0)))
        for name in COUNTS:
            assert np.all(np.isfinite(world.ledger[name])), name
        assert np.all(world.ledger["spent"] <= 1.0)
        assert np.all(world.motion["terminated"])


def test_computing_and_communicating_are_charged_by_equations_7_and_8() -> None:
    world = begun(small())
    model, radio = world.scenario.energy, world.scenario.radio
    assert model.joule_per_bit == pytest.approx(1e-28 * 1000 * (1e9) ** 2)
    assert radio.joule_per_byte == pytest.approx(8 * 0.1 / 250e3)
    before = world.ledger.copy()
    world.exchange([[b"", b"12345", None]], np.array([[1e6, 2e6, 0.0]]))
    spent = world.ledger["energy"] - before["energy"]
    np.testing.assert_allclose(spent[0, :, COMPUTING], np.array([1e6, 2e6, 0]) * model.joule_per_bit)
    np.testing.assert_allclose(spent[0, :, COMMUNICATING], np.array([0, 5, 0]) * radio.joule_per_byte, atol=1e-15)
    assert (world.ledger["bytes"] - before["bytes"]).tolist() == [[0, 5, 0]]


def test_velocity_flight_pays_flying_power_in_motion_and_hovering_power_at_rest() -> None:
    world = begun(flying(**{"team.n_uavs": 1}))
    world.step_velocities(np.zeros((1, 1, 3)))
    assert world.ledger["energy"][0, 0, HOVERING] == pytest.approx(470.0)
    world.step_velocities(np.full((1, 1, 3), 0.5))
    assert world.ledger["energy"][0, 0, FLYING] == pytest.approx(663.0)
    assert world.ledger["energy"][0, 0, TURNING] == 0.0


def one_way(**changes: Any) -> World:
    """Two UAVs: number 0 flies 10 m legs, number 1 hovers; way points."""
    settings = {"team.n_uavs": 2, "team.starts": [(2.0, 4.0, 4.0), (10.0, 6.0, 5.0)], "action": "waypoint"}
    return begun(small(**settings | changes))


def leg(world: World, x: float) -> None:
    targets = world.motion["position"].copy()
    targets[0, 0, 0] = x
    world.step_waypoints(targets, np.ones((1, 2), np.int64))


def test_an_empty_battery_stops_the_uav_in_the_middle_of_its_leg() -> None:
    world = one_way(**{"energy.capacity": 470.0 + 4 * 663.0 + 0.1, "radio.radius": 0})
    leg(world, 12.0)  # 10 m, but the battery lasts for the first hover and 4 m
    assert world.motion["position"][0, 0, 0] == pytest.approx(6.0, abs=1e-3)
    assert world.ledger["flying_time"][0, 0] == pytest.approx(4.0, abs=1e-3)
    assert world.ledger["path"][0, 0] == pytest.approx(4.0, abs=1e-3)
    assert world.motion["terminated"][0].tolist() == [True, False]
    assert not world.motion["truncated"][0].any()
    assert world.motion["active"][0].tolist() == [False, True]
    assert world.senses["sampling_time"][0, 0] == 1.0  # of the start: it did not get to sample again
    assert world.ledger["hovers"][0].tolist() == [1, 2]
    assert world.running[0]


def test_the_others_go_on_until_all_are_down() -> None:
    world = one_way(**{"energy.capacity": 470.0 * 7.5, "radio.radius": 0})
    leg(world, 12.0)
    position, steps = world.motion["position"][0, 0].copy(), 1
    while world.running[0]:
        leg(world, 12.0)
        steps += 1
        assert world.motion["position"][0, 0].tolist() == position.tolist()  # the dead do not move
    assert steps > 1
    assert world.episode["outcome"][0] == ENDED
    assert world.motion["terminated"][0].all()
    assert world.team["terminated"][0]
    assert not world.team["truncated"][0]
    np.testing.assert_allclose(world.ledger["spent"][0], 470.0 * 7.5, rtol=1e-12)


def test_the_time_limit_truncates() -> None:
    world = begun(small(**{"ending.time_limit": 10.0}), [1, 2])
    steps = 0
    while world.running.any():
        world.step_hops(hover(world))
        steps += 1
    assert steps == 9  # and one second at the start
    assert world.motion["truncated"].all()
    assert not world.motion["terminated"].any()
    assert world.team["truncated"].all()
    assert world.ledger["search_time"].tolist() == [[10.0] * 3] * 2


def test_the_decision_limit_truncates() -> None:
    world = begun(small(**{"ending.max_decisions": 4}))
    assert fly(world) == 4
    assert world.motion["truncated"].all()


def test_the_time_limit_ends_velocity_flight_on_time() -> None:
    world = begun(flying(**{"ending.time_limit": 60.0}))
    steps = 0
    while world.running.any():
        world.step_velocities(np.zeros((1, 3, 3)))
        steps += 1
    assert steps == 60


def test_waiting_is_hovering_until_the_slowest_is_done_and_is_not_search_time() -> None:
    world = one_way()
    leg(world, 12.0)
    ledger = world.ledger[0]
    assert world.episode["clock"][0] == 12.0  # 1 s at the start, 10 m, 1 s hover
    assert ledger["waiting_time"].tolist() == [0.0, 10.0]
    assert ledger["search_time"].tolist() == [12.0, 2.0]
    assert ledger["energy"][:, WAITING].tolist() == [0.0, 4700.0]


def test_a_battery_may_end_while_waiting() -> None:
    world = one_way(**{"energy.capacity": 470.0 * 7, "energy.flying_power": 0.0, "radio.radius": 0})
    leg(world, 12.0)
    ledger = world.ledger[0]
    assert world.motion["terminated"][0].tolist() == [False, True]
    assert ledger["waiting_time"][1] == pytest.approx(5.0)
    assert ledger["spent"][1] == pytest.approx(470.0 * 7, rel=1e-12)


def test_on_the_event_clock_nobody_waits_and_search_time_is_the_clock() -> None:
    world = begun(small(clock="event"), [1, 2, 3])
    rng = np.random.default_rng(0)
    while world.running.any():
        advance(world, random_commands(world, rng))
        deciding = world.motion["ready"] & world.motion["active"]
        clocks = np.broadcast_to(world.episode["clock"][:, None], deciding.shape)
        np.testing.assert_allclose(world.ledger["search_time"][deciding], clocks[deciding], rtol=1e-12)
        assert np.all(deciding.any(axis=1) | world.motion["truncated"].any(axis=1))
    assert not world.ledger["waiting_time"].any()
    assert not world.ledger["energy"][..., WAITING].any()


def test_on_the_event_clock_only_those_that_are_done_decide() -> None:
    world = one_way(clock="event")
    leg(world, 12.0)
    assert world.motion["ready"][0].tolist() == [False, True]
    assert world.episode["clock"][0] == 2.0
    assert world.motion["position"][0, 0, 0] == 2.0
    targets = np.array([[[0.0, 0, 0], [10.0, 6, 5]]])  # the one in flight ignores its new target
    for _ in range(10):
        world.step_waypoints(targets, np.ones((1, 2), np.int64))
    assert world.episode["clock"][0] == 12.0
    assert world.motion["ready"][0].tolist() == [True, True]
    assert world.motion["position"][0, 0].tolist() == [12.0, 4.0, 4.0]


@pytest.mark.parametrize("mode", ["hop", "waypoint"])
def test_for_one_uav_the_clocks_are_the_same_bit_for_bit(mode: str) -> None:
    lone = {"team.n_uavs": 1, "action": mode, "energy.capacity": 30e3}
    barrier, event = begun(small(clock="barrier", **lone), [1, 2, 3]), begun(small(clock="event", **lone), [1, 2, 3])
    rng = np.random.default_rng(0)
    while barrier.running.any():
        commands = random_commands(barrier, rng)
        advance(barrier, commands)
        advance(event, commands)
        for env in range(3):
            assert differences(barrier, env, event, env) == []


def test_a_declaration_charges_legs_in_flight_up_to_that_moment() -> None:
    world = one_way(clock="event")
    leg(world, 12.0)  # at clock 2, UAV 0 has 10 of 11 s to go
    declared = np.full((1, 2, 3), np.nan)
    declared[0, 1] = world.motion["position"][0, 1]
    world.step_waypoints(np.zeros((1, 2, 3)), np.ones((1, 2), np.int64), declared)
    assert world.ledger["search_time"][0].tolist() == pytest.approx([2.0, 2.0])
    np.testing.assert_allclose(world.ledger["energy"].sum(axis=-1), world.ledger["spent"], rtol=1e-12)


def test_the_default_battery_outlasts_the_time_limit() -> None:
    assert EnergyModel().capacity > 1200 * max(663.0, 470.0, 3415.0 / 4)
