"""Team infotaxis: whole searches in the conditions that it must bear, its legs, and what it may know."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baselines import make_policy
from baselines.policy import Briefing
from baselines.team_infotaxis import TeamInfotaxis
from osl_env import Scenario, load_scenario
from osl_env.actions import Hover, Waypoint
from osl_env.radio import Message
from osl_env.world import World
from training.flight import fly, run_batch


def small(**overrides: Any) -> Scenario:
    base = {"arena": {"size": [36, 24, 16]}, "sources": {"positions": [[26, 19, 9]]}}
    starts = [[3 + 2 * i, 3, 3] for i in range(8)]
    team = {"team": {"n_uavs": 3, "starts": starts}}
    return load_scenario("rate-60x60x30", **(base | team | overrides))


def begun(scenario: Scenario, uav: int = 0, **parameters: Any) -> tuple[TeamInfotaxis, World]:
    world = World(scenario)
    world.reset([4])
    policy = make_policy("team-infotaxis", **parameters)
    assert isinstance(policy, TeamInfotaxis)
    policy.reset(Briefing.of(scenario, uav, 4, world.motion["position"][0, uav]))
    return policy, world


def test_finds_the_source_every_time() -> None:
    records = run_batch(make_policy("team-infotaxis"), small(), range(4))
    assert [record.success for record in records] == [True] * 4


@pytest.mark.parametrize(
    "overrides",
    [
        {"wind": {"velocity": [0, 0, 0]}},
        {"wind": {"velocity": [0.7, 0.7, 0]}},
        {"radio": {"radius": 0}},
        {"radio": {"radius": 8, "loss": 0.3}},
        {"advertised_plume": {"source_strength": 10.0, "lifetime": 30.0}},
        {"gas_sensor": {"false_positive_rate": 0.01, "miss_probability": 0.2}},
        {"clock": "event"},
        {"arena": {"size": [36, 24, 1]}, "sources": {"positions": [[26, 19, 0.5]]},
         "team": {"n_uavs": 1, "starts": [[3, 3, 0.5]]}},
        {"team": {"n_uavs": 8, "starts": [[3 + 2 * i, 3, 3] for i in range(8)]}},
    ],
)  # fmt: skip
def test_bears_other_conditions(overrides: dict[str, Any]) -> None:
    scenario = small(**overrides)
    track: list[np.ndarray] = []
    flight = fly(
        make_policy("team-infotaxis"),
        scenario,
        [3],
        max_decisions=12,
        watch=lambda world: track.append(world.motion["position"].copy()),
    )
    assert (np.array(track) >= 0.0).all()
    assert (np.array(track) <= np.array(scenario.arena.size)).all()
    belief = flight.team[0][0].belief()
    assert belief is not None
    assert np.isfinite(belief.mean).all()
    assert np.isfinite(belief.covariance).all()


def test_is_a_function_of_the_seed() -> None:
    ends = [fly(make_policy("team-infotaxis"), small(), [8], max_decisions=12).world.motion.copy() for _ in range(2)]
    np.testing.assert_array_equal(ends[0], ends[1])


def test_the_hidden_source_is_hidden() -> None:
    actions = []
    for place in ([26, 19, 9], [3, 20, 2]):
        policy, world = begun(small(sources={"positions": [place]}))
        observation = world.observation(0, 0)
        observation.reading = 2.0
        actions.append(policy.act(observation, ()))
    np.testing.assert_array_equal(actions[0].position, actions[1].position)
    assert actions[0].samples == actions[1].samples


def test_legs_last_as_long_as_asked() -> None:
    """No UAV waits for more than the rounding to whole samples: 2 s a leg at most, whatever the goals."""
    scenario = small()
    flight = fly(make_policy("team-infotaxis"), scenario, [5], max_decisions=10)
    ledger = flight.world.ledger[0]
    assert (ledger["waiting_time"] <= 2.0 * ledger["decisions"]).all()
    assert ledger["search_time"].max() / ledger["decisions"].max() == pytest.approx(6.0, abs=1.5)


def test_the_team_spreads_across_the_wind_before_the_first_detection() -> None:
    """Standing places, by rank, in the order of the UAVs along x (wind along -y), and sent in the frame."""
    scenario, goals = small(), []
    for uav in range(3):
        policy, world = begun(scenario, uav)
        position = world.motion["position"][0]
        world.senses["reading"][:] = 0.0
        world._rows = None
        heard = [Message(j, 1.0, position[j].copy(), 0.0, 1.0, b"") for j in range(3) if j != uav]
        assert policy.broadcast(world.observation(0, uav)) is None
        policy.act(world.observation(0, uav), heard)
        goals.append(np.frombuffer(policy.broadcast(world.observation(0, uav)) or b"", dtype="<f4"))
    assert np.diff([goal[0] for goal in goals]).min() > 5.0


def test_dwells_with_several_samples() -> None:
    policy, world = begun(small())
    observation = world.observation(0, 0)
    observation.reading = 0.0
    actions = []
    for step in range(12):
        action = policy.act(observation, ())
        assert isinstance(action, Waypoint | Hover)
        actions.append(action.samples)
        if isinstance(action, Waypoint):
            observation.position = action.position
        observation.sampling_time, observation.time = float(action.samples), 6.0 * (step + 1)
    assert max(actions) >= 5


def test_what_others_will_sample_is_left_out() -> None:
    """A neighbour heard to mean to sample where this UAV would go makes another place the better goal."""
    goals: list[bytes | None] = []
    for _ in range(2):
        policy, world = begun(small(), patience=0.0)
        observation = world.observation(0, 0)
        observation.reading = 0.0
        payload = b"" if not goals else goals[0]
        where = observation.position.copy() if not goals else np.frombuffer(payload or b"", "<f4").astype(float)
        heard = [Message(1, 1.0, where, 0.0, 0.0, payload)] if payload else []
        policy.act(observation, heard)
        goals.append(policy.broadcast(observation))
    assert goals[0] is not None
    assert goals[0] != goals[1]
