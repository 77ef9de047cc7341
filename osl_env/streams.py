"""The only place where random generators are made: one stream per (episode seed, purpose, index).

An episode is a function of (scenario, seed, actions) alone. Each purpose has a stream of its own, so that a policy that
makes a UAV smell more often does not change the wind, and two policies meet the same plume. Streams of UAVs are
told apart by `index`, so that one UAV's early end does not change the draws of another.
"""

from __future__ import annotations

import secrets
from enum import IntEnum

import numpy as np
from numba import njit
from numpy.typing import NDArray

from osl_env.errors import InputError
from osl_env.numerics import GAMMA, mix

MAX_SEED = 2**63 - 1
_EPISODE = 8  # Purpose.EPISODE, for compiled code


class Purpose(IntEnum):
    """What a stream is for. The numbers are part of every published seed: add, never renumber."""

    SCENARIO = 1
    WIND = 2
    PLUME = 3
    SENSOR = 4
    ANEMOMETER = 5
    RADIO = 6
    POLICY = 7
    EPISODE = 8
    RENDER = 9
    RANGE = 10
    FAULT = 11


@njit(cache=True)
def derive(seed: int, purpose: int, index: int) -> np.uint64:
    """The initial state of the stream of `purpose` with `index` in the episode with `seed`, in compiled code."""
    state = mix(np.uint64(seed) + GAMMA)
    state = mix(state ^ (np.uint64(purpose) * GAMMA))
    return mix(state + (np.uint64(index) + np.uint64(1)) * GAMMA)


@njit(cache=True)
def next_episode_seed(seed: int) -> int:
    """The seed of the episode that follows the one with `seed` when an environment is reset without one."""
    return np.int64(derive(seed, _EPISODE, 0) >> np.uint64(1))  # type: ignore[return-value]


@njit(cache=True)
def _following(seeds: NDArray[np.int64], out: NDArray[np.int64]) -> None:
    for k in range(seeds.size):
        out[k] = next_episode_seed(seeds[k])


def following_seeds(seeds: NDArray[np.int64]) -> NDArray[np.int64]:
    """`next_episode_seed` of each of `seeds` (n,), as a fresh array."""
    out = np.empty(len(seeds), dtype=np.int64)
    _following(np.ascontiguousarray(seeds), out)
    return out


def entropy_seed() -> int:
    """A seed from the operating system's entropy, for episodes that nobody has seeded."""
    return secrets.randbits(62)


def check_seed(seed: int) -> int:
    """`seed` if it is an integer in [0, 2^63); InputError otherwise."""
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or not 0 <= int(seed) <= MAX_SEED:
        raise InputError(f"seed = {seed!r}: must be an integer from 0 to {MAX_SEED}")
    return int(seed)


def policy_seed(seed: int, uav: int) -> int:
    """The seed that the policy of UAV `uav` gets in the episode with `seed`."""
    return int(derive(seed, int(Purpose.POLICY), uav) >> np.uint64(1))


def generator(seed: int, purpose: Purpose, index: int = 0) -> np.random.Generator:
    """A numpy generator for Python-side draws (start positions, sources, policies) on the stream named."""
    return np.random.Generator(np.random.PCG64(int(derive(seed, int(purpose), index))))
