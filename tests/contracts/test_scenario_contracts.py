"""What every scenario preset must do."""

from __future__ import annotations

import numpy as np
import pytest
from worlds import begun, differences, fly

import osl_env
from osl_env import load_scenario, scenario_names
from osl_env.configuration import config_folder
from osl_env.plumes.hit_rate import HitRatePlume

NAMES = scenario_names()


def test_there_are_presets_and_their_hashes_differ() -> None:
    assert {"rate-60x60x30", "rate-100x60x30", "rate-100x100x50", "rate-100x200x50"} <= set(NAMES)
    assert len({load_scenario(name).hash for name in NAMES}) == len(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_presets_load_under_the_name_of_their_file(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.description
    assert load_scenario(config_folder() / "scenarios" / f"{name}.yaml") == scenario
    assert load_scenario(scenario) is scenario
    size = name.split("-")[1].split("x")
    if len(size) == 3:
        assert scenario.arena.size == tuple(map(float, size))


@pytest.mark.parametrize("name", NAMES)
def test_presets_fly(name: str) -> None:
    worlds = [begun(load_scenario(name), list(range(6))) for _ in range(2)]
    for world in worlds:
        fly(world, steps=25)
        area = np.array(world.scenario.arena.size)
        for places in (world.motion["position"], world.source_position):
            assert np.all((places >= 0) & (places <= area))
        assert np.all(np.isfinite(world.physical))
        assert np.abs(world.layout.flat(world)).max() <= 1.0
        assert np.all(world.ledger["decisions"][world.running] > 0)
    for env in range(6):
        assert differences(worlds[0], env, worlds[1], env) == []


@pytest.mark.parametrize("name", [name for name in NAMES if name.endswith("-random")])
def test_random_presets_draw_sources_at_their_distance_and_winds_of_the_same_speed(name: str) -> None:
    scenario, fixed = load_scenario(name), load_scenario(name.removesuffix("-random"))
    # places and winds are drawn before the plume develops, and do not hang on it
    world = begun(scenario.override(plume=HitRatePlume().model_dump(), gas_sensor={"kind": "poisson_counter"}),
                  list(range(300)))  # fmt: skip
    places = world.source_position
    gaps = np.linalg.norm(places[:, :, None] - world.motion["position"][:, None], axis=-1)
    assert gaps.min() >= scenario.sources.minimum_distance
    assert len(np.unique(places[:, 0], axis=0)) > 290
    assert scenario.sources.region is not None
    low, high = np.array(scenario.sources.region)
    assert np.all((places >= low) & (places <= high))
    assert all(scenario.arena.is_free(place) for place in places[:, 0])
    # uniform in the region but for the balls around the starts and the obstacles: the mean is near its middle
    middle = (places[:, 0].mean(axis=0) - low) / np.where(high > low, high - low, 1.0)
    assert np.all((np.abs(middle - 0.5) < 0.15) | (high == low))
    winds = world.episode["wind"]
    if scenario.wind.uniform and not scenario.wind.changes:
        np.testing.assert_allclose(np.linalg.norm(winds, axis=1), fixed.wind.speed)
    assert scenario.arena == fixed.arena


@pytest.mark.parametrize("name", NAMES)
def test_presets_open_in_every_view(name: str) -> None:
    parallel = osl_env.parallel_env(name)
    observations, _ = parallel.reset(seed=1)
    parallel.step({agent: parallel.action_space(agent).sample() for agent in parallel.agents})
    vector = osl_env.make_vec(name, 2)
    seen, _ = vector.reset(seed=1)
    assert np.array_equal(seen[0], np.concatenate(list(observations.values())))
