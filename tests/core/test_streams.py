"""Streams: one for each (seed, purpose, index), independent of each other, from seeds that are checked."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from osl_env.errors import InputError
from osl_env.numerics import uniform
from osl_env.streams import (
    MAX_SEED,
    Purpose,
    check_seed,
    derive,
    following_seeds,
    generator,
    next_episode_seed,
    policy_seed,
)


def first_draws(seeds: range, purpose: Purpose, index: int) -> Any:
    return np.array([uniform(np.uint64(derive(seed, purpose, index)))[1] for seed in seeds])


def test_no_two_streams_begin_in_the_same_state() -> None:
    keys = list(itertools.product([0, 1, 2, 2**31, 2**62, MAX_SEED], Purpose, range(40)))
    assert len({int(derive(*key)) for key in keys}) == len(keys)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ((Purpose.SENSOR, 0), (Purpose.SENSOR, 1)),
        ((Purpose.SENSOR, 0), (Purpose.RADIO, 0)),
        ((Purpose.WIND, 0), (Purpose.SCENARIO, 0)),
        ((Purpose.SENSOR, 1), (Purpose.ANEMOMETER, 0)),
    ],
)
def test_streams_are_uncorrelated(first: tuple[Purpose, int], second: tuple[Purpose, int]) -> None:
    n = 4000
    correlation = np.corrcoef(first_draws(range(n), *first), first_draws(range(n), *second))[0, 1]
    assert abs(correlation) < 5 / np.sqrt(n)  # 5 standard errors


def test_neighbouring_seeds_give_uncorrelated_episodes() -> None:
    n = 4000
    draws = first_draws(range(n + 1), Purpose.SENSOR, 0)
    assert abs(np.corrcoef(draws[1:], draws[:-1])[0, 1]) < 5 / np.sqrt(n)
    assert abs(draws.mean() - 0.5) < 5 * np.sqrt(1 / 12 / n)


@pytest.mark.parametrize("seed", [-1, 2**63, 1.0, "1", True, None, np.float64(3)])
def test_bad_seeds_are_refused_in_one_line(seed: Any) -> None:
    with pytest.raises(InputError, match=r"^seed = .*must be an integer from 0 to 9223372036854775807$"):
        check_seed(seed)


@pytest.mark.parametrize("seed", [0, MAX_SEED, np.int64(7), np.uint64(7)])
def test_good_seeds_become_python_integers(seed: Any) -> None:
    assert type(check_seed(seed)) is int
    assert check_seed(seed) == int(seed)


def test_following_seeds_are_valid_and_differ() -> None:
    seeds = following_seeds(np.arange(1000))
    assert len(set(seeds.tolist())) == 1000
    assert seeds.min() >= 0
    assert seeds.tolist() == [int(next_episode_seed(k)) for k in range(1000)]


def test_policies_of_a_team_get_seeds_of_their_own() -> None:
    seeds = [policy_seed(episode, uav) for episode in range(50) for uav in range(8)]
    assert len(set(seeds)) == len(seeds)
    assert all(0 <= seed <= MAX_SEED for seed in seeds)


def test_numpy_generators_follow_the_same_keys() -> None:
    first, again, other = (generator(3, Purpose.RENDER, index).random(4) for index in (0, 0, 1))
    assert first.tolist() == again.tolist()
    assert first.tolist() != other.tolist()
