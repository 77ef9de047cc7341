"""Infotaxis and space-aware infotaxis: whole searches, what they choose, and what they may know."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from baselines import make_policy
from baselines.infotaxis import NeighbourSearch
from baselines.policy import Briefing, Policy
from osl_env import Scenario, load_scenario
from osl_env.actions import HOP_DIRECTIONS, Hop, Hover
from osl_env.observation import Observation
from osl_env.world import World
from training.flight import fly, run_batch

SMALL: dict[str, Any] = {
    "arena": {"size": [24, 18, 12]},
    "sources": {"positions": [[17, 13, 7]]},
    "team": {"n_uavs": 2, "starts": [[3, 3, 3], [8, 3, 3]]},
}
KINDS = [("infotaxis", {}), ("infotaxis", {"belief": "particles", "particles": 200}), ("space-aware-infotaxis", {})]


def small(**overrides: Any) -> Scenario:
    return load_scenario("rate-60x60x30", **(SMALL | overrides))


def begun(policy: Policy, scenario: Scenario) -> Observation:
    """The first observation of UAV 0, with `policy` reset for it."""
    world = World(scenario)
    world.reset([4])
    policy.reset(Briefing.of(scenario, 0, 4, world.motion["position"][0, 0]))
    return world.observation(0, 0)


@pytest.mark.parametrize(("name", "parameters"), KINDS)
def test_finds_a_source(name: str, parameters: dict[str, Any]) -> None:
    records = run_batch(make_policy(name, **parameters), small(), range(3))
    assert sum(record.success for record in records) >= 2


@pytest.mark.parametrize(("name", "parameters"), KINDS)
def test_is_a_function_of_the_seed_and_stays_inside(name: str, parameters: dict[str, Any]) -> None:
    tracks: list[list[np.ndarray]] = []
    for _ in range(2):
        track: list[np.ndarray] = []
        fly(
            make_policy(name, **parameters),
            small(),
            [11],
            max_decisions=15,
            watch=lambda world, track=track: track.append(world.motion["position"].copy()),
        )
        tracks.append(track)
    np.testing.assert_array_equal(tracks[0], tracks[1])
    assert (np.array(tracks[0]) >= 0.0).all()
    assert (np.array(tracks[0]) <= [24, 18, 12]).all()


@pytest.mark.parametrize(("name", "parameters"), KINDS)
def test_the_hidden_source_is_hidden(name: str, parameters: dict[str, Any]) -> None:
    """Move the source, keep the observation: the same action."""
    actions = []
    for place in ([17, 13, 7], [2, 15, 9]):
        policy = make_policy(name, **parameters)
        observation = begun(policy, small(sources={"positions": [place]}))
        observation.reading = 2.0
        actions.append(policy.act(observation, ()))
    assert actions[0] == actions[1]


def test_chooses_the_most_informative_neighbour() -> None:
    policy = make_policy("infotaxis")
    observation = begun(policy, small())
    observation.reading = 1.0
    action = policy.act(observation, ())
    search = policy._search
    assert isinstance(search, NeighbourSearch)
    places = np.concatenate([observation.position + HOP_DIRECTIONS, observation.position[None]])
    information = search.searcher.belief.information(places, (1.0,))[:, 0]
    chosen = len(HOP_DIRECTIONS) if isinstance(action, Hover) else action.direction
    assert information[chosen] == pytest.approx(information.max(), rel=1e-5)


@pytest.mark.parametrize("name", ["infotaxis", "space-aware-infotaxis"])
def test_in_a_corner_only_hops_inside(name: str) -> None:
    policy = make_policy(name, hovering=False)
    scenario = small(team={"n_uavs": 2, "starts": [[0, 0, 0], [24, 18, 12]]})
    observation = begun(policy, scenario)
    action = policy.act(observation, ())
    assert isinstance(action, Hop)
    assert (HOP_DIRECTIONS[action.direction] >= 0.0).all()


@pytest.mark.parametrize(("name", "parameters"), KINDS)
def test_no_wind_and_wrong_plume(name: str, parameters: dict[str, Any]) -> None:
    still = small(wind={"velocity": [0, 0, 0]}, advertised_plume={"source_strength": 5.0})
    flight = fly(make_policy(name, **parameters), still, [1], max_decisions=10)
    belief = flight.team[0][0].belief()
    assert belief is not None
    assert np.isfinite(belief.mean).all()


def test_not_sharing_ignores_what_is_heard() -> None:
    """A UAV that does not share ends with a wider belief than one that does, in the same world."""
    spreads = []
    for sharing in (True, False):
        policy = make_policy("infotaxis", sharing=sharing)
        flight = fly(policy, small(), [2], max_decisions=6)
        belief = flight.team[0][0].belief()
        assert belief is not None
        spreads.append(math.sqrt(np.trace(belief.covariance)))
    assert spreads[0] != spreads[1]
