"""Spiral surge, biased random walk and moth: the shapes they fly, what they do at a hit, and that they find sources."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from baselines import Briefing, Policy, make_policy
from baselines.biased_random_walk import BiasedRandomWalk
from baselines.biased_random_walk import direction as direction_of
from baselines.moth import circles, sweeps, zigzag
from baselines.reactive import Verdict, pieces
from baselines.spiral_surge import spiral
from osl_env import Scenario, load_scenario
from osl_env.actions import Velocity, Waypoint
from osl_env.observation import Observation
from osl_env.parameters import FloatArray
from osl_env.radio import Message
from osl_env.world import World
from training.flight import fly, run_batch

NAMES = ["spiral-surge", "biased-random-walk", "moth"]
UPWIND, ACROSS = np.array([-1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0])


def robot(**overrides: Any) -> Scenario:
    """A robot on the ground, 10 x 8 m, 0.2 m/s, ten decisions a second."""
    settings: dict[str, Any] = {
        "arena.size": (10.0, 8.0, 0.5),
        "sources.positions": [[1.0, 4.0, 0.1]],
        "team": {"n_uavs": 1, "starts": [[6.0, 4.0, 0.1]]},
        "gas_sensor": {"kind": "ideal", "threshold": 0.01},
        "vehicle": {"kind": "point_mass", "speed": 0.2, "planar": True},
        "ending": {"success": "reach", "success_radius": 0.2},
    }
    return load_scenario("tunnel-a", **(settings | overrides))


class Hand:
    """A policy in a world without physics: the robot moves exactly as it is told, and smells what the test says."""

    def __init__(self, name: str, scenario: Scenario | None = None, **parameters: Any) -> None:
        self.scenario = robot() if scenario is None else scenario
        world = World(self.scenario)
        world.reset([3])
        self.policy: Policy = make_policy(name, **parameters)
        self.briefing = Briefing.of(self.scenario, 0, 3, world.motion["position"][0, 0])
        self.policy.reset(self.briefing)
        self.seen: Observation = world.observation(0, 0)
        self.seen.position = np.array(self.briefing.start)
        self.seen.time, self.seen.sampling_time = 0.0, self.briefing.decision_period
        self.seen.wind = np.array([0.5, 0.0, 0.0])

    def fly(self, decisions: int, reading: float = 0.0, inbox: tuple[Message, ...] = ()) -> FloatArray:
        """(decisions + 1, 3) m: the places on the way, the first included."""
        track = [self.seen.position.copy()]
        for _ in range(decisions):
            self.seen.reading = reading
            action = self.policy.act(self.seen, inbox)
            if isinstance(action, Velocity):
                self.seen.position = self.seen.position + action.velocity * self.briefing.decision_period
                self.seen.time += self.briefing.decision_period
            elif isinstance(action, Waypoint):
                self.seen.position = action.position.copy()
                self.seen.time += 5.0
            track.append(self.seen.position.copy())
        return np.array(track)

    def fly_until(self, mode: str, most: int = 5000) -> FloatArray:
        """As `fly`, in clean air, until the policy is in `mode`."""
        track = [self.seen.position.copy()]
        for _ in range(most):
            track.append(self.fly(1)[-1])
            if self.policy.mode == mode:
                return np.array(track)
        raise AssertionError(f"never in {mode}")


@pytest.mark.parametrize("gap", [0.2, 3.0])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_the_arms_of_a_spiral_are_a_gap_apart(gap: float, sense: float) -> None:
    places = spiral(np.array([1.0, 2.0, 3.0]), gap, 5.0, phase=0.7, sense=sense) - [1.0, 2.0, 3.0]
    radius = np.hypot(places[:, 0], places[:, 1])
    turned = sense * np.unwrap(np.arctan2(places[:, 1], places[:, 0]))
    outside = slice(10, None)  # the first places are far apart in angle: the unwrapped turn is right from any on
    assert np.allclose(np.polyfit(turned[outside], radius[outside], 1)[0] * 2.0 * math.pi, gap, rtol=1e-6)
    assert radius[-1] == pytest.approx(5.0 * gap, rel=0.01)
    steps = np.linalg.norm(np.diff(places[3:], axis=0), axis=1)
    assert np.allclose(steps, gap / 3.0, rtol=0.05)  # chords of arcs of gap / 3, off the first turn's bend
    assert np.ptp(places[:, 2]) == 0.0


def test_a_zigzag_grows_and_goes_upwind() -> None:
    corners = zigzag(0.5, 1.5, 5, math.radians(80.0), 0.4, UPWIND, ACROSS)
    aside, forward = corners @ ACROSS, corners @ UPWIND
    np.testing.assert_allclose(aside[1:], 0.5 * 1.5 ** np.arange(5) * [1, -1, 1, -1, 1])
    legs = np.diff(corners, axis=0)
    np.testing.assert_allclose(np.abs(legs @ ACROSS) / (legs @ UPWIND), math.tan(math.radians(80.0)))
    assert (np.diff(forward) > 0.0).all()
    np.testing.assert_allclose(corners[1:, 2], 0.4 * np.abs(aside[1:]) * [1, 1, -1, -1, 1])
    crosswind = zigzag(0.5, 1.5, 3, math.pi / 2, 0.0, UPWIND, ACROSS)
    np.testing.assert_allclose(crosswind @ UPWIND, 0.0, atol=1e-15)


def test_loops_are_circles_through_the_same_place() -> None:
    corners = circles(0.5, 2.0, 3, 0.0, UPWIND, ACROSS)
    assert corners.shape == (37, 3)
    for k in range(3):
        loop = corners[12 * k + 1 : 12 * k + 13]
        centre = ACROSS * 0.5 * 2.0**k * (1 if k % 2 == 0 else -1)
        np.testing.assert_allclose(np.linalg.norm(loop - centre, axis=1), 0.5 * 2.0**k)
        np.testing.assert_allclose(loop[-1], 0.0, atol=1e-12)
        assert loop[0] @ UPWIND > 0.0


@pytest.mark.parametrize("bearing", [0.0, 0.6, 2.0, 4.0])
def test_sweeps_cross_the_floor_from_bound_to_bound(bearing: float) -> None:
    """Every place that is upwind of the first line lies within half a spacing of a line."""
    area = np.array([10.0, 8.0, 3.0])
    upwind = np.array([math.cos(bearing), math.sin(bearing), 0.0])
    begin = area / 2.0 - 1.0 * upwind
    lines = sweeps(area, begin, upwind, 1.5, 1.0)
    for line in lines:
        assert ((line[:, :2] >= -1e-9) & (line[:, :2] <= area[:2] + 1e-9)).all()
        assert abs((line[1] - line[0]) @ upwind) < 1e-9
    assert np.allclose(np.diff([line[0] @ upwind for line in lines]), 1.5)
    places = np.random.default_rng(0).uniform(0.0, area, (300, 3))
    ahead = places[(places - begin) @ upwind > 0.0] @ upwind
    assert np.abs(ahead[:, None] - np.array([line[0] @ upwind for line in lines])).min(axis=1).max() <= 1.5


def test_pieces_keep_to_the_line() -> None:
    path = pieces(np.array([[0.0, 0, 0], [1, 0, 0], [1, 0.25, 0], [1, 0.25, 0]]), 0.3)
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() <= 0.3
    assert path[-1].tolist() == [1.0, 0.25, 0.0]
    assert [1.0, 0.0, 0.0] in path.tolist()
    assert pieces(np.zeros((1, 3)), 0.3).shape == (0, 3)


@pytest.mark.parametrize(("name", "length"), [("spiral-surge", "step_size"), ("moth", "surge_length")])
def test_a_surge_goes_upwind_by_its_length_after_the_last_hit(name: str, length: str) -> None:
    hand = Hand(name, **{length: 0.8})
    hand.fly(20)
    hand.fly(1, reading=1.0)
    first = hand.seen.position.copy()
    hand.fly(10)
    hand.fly(1, reading=1.0)  # the distance begins anew
    again = hand.seen.position.copy()
    assert hand.policy.mode == "surge"
    track = hand.fly_until("cast" if name == "spiral-surge" else "zigzag")
    np.testing.assert_allclose(track[:-1, 1], first[1], atol=1e-12)
    # a decision moves 0.02 m: the surge stops in the one in which its length is reached
    assert again[0] - track[-2, 0] == pytest.approx(0.8 - 0.02, abs=0.02 + 1e-9)


def test_a_spiral_surge_keeps_its_direction_and_a_moth_turns_with_the_wind() -> None:
    for name, turned in (("spiral-surge", False), ("moth", True)):
        hand = Hand(name, wind_time=0.0)
        hand.fly(5)
        hand.fly(1, reading=1.0)
        hand.seen.wind = np.array([0.0, 0.5, 0.0])
        way = np.diff(hand.fly(2, reading=1.0), axis=0)
        np.testing.assert_allclose(way / 0.02, [[0, -1, 0] if turned else [-1, 0, 0]] * 2, atol=1e-12)


def test_a_spiral_surge_casts_on_a_narrow_spiral_and_then_finds_the_plume_anew() -> None:
    hand = Hand("spiral-surge", spiral_gap2=0.4, step_size=0.5)
    hand.fly(1, reading=1.0)
    hand.fly_until("cast")
    centre = hand.seen.position.copy()
    radius = np.linalg.norm(hand.fly_until("search") - centre, axis=1)
    assert radius.max() == pytest.approx(3 * 0.4, abs=0.1)  # three turns
    timed = Hand("spiral-surge", spiral_gap2=0.4, step_size=0.5, cast_time=9.0)
    timed.fly(1, reading=1.0)
    timed.fly_until("cast")
    assert len(timed.fly_until("search")) * 0.1 == pytest.approx(9.0, abs=0.3)


@pytest.mark.parametrize(("name", "lost"), [("spiral-surge", "cast"), ("moth", "zigzag")])
@pytest.mark.parametrize("success", ["declare", "reach"])
def test_surges_that_end_at_one_place_declare_by_their_count(name: str, lost: str, success: str) -> None:
    hand = Hand(name, robot(ending={"success": success}), source_count=2)
    place = np.array(hand.briefing.start)
    for _ in range(3):
        assert hand.policy.declaration() is None
        hand.seen.position = place.copy()
        hand.fly(1, reading=1e-1)
        hand.fly_until(lost)
    declared = hand.policy.declaration()
    assert (declared is not None) == (success == "declare")
    assert declared is None or np.allclose(declared, place)
    apart = Hand(name, robot(ending={"success": success}), source_count=2)
    for k in range(6):
        apart.seen.position = place - [0.5 * k, 0.0, 0.0]
        apart.fly(1, reading=1e-1)
        apart.fly_until(lost)
        assert apart.policy.declaration() is None


def test_attraction_is_heard_only_if_it_is_asked_for() -> None:
    there = np.array([3.0, 6.0, 0.1])
    loud, faint = (Message(1, 0.0, there, reading, 0.1, b"") for reading in (1.0, 0.0))
    for attraction, message, mode in ((False, loud, "search"), (True, faint, "search"), (True, loud, "cast")):
        hand = Hand("spiral-surge", attraction=attraction)
        hand.fly(1, inbox=(message,))
        assert hand.policy.mode == mode
    distance = np.linalg.norm(hand.fly(200) - there, axis=1)
    assert distance.min() < 0.5


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_moth_zigzags_first_to_the_side_to_which_it_moved_when_it_came_into_the_plume(side: float) -> None:
    hand = Hand("moth", surge_length=0.2, zigzag_length=0.3)
    for k in range(50):
        hand.seen.position = np.array([6.0, 4.0 + side * 0.02 * k, 0.1])
        hand.fly(1)
    hand.fly(1, reading=1.0)
    hand.fly_until("zigzag")
    lost = hand.seen.position.copy()
    assert (hand.fly(8)[-1, 1] - lost[1]) * side > 0.1
    aside = (hand.fly_until("loop")[:, 1] - lost[1]) * side
    assert aside.max() == pytest.approx(0.3 * 1.5**4, abs=0.1)
    assert aside.min() == pytest.approx(-0.3 * 1.5**3, abs=0.1)
    hand.fly_until("search")


def test_a_biased_walk_turns_little_and_runs_far_while_it_smells_more_and_the_other_way_round() -> None:
    hand = Hand(
        "biased-random-walk",
        robot(**{"arena.size": (400.0, 400.0, 0.5), "team": {"n_uavs": 1, "starts": [[200.0, 200.0, 0.1]]}}),
        long_run=0.3,
        short_run=0.1,
        small_turn=0.1,
    )
    walk = hand.policy._walk  # type: ignore[attr-defined]
    runs: dict[str, list[tuple[float, float]]] = {"run": [], "tumble": []}
    for trend in (1.0, -1.0):
        heading, goal = 0.0, walk._goal
        for k in range(2000):
            place = hand.seen.position.copy()
            hand.fly(1, reading=5.0 + trend * 1e-3 * k)
            if walk._goal is not goal:
                if k > 100:  # the runs of the trend before, and the first of this one, are over
                    assert walk.mode == ("run" if trend > 0.0 else "tumble")
                    runs[walk.mode].append((walk._heading[0] - heading, float(np.linalg.norm(walk._goal - place))))
                heading, goal = walk._heading[0], walk._goal
    (small, long), (large, short) = (np.array(runs[mode]).T for mode in ("run", "tumble"))
    assert np.abs(small).max() <= 0.1 + 1e-12
    assert np.abs(large).max() <= math.pi
    # uniform within pi to either side: the mean square is pi^2 / 3, its standard error 0.3 pi^2 / sqrt n
    assert np.mean(large**2) == pytest.approx(math.pi**2 / 3, abs=4 * 0.3 * math.pi**2 / math.sqrt(len(large)))
    np.testing.assert_allclose(long, 0.3)
    np.testing.assert_allclose(short, 0.1)


def test_a_walk_in_clean_air_roams_and_a_detection_ends_that_run() -> None:
    hand = Hand("biased-random-walk", roaming_run=2.0, long_run=0.4)
    hand.fly(30)
    assert hand.policy.mode == "roam"
    hand.fly(1, reading=1.0)
    assert hand.policy.mode == "run"


def test_directions_have_length_1() -> None:
    for heading in ((0.3, 0.0), (4.0, 1.2), (-2.0, -0.4)):
        assert np.linalg.norm(direction_of(heading)) == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["spiral-surge", "moth"])
def test_without_wind_the_surge_goes_on_the_way_that_brought_the_hit(name: str) -> None:
    hand = Hand(name, wind_time=0.0)
    hand.seen.wind = np.zeros(3)
    for k in range(30):
        hand.seen.position = np.array([5.0 + 0.02 * k, 4.0 + 0.02 * k, 0.1])
        hand.fly(1)
    hand.seen.position = np.array([5.6, 4.6, 0.1])
    way = np.diff(hand.fly(1, reading=1.0), axis=0)[0]
    np.testing.assert_allclose(way / np.linalg.norm(way), [math.sqrt(0.5), math.sqrt(0.5), 0.0], atol=0.05)
    at_once = Hand(name)  # a hit before anything has moved, without wind: a defined direction
    at_once.seen.wind = np.zeros(3)
    assert np.isfinite(at_once.fly(3, reading=1.0)).all()


def test_a_verdict_gathers_short_samples_until_they_last_long_enough() -> None:
    scenario = load_scenario("tunnel-a")
    hand = Hand("moth", scenario)
    verdict = Verdict(BiasedRandomWalk(), hand.briefing)
    hand.seen.reading, hand.seen.sampling_time = 1000.0, 0.1
    declared = 0
    while verdict.declared is None and declared < 200:
        verdict.take(hand.seen)
        declared += 1
    assert declared * 0.1 == pytest.approx(8.0, abs=0.5)  # declare_time, to a block
    assert verdict.suspects
    silent = Verdict(BiasedRandomWalk(), Hand("moth").briefing)  # nothing to declare
    for _ in range(200):
        silent.take(hand.seen)
    assert not silent.suspects
    assert silent.declared is None


def flying(action: str) -> Scenario:
    """30 x 24 x 12 m, hits, two UAVs, in legs or with velocities."""
    settings: dict[str, Any] = {"arena": {"size": [30, 24, 12]}, "sources": {"positions": [[21, 15, 6]]},
                                "team": {"n_uavs": 2, "starts": [[3, 3, 3], [8, 3, 3]]}}  # fmt: skip
    if action == "velocity":
        settings |= {"vehicle": {"kind": "point_mass", "speed": 1.0}, "action": "velocity"}
    return load_scenario("rate-60x60x30", **settings)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("action", ["leg", "velocity"])
@pytest.mark.parametrize("wind", [(0.0, -1.0, 0.0), (0.0, 0.0, 0.0), (0.6, 0.8, 0.0)])
def test_stays_inside_and_is_a_function_of_the_seed(name: str, action: str, wind: tuple[float, ...]) -> None:
    tracks = []
    for _ in range(2):
        track: list[FloatArray] = []
        fly(
            make_policy(name),
            flying(action).override(wind={"velocity": wind}),
            [6],
            max_decisions=60 if action == "leg" else 300,
            watch=lambda world, track=track: track.append(world.motion["position"].copy()),
        )
        tracks.append(np.array(track))
    np.testing.assert_array_equal(tracks[0], tracks[1])
    assert (tracks[0] >= 0.0).all()
    assert (tracks[0] <= [30, 24, 12]).all()
    assert np.ptp(tracks[0], axis=0).max() > 3.0
    assert np.ptp(tracks[0][..., 2]) > 0.5  # the third dimension is searched too


@pytest.mark.parametrize("name", NAMES)
def test_a_robot_stays_on_the_ground(name: str) -> None:
    hand = Hand(name)
    for reading in (0.0, 1.0, 0.0, 0.3, 0.0):
        assert np.ptp(hand.fly(150, reading=reading)[:, 2]) == 0.0


@pytest.mark.parametrize("name", NAMES)
def test_finds_the_source_of_a_steady_plume_more_often_than_a_random_walk(name: str) -> None:
    """24 x 12 x 4 m, a steady plume along x, beside which it starts; legs for both."""
    steady = load_scenario(
        "rate-60x60x30",
        **{
            "arena.size": (24.0, 12.0, 4.0),
            "plume": {"kind": "pseudo_gaussian", "release_rate": 0.5},
            "wind.velocity": (0.5, 0.0, 0.0),
            "gas_sensor": {"kind": "ideal", "threshold": 0.01},
            "sources.positions": [[3.0, 6.0, 2.0]],
            "team": {"n_uavs": 1, "starts": [[20.0, 1.0, 1.0]]},
            "ending": {"success": "reach", "success_radius": 1.0, "time_limit": 800.0},
        },
    )
    found = sum(record.success for record in run_batch(make_policy(name), steady, range(8)))
    blind = sum(record.success for record in run_batch(make_policy("random-walk"), steady, range(8)))
    assert found > blind + 2
