"""Random walk, lawnmower and surge-cast: they stay inside, see what they must, and declare only for a reason."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baselines import make_policy
from baselines.lawnmower import survey
from baselines.nearby_declaration import NearbyParameters, NearbyRule
from baselines.policy import Briefing
from osl_env import Scenario, load_scenario
from osl_env.actions import Waypoint
from osl_env.world import World
from training.flight import fly, run_batch

NAMES = ["random-walk", "lawnmower", "surge-cast"]


def small(**overrides: Any) -> Scenario:
    base = {"arena": {"size": [30, 24, 12]}, "sources": {"positions": [[21, 15, 6]]}}
    team = {"team": {"n_uavs": 2, "starts": [[3, 3, 3], [8, 3, 3]]}}
    return load_scenario("rate-60x60x30", **(base | team | overrides))


def begun(scenario: Scenario) -> tuple[Briefing, World]:
    world = World(scenario)
    world.reset([4])
    return Briefing.of(scenario, 0, 4, world.motion["position"][0, 0]), world


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("wind", [(0, -1, 0), (0, 0, 0), (0.6, 0.8, 0)])
def test_stays_inside_and_is_a_function_of_the_seed(name: str, wind: tuple[float, float, float]) -> None:
    tracks = []
    for _ in range(2):
        track: list[np.ndarray] = []
        fly(
            make_policy(name),
            small(wind={"velocity": wind}),
            [6],
            max_decisions=60,
            watch=lambda world, track=track: track.append(world.motion["position"].copy()),
        )
        tracks.append(np.array(track))
    np.testing.assert_array_equal(tracks[0], tracks[1])
    assert (tracks[0] >= 0.0).all()
    assert (tracks[0] <= [30, 24, 12]).all()
    assert np.ptp(tracks[0], axis=0).max() > 3.0  # it moves


@pytest.mark.parametrize(("name", "strength"), [("lawnmower", 10.0), ("surge-cast", 2.5)])
def test_finds_a_source(name: str, strength: float) -> None:
    records = run_batch(make_policy(name), small(plume={"source_strength": strength}), range(5))
    assert sum(record.success for record in records) >= 4


@pytest.mark.parametrize("name", NAMES)
def test_without_a_source_in_reach_nothing_is_declared(name: str) -> None:
    faint = small(plume={"source_strength": 1e-9}, advertised_plume={"source_strength": 2.5})
    records = run_batch(make_policy(name), faint.override(ending={"time_limit": 300}), range(2))
    assert not any(record.success or record.false_declaration for record in records)


@pytest.mark.parametrize("name", NAMES)
def test_the_hidden_source_is_hidden(name: str) -> None:
    actions = []
    for place in ([21, 15, 6], [28, 2, 11]):
        scenario = small(sources={"positions": [place]})
        briefing, world = begun(scenario)
        policy = make_policy(name)
        policy.reset(briefing)
        observation = world.observation(0, 0)
        observation.reading = 0.0
        actions.append(policy.act(observation, ()))
    np.testing.assert_array_equal(np.hstack(actions[0]), np.hstack(actions[1]))


def test_the_lawnmower_visits_its_whole_strip() -> None:
    """Every point of the volume is within half a spacing, per axis, of a stop of exactly one UAV's strip."""
    area, lane, stop = np.array([30.0, 24.0, 12.0]), 6.0, 5.0
    stops = [survey(np.zeros(3), area, uav, 2, lane, stop) for uav in range(2)]
    points = np.random.default_rng(0).uniform(0.0, area, (500, 3))
    near = np.abs(points[:, None] - np.concatenate(stops)[None]) <= [lane / 2 + 1e-9, stop / 2 + 1e-9, lane / 2 + 1e-9]
    assert near.all(axis=2).any(axis=1).all()
    assert stops[0][:, 0].max() < 15.0 < stops[1][:, 0].min()
    legs = np.linalg.norm(np.diff(stops[0], axis=0), axis=1)
    assert legs.max() <= lane + 1e-9  # boustrophedon: from each stop to a next one


def test_the_lawnmower_flies_its_stops_in_order_and_begins_again() -> None:
    briefing, world = begun(small())
    policy = make_policy("lawnmower")
    policy.reset(briefing)
    stops = survey(np.zeros(3), briefing.area, 0, 2, 15.0, 15.0)
    observation = world.observation(0, 0)
    observation.reading, observation.sampling_time = 0.0, 0.0
    flown = []
    for _ in range(len(stops) + 1):
        action = policy.act(observation, ())
        assert isinstance(action, Waypoint)
        flown.append(action.position)
    np.testing.assert_array_equal(flown[:-1], stops)
    assert not np.array_equal(flown[-1], stops[0])  # the second survey is finer


def test_the_nearby_rule_waits_until_it_is_sure() -> None:
    briefing, world = begun(small())
    rule = NearbyRule(NearbyParameters(), briefing)
    observation = world.observation(0, 0)
    observation.sampling_time = 1.0
    counts = []
    for hits in (0.0, 3.0, 2.0, 3.0, 2.0, 1.0, 2.0, 3.0, 2.0):
        observation.reading = hits
        rule.take(observation)
        counts.append(rule.declared is not None)
    assert counts[-1]
    assert not any(counts[:7])
    assert 0.5 < rule.threshold() < 1.0  # 2.5 / 3 m, hardly less straight downwind
    quiet = NearbyRule(NearbyParameters(), briefing)
    for hits in [0.0, 1.0] * 10:  # half a hit a second: a source may be 5 m away, but it is not here
        observation.reading = hits
        quiet.take(observation)
        assert quiet.declared is None


@pytest.mark.parametrize("period", [0.05, 0.1, 1.0])
def test_the_nearby_rule_declares_as_soon_at_any_rate_of_samples(period: float) -> None:
    """A steady smell is declared once `declare_time` of it has been sampled, to within a row and a sample."""
    briefing, world = begun(small())
    rule = NearbyRule(NearbyParameters(), briefing)
    observation = world.observation(0, 0)
    observation.sampling_time, taken = period, 0
    observation.reading = 3.0 * period  # hits: three a second
    while rule.declared is None and taken < 1000:
        rule.take(observation)
        taken += 1
    assert taken * period == pytest.approx(8.0, abs=period)


def test_the_random_walk_keeps_within_its_hop_length() -> None:
    track: list[np.ndarray] = []
    fly(make_policy("random-walk", hop_length=1), small(), [3], max_decisions=20,
        watch=lambda world: track.append(world.motion["position"].copy()))  # fmt: skip
    steps = np.abs(np.diff(np.array(track), axis=0))
    assert steps.max() <= 1.0 + 1e-12


def test_surge_goes_upwind_after_a_hit_and_casts_when_lost() -> None:
    briefing, world = begun(small())
    policy = make_policy("surge-cast")
    policy.reset(briefing)
    observation = world.observation(0, 0)
    observation.position = np.array([15.0, 8.0, 6.0])
    flown = []
    for hits in (1.0, 0.0, 0.0):
        observation.reading, observation.sampling_time = hits, 2.0
        action = policy.act(observation, ())
        assert isinstance(action, Waypoint)
        flown.append(action.position - observation.position)
        observation.position = action.position
    np.testing.assert_allclose(flown[:2], [[0.0, 3.0, 0.0]] * 2, atol=1e-12)  # wind along -y: upwind is +y
    np.testing.assert_allclose(
        np.abs(observation.position - [15.0, 8.0, 6.0]), [3.0, 0.0, 0.0], atol=1e-12
    )  # crosswind
