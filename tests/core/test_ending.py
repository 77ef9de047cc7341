"""What ends an episode: declarations right and wrong, reaching, and what the record says of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from worlds import begun, fly, flying, hover, small

from osl_env import EpisodeRecord, InputError, World
from osl_env.parameters import FloatArray
from osl_env.state import ENDED, FALSE_DECLARATION, RUNNING, SUCCESS

SOURCE = np.array([12.0, 13.0, 5.0])


def legs(**changes: Any) -> World:
    return begun(small(action="waypoint", **changes), [1, 2])


def stay(world: World, declarations: FloatArray | None = None) -> None:
    world.step_waypoints(world.motion["position"].copy(), np.ones(world.motion.shape, np.int64), declarations)


def says(world: World, uav: int, place: Any, env: int = 0) -> FloatArray:
    declarations = np.full((*world.motion.shape, 3), np.nan)
    declarations[env, uav] = place
    return declarations


@pytest.mark.parametrize(
    ("error", "outcome"),
    [(0.0, SUCCESS), (4.999, SUCCESS), (5.0, SUCCESS), (5.001, FALSE_DECLARATION), (9.0, FALSE_DECLARATION)],
)
def test_a_declaration_is_right_within_the_success_radius(error: float, outcome: int) -> None:
    world = legs()
    stay(world)
    stay(world, says(world, 1, SOURCE - [0.0, error, 0.0]))
    episode = world.episode[0]
    assert (episode["outcome"], episode["winner"]) == (outcome, 1)
    assert episode["declaration_error"] == pytest.approx(error, abs=1e-12)
    assert episode["search_time"] == world.ledger["search_time"][0, 1] == 2.0
    assert world.motion["terminated"][0].all()
    assert not world.motion["active"][0].any()
    assert not world.motion["truncated"][0].any()
    assert (world.team["terminated"].tolist(), world.team["truncated"].tolist()) == ([True, False], [False, False])
    assert world.running.tolist() == [False, True]


def test_any_of_several_sources_will_do() -> None:
    world = legs(**{"sources.positions": [(1.0, 1.0, 1.0), tuple(SOURCE.tolist())]})
    stay(world, says(world, 0, np.add(SOURCE, [1.0, 0, 0])))
    assert world.episode["outcome"][0] == SUCCESS
    assert world.episode["declaration_error"][0] == pytest.approx(1.0)


def test_a_declaration_takes_no_time_and_nothing_else_is_flown() -> None:
    world = legs()
    stay(world)
    clock, position = world.episode["clock"][0], world.motion["position"][0].copy()
    world.step_waypoints(np.zeros((2, 3, 3)), np.ones((2, 3), np.int64), says(world, 2, SOURCE))
    assert world.episode["clock"][0] == clock
    assert np.array_equal(world.motion["position"][0], position)


def test_of_simultaneous_declarations_that_of_the_least_search_time_counts() -> None:
    world = legs(**{"team.starts": [(2.0, 4.0, 4.0), (10.0, 6.0, 5.0), (16.0, 4.0, 6.0)]})
    targets = world.motion["position"].copy()
    targets[0, 0, 0] += 5.0
    targets[0, 2, 0] += 3.0
    world.step_waypoints(targets, np.ones((2, 3), np.int64))  # search times 7, 2 and 5 s
    declarations = says(world, 0, SOURCE)
    declarations[0, 2] = (0.0, 0.0, 0.0)
    stay(world, declarations)
    assert world.episode["winner"][0] == 2
    assert world.episode["outcome"][0] == FALSE_DECLARATION  # though UAV 0 was right, 2 s later


def test_of_equal_search_times_the_lower_number_counts() -> None:
    world = legs()
    declarations = says(world, 2, (0.0, 0.0, 0.0))
    declarations[0, 1] = SOURCE
    stay(world, declarations)
    assert (world.episode["winner"][0], world.episode["outcome"][0]) == (1, SUCCESS)


def test_only_who_decides_may_declare() -> None:
    world = begun(small(action="waypoint", clock="event"), [1])
    targets = world.motion["position"].copy()
    targets[0, 0] += [10.0, 0, 0]
    world.step_waypoints(targets, np.ones((1, 3), np.int64))
    assert not world.motion["ready"][0, 0]
    stay(world, says(world, 0, SOURCE))
    assert world.episode["outcome"][0] == RUNNING


def test_the_dead_do_not_declare() -> None:
    world = legs(**{"energy.capacity": 470.0 * 3 + 663.0 * 4, "radio.radius": 0})
    targets = world.motion["position"].copy()
    targets[:, 0] += [9.0, 0, 0]
    world.step_waypoints(targets, np.ones((2, 3), np.int64))
    assert world.motion["terminated"][0].tolist() == [True, False, False]
    stay(world, says(world, 0, SOURCE))
    assert world.episode["outcome"][0] == RUNNING


def test_an_ended_episode_stays_as_it_is() -> None:
    world = legs()
    stay(world, says(world, 0, (0.0, 0.0, 0.0)))
    stay(world, says(world, 1, SOURCE))
    assert (world.episode["outcome"][0], world.episode["winner"][0]) == (FALSE_DECLARATION, 0)


def test_hop_and_box_actions_declare_the_uavs_own_place() -> None:
    starts = {"team.starts": [(11.0, 12.0, 5.0), (1.0, 1.0, 1.0), (1.0, 9.0, 1.0)]}
    right, wrong = begun(small(**starts)), begun(small(**starts))
    right.step_hops(hover(right, declare=0))
    wrong.step_hops(hover(wrong, declare=1))
    assert right.episode["outcome"][0] == SUCCESS
    assert right.episode["declared"][0].tolist() == [11.0, 12.0, 5.0]
    assert right.episode["declaration_error"][0] == pytest.approx(math.sqrt(2))
    assert wrong.episode["outcome"][0] == FALSE_DECLARATION


def test_reach_ends_when_any_uav_comes_near() -> None:
    world = legs(**{"ending.success": "reach", "ending.success_radius": 2.0})
    targets = world.motion["position"].copy()
    targets[0, 1] = np.add(SOURCE, [0.0, 2.5, 0.0])
    world.step_waypoints(targets, np.ones((2, 3), np.int64))
    assert world.running.all()
    targets[0, 1] = np.add(SOURCE, [0.0, 2.0, 0.0])
    world.step_waypoints(targets, np.ones((2, 3), np.int64))
    assert world.episode["outcome"].tolist() == [SUCCESS, RUNNING]
    assert world.episode["winner"][0] == 1
    assert world.motion["terminated"][0].all()
    assert math.isnan(world.episode["declaration_error"][0])


def test_under_reach_declarations_mean_nothing() -> None:
    world = legs(**{"ending.success": "reach", "ending.success_radius": 1.0})
    stay(world, says(world, 0, SOURCE))
    assert world.running.all()
    hops = begun(small(**{"ending.success": "reach", "ending.success_radius": 1.0}))
    hops.step_hops(hover(hops, declare=0))
    assert hops.running.all()
    assert hops.ledger["hovers"][0].tolist() == [2, 2, 2]


def test_in_velocity_mode_a_declaration_ends_the_episode_too() -> None:
    world = begun(flying())
    world.step_velocities(np.zeros((1, 3, 3)), says(world, 2, SOURCE))
    assert world.episode["outcome"][0] == SUCCESS


def test_the_record_sums_up_a_success() -> None:
    world = legs()
    targets = world.motion["position"].copy()
    targets[0, 1] += [3.0, 0, 0]
    world.step_waypoints(targets, np.ones((2, 3), np.int64))
    world.exchange([[b"abc"] * 3] * 2)
    stay(world, says(world, 1, np.add(SOURCE, [1.0, 0, 0])))
    record = EpisodeRecord.of(world, 0, "tester")
    ledger = world.ledger[0]
    assert (record.success, record.false_declaration, record.ended, record.winner) == (True, False, "success", 1)
    assert (record.search_time, record.mission_time, record.waiting_time) == (5.0, 5.0, 6.0)
    assert (record.n_flights, record.n_hovers, record.n_turns, record.decisions) == (1, 6, 0, 1)
    assert (record.path, record.team_path) == (3.0, 3.0)
    assert (record.flying_time, record.hovering_time, record.turning_time) == (3.0, 6.0, 0.0)
    assert record.declaration_error == pytest.approx(1.0)
    assert record.energy == pytest.approx(ledger["spent"].sum())
    assert (record.messages, record.bytes) == (6, 6 * 16 + 9)
    assert (record.scenario, record.scenario_hash, record.seed) == ("small", world.scenario.hash, 1)
    assert EpisodeRecord.from_dict(record.to_dict()) == record
    with pytest.raises(InputError, match="unknown field 'extra'"):
        EpisodeRecord.from_dict(record.to_dict() | {"extra": 1})


@pytest.mark.parametrize(
    ("changes", "ended"),
    [
        ({"ending.time_limit": 20.0}, "time"),
        ({"ending.max_decisions": 3}, "decisions"),
        ({"energy.capacity": 5000.0}, "battery"),
        ({"vehicle": {"kind": "point_mass"}, "action": "velocity", "ending.time_limit": 33.0}, "time"),
    ],
)
def test_the_record_says_why_a_search_failed(changes: dict[str, Any], ended: str) -> None:
    world = begun(small(**changes), list(range(8)))
    fly(world)
    for env in range(8):
        record = EpisodeRecord.of(world, env, "tester")
        assert (record.ended, record.success, record.winner) == (ended, False, -1)
        assert record.search_time == world.scenario.ending.time_limit
        assert math.isnan(record.declaration_error)
        assert world.episode["outcome"][env] == ENDED
