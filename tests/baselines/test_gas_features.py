"""Observation features in worlds with gas, obstacles and range sensors: bank and lone UAV agree."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from worlds import advance, begun, random_commands

from baselines import Briefing
from baselines.features import (
    BeliefFeatures,
    FeatureBank,
    HitsFeatures,
    RawFeatures,
    SoloFeatures,
    TeamFeatures,
    make_spec,
    spec_names,
)
from osl_env import Scenario, load_scenario

GAS: list[Any] = [RawFeatures(neighbours=4), HitsFeatures(length=3), TeamFeatures(slots=4)]
FAULTS = {"sensor_faults": [{"uav": 0, "kind": "bias", "start": 4.0, "magnitude": 3.0}]}
CASES: dict[str, tuple[list[Any], Scenario]] = {
    "filaments": (
        [*GAS, BeliefFeatures(particles=32)],
        load_scenario("gaden-60x60x30", **FAULTS, **{"plume.development": 5.0}),
    ),
    "robots": (GAS, load_scenario("arena-4x6-5", **FAULTS, **{"team.n_uavs": 3, "plume.development": 2.0})),
    "robots that all hear": (
        GAS,
        load_scenario("arena-4x6-5", **{"team.n_uavs": 3, "plume.development": 2.0, "radio.radius": 1e3}),
    ),
    "many rays": (
        GAS,
        load_scenario("arena-4x6-5", **{"team.n_uavs": 2, "plume.development": 0.0, "range_sensors.count": 30}),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_a_lone_uav_observes_what_the_bank_shows(name: str) -> None:
    features, scenario = CASES[name]
    spec, rng = make_spec(features), np.random.default_rng(5)
    world, bank = begun(scenario, [3, 2**40]), FeatureBank(spec, scenario, 2)
    bank.reset()
    briefings = [
        [Briefing.of(scenario, i, int(world.episode["seed"][env]), place) for i, place in enumerate(places)]
        for env, places in enumerate(world.motion["position"])
    ]
    solos = [[SoloFeatures(spec, briefing) for briefing in team] for team in briefings]
    for _ in range(12):
        rows = bank.update(world)
        assert np.abs(rows).max() <= 1.0
        inboxes = world.exchange([[None] * world.n_uavs] * 2)
        for env in range(2):
            for uav in range(world.n_uavs):
                row = solos[env][uav].update(world.observation(env, uav), inboxes[env][uav])
                different = [n for n, a, b in zip(spec_names(spec), row, rows[env, uav], strict=True) if a != b]
                assert not different
        advance(world, random_commands(world, rng))


def test_the_team_table_holds_teammates_and_no_rays() -> None:
    """What range sensors see, at the end of the flat vector, is never taken for a neighbour."""
    scenario = CASES["many rays"][1]
    world = begun(scenario, 1)
    bank = FeatureBank(make_spec([TeamFeatures(slots=4)]), scenario, 1)
    bank.reset()
    slots = bank.update(world).reshape(2, 4, -1)
    assert not slots[:, 1:].any()
