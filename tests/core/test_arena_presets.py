"""The presets of the swarm paper: who starts where, and in what."""

from __future__ import annotations

import numpy as np
import pytest

from osl_env import load_scenario
from osl_env.world import World

SEEDS = np.arange(4)
ARENAS = ("arena-4x6-0", "arena-4x6-5", "arena-4x6-10", "arena-30x40")
LAYOUTS = tuple(f"arena-4x6-{number}-{layout}" for number in (5, 10) for layout in "bc")


@pytest.mark.parametrize("name", [*ARENAS, *LAYOUTS])
def test_robots_start_downwind_and_one_is_in_the_plume(name: str) -> None:
    """As in the paper, where the plume has been found before the search begins."""
    scenario = load_scenario(name)
    world = World(scenario, len(SEEDS))
    world.reset(SEEDS)
    for env in range(len(SEEDS)):
        starts = np.array(scenario.team.starts[: scenario.team.n_uavs])
        assert starts[:, 0].min() > world.source_position[env, :, 0].max() + 0.7 * scenario.arena.size[0]
        gas = world.surroundings.reading(env, starts)
        assert gas.max() > scenario.gas_sensor.threshold


@pytest.mark.parametrize("name", [*ARENAS, *LAYOUTS])
def test_random_variant_draws_source_starts_and_wind_anew(name: str) -> None:
    world = World(f"{name}-random", len(SEEDS))
    world.reset(SEEDS)
    sources, starts = world.source_position[:, 0], np.asarray(world.motion["position"])
    assert len(np.unique(sources[:, 1])) == len(np.unique(starts[:, 0, 1])) == len(SEEDS)
    assert len(np.unique(world.surroundings.scene.air.frame[:, 0])) > 1
    assert np.all(sources[:, None, 0] + 3.0 < starts[..., 0])
