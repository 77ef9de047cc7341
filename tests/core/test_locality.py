"""A UAV knows only what it may know: a hidden source that moves without changing the readings changes nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from worlds import NOISY, begun, fly, small

import osl_env
from osl_env import Scenario

# the plume is too thin to be smelt anywhere: readings are false counts, the same wherever the source is
THIN: dict[str, Any] = {"plume.source_strength": 1e-15, "gas_sensor.false_positive_rate": 0.4}
PLACES = [(12.345671, 17.654321, 7.123457), (3.141593, 11.718282, 1.414214)]


def hidden(place: tuple[float, float, float], **changes: Any) -> Scenario:
    return small(**THIN, **changes, **{"sources.positions": [place]})


def numbers(value: Any) -> list[float]:
    """All numbers in a nest of dicts, lists and arrays."""
    if isinstance(value, dict):
        return [number for entry in value.values() for number in numbers(entry)]
    if isinstance(value, list | tuple):
        return [number for entry in value for number in numbers(entry)]
    return [float(number) for number in np.ravel(np.asarray(value, dtype=np.float64))]


def shown(scenario: Scenario, observation: str) -> tuple[list[float], list[Any]]:
    """Every number that the parallel view shows in 12 steps, and the rewards."""
    env = osl_env.parallel_env(scenario, observation=observation)
    observations, infos = env.reset(seed=7)
    seen, rewards = numbers([observations, infos, env.state().tolist()]), []
    rng = np.random.default_rng(0)
    for _ in range(12):
        masks = [env.action_mask(agent).tolist() for agent in env.agents]
        actions = {agent: int(rng.integers(0, 53)) for agent in env.agents}
        observations, reward, _, _, infos = env.step(actions)
        seen += numbers([observations, infos, masks, env.state().tolist()])
        rewards.append(reward)
    return seen, rewards


@pytest.mark.parametrize("observation", ["flat", "physical"])
@pytest.mark.parametrize("changes", [{}, NOISY | {"gas_sensor.false_positive_rate": 0.4}, {"clock": "event"}])
def test_moving_the_hidden_source_changes_nothing_that_is_shown(observation: str, changes: dict[str, Any]) -> None:
    first, second = (shown(small(**THIN | changes | {"sources.positions": [p]}), observation) for p in PLACES)
    assert first == second


def test_the_source_is_in_no_number_that_is_shown() -> None:
    """Nor is its direction or distance: looked for as coordinates, normalised coordinates and offsets."""
    place = np.array(PLACES[0])
    scenario = small(**{"sources.positions": [PLACES[0]]})
    secrets = np.concatenate([place, place / 20.0, 2.0 * place / [20.0, 20.0, 10.0] - 1.0])
    for observation in ("flat", "physical"):
        values = np.unique(shown(scenario, observation)[0])
        gaps = np.abs(values[:, None] - secrets[None, :])
        assert gaps.min() > 1e-5


def test_policies_rows_do_not_hold_the_source() -> None:
    worlds = [begun(hidden(place), [5, 6]) for place in PLACES]
    for step in range(15):
        for world in worlds:
            fly(world, seed=step, steps=1)
        assert worlds[0].physical.tobytes() == worlds[1].physical.tobytes()
        assert worlds[0].layout.flat(worlds[0]).tobytes() == worlds[1].layout.flat(worlds[1]).tobytes()


def test_gymnasium_infos_do_not_tell_the_source() -> None:
    shows = []
    for place in PLACES:
        env = osl_env.make_vec(hidden(place), 4)
        observations, infos = env.reset(seed=1)
        seen = numbers([observations, infos])
        env.action_space.seed(0)
        for _ in range(10):
            seen += numbers(list(env.step(env.action_space.sample())))
        shows.append(seen)
    assert shows[0] == shows[1]


def test_shaping_is_off_unless_asked_for() -> None:
    for name in osl_env.scenario_names():
        assert osl_env.load_scenario(name).reward.shaping == 0.0
