"""Policies among obstacles: they look up what is in the way, go around it, and never fly into it."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from baselines import make_policy
from baselines.passage import Passage
from baselines.policy import Briefing
from osl_env import Scenario, load_scenario
from osl_env.actions import HOP_DIRECTIONS
from osl_env.world import World
from training.flight import fly

WALL = {"kind": "box", "low": [14.0, 0.0, 0.0], "high": [16.0, 18.0, 12.0]}  # a gap of 6 m is left
POST = {"kind": "cylinder", "center": [8.0, 12.0], "radius": 2.0}
ROOM = {"kind": "box", "low": [20.0, 3.0, 2.0], "high": [26.0, 9.0, 8.0]}


def walled(*obstacles: dict[str, Any], **overrides: Any) -> Scenario:
    base = {
        "arena": {"size": [30, 24, 12], "obstacles": list(obstacles), "clearance": 0.1},
        "sources": {"positions": [[21, 15, 6]]},
        "team": {"n_uavs": 2, "starts": [[3, 3, 3], [5, 6, 3]]},
    }
    return load_scenario("rate-60x60x30", **(base | overrides))


def passage(*obstacles: dict[str, Any]) -> Passage:
    return Passage(Briefing.of(walled(*obstacles), 0, 1, np.array([3.0, 3.0, 3.0])))


def route(way: Passage, position: np.ndarray, goal: np.ndarray) -> list[np.ndarray]:
    """The places flown to one after the other, until the goal is reached or nothing moves."""
    places = [position]
    for _ in range(50):
        following = way.towards(places[-1], goal)
        if np.allclose(following, places[-1]):
            break
        assert way.clear(places[-1], following)
        places.append(following)
    return places


def test_without_obstacles_every_way_is_straight() -> None:
    way, goal = passage(), np.array([20.0, 1.0, 2.0])
    assert way.towards(np.zeros(3), goal) is goal
    np.testing.assert_array_equal(way.reach(np.zeros(3), 2.0, 7), np.full(27, 7))
    assert way.free(np.zeros((3, 3))).all()


def test_the_way_around_a_wall_is_the_shortest() -> None:
    way, start, goal = passage(WALL), np.array([10.0, 4.0, 6.0]), np.array([20.0, 4.0, 6.0])
    places = route(way, start, goal)
    assert places[-1] is goal
    length = sum(np.linalg.norm(b - a) for a, b in itertools.pairwise(places))
    corners = np.array([[10.0, 4.0], [13.9, 18.1], [16.1, 18.1], [20.0, 4.0]])
    best = np.linalg.norm(np.diff(corners, axis=0), axis=1).sum()
    assert best <= length < 1.08 * best  # the lattice's places are about 1 m apart, and its steps have 26 directions


def test_a_goal_in_an_obstacle_is_approached() -> None:
    way, goal = passage(WALL, ROOM), np.array([23.0, 6.0, 5.0])
    places = route(way, np.array([3.0, 3.0, 3.0]), goal)
    assert len(places) > 2
    assert np.linalg.norm(places[-1] - goal) < 5.0
    assert way.free(np.array(places)).all()


def test_where_there_is_no_way_it_stays() -> None:
    shut = WALL | {"high": [16.0, 24.0, 12.0]}
    start = np.array([3.0, 3.0, 3.0])
    np.testing.assert_array_equal(passage(shut).towards(start, np.array([20.0, 3.0, 3.0])), start)


@pytest.mark.parametrize("hop", [1.0, 2.0])
def test_reach_is_what_the_arena_says_hop_by_hop(hop: float) -> None:
    way, rng = passage(WALL, POST, ROOM), np.random.default_rng(0)
    arena = walled(WALL, POST, ROOM).arena
    for place in rng.uniform(0.0, arena.size, (60, 3)).round():
        if not arena.is_free(place):
            continue
        reach = way.reach(place, hop, 5)
        assert reach[-1] == 5
        for k, direction in enumerate(HOP_DIRECTIONS):
            ends = place + hop * direction * np.arange(1, 6)[:, None]
            clear = arena.clear_from(place, ends)
            assert reach[k] == (5 if clear.all() else clear.argmin())


POLICIES: list[tuple[str, dict[str, Any]]] = [
    ("muc-osl", {}),
    ("col-inf", {}),
    ("infotaxis", {}),
    ("space-aware-infotaxis", {}),
    ("team-infotaxis", {}),
    ("lawnmower", {}),
    ("random-walk", {}),
    ("surge-cast", {}),
]


@pytest.mark.parametrize(("name", "parameters"), POLICIES)
def test_policies_do_not_fly_into_obstacles(name: str, parameters: dict[str, Any]) -> None:
    scenario = walled(WALL, POST, ROOM, wind={"velocity": [-0.5, -0.2, 0.0]})
    tracks: list[np.ndarray] = []
    worlds: list[World] = []

    def watch(world: World) -> None:
        worlds[:] = [world]
        tracks.append(world.motion["position"].copy())

    fly(make_policy(name, **parameters), scenario, [3, 4], max_decisions=60, watch=watch)
    assert worlds[0].ledger["collisions"].sum() == 0
    assert scenario.arena.free(np.array(tracks).reshape(-1, 3)).all()
    assert np.ptp(np.array(tracks), axis=0).max() > 3.0


@pytest.mark.parametrize("name", ["lawnmower", "surge-cast", "team-infotaxis"])
def test_searchers_get_behind_a_wall_and_find(name: str) -> None:
    scenario = walled(WALL, POST, wind={"velocity": [0.0, -0.7, 0.0]}, plume={"source_strength": 8.0})
    found = 0
    for seed in range(3):
        worlds: list[World] = []
        fly(make_policy(name), scenario, [seed], watch=worlds.append)
        found += int(worlds[-1].episode["outcome"][0] == 1)
        assert worlds[-1].ledger["collisions"].sum() == 0
    assert found >= 2
