"""Reward: a sum of terms, each of which can be switched off by its weight.

    r_i = time * (search time of this step, s) + energy * (energy of this step, kJ) + detection * [sampled a detection]
          + success * [the team found the source] + false_declaration * [the team declared wrongly]
          + shaping * ( discount * phi(next) - phi(now) ),   phi = -(distance to the nearest source, m), 0 at the end

Every UAV gets the team's terms (success, false declaration) and its own of the others. The shaping is potential-based
(Ng, Harada and Russell 1999): it leaves the optimal policy as it is. It uses the hidden source, so it is a training
aid only: its weight is 0 by default, and evaluation never sets it.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from osl_env.parameters import FloatArray, Parameters, quantity
from osl_env.state import FALSE_DECLARATION, SUCCESS, BoolArray, StateArray


class Reward(Parameters):
    """Weights of the reward's terms."""

    time: float = quantity(-1.0 / 60.0, "1/s")  # per second of the UAV's own search time
    success: float = quantity(20.0, "")
    false_declaration: float = quantity(-20.0, "")
    energy: float = quantity(0.0, "1/kJ")
    detection: float = quantity(0.0, "")
    shaping: float = quantity(0.0, "1/m", ge=0)  # weight of the potential; for training only
    discount: float = quantity(0.99, "", gt=0, le=1)  # of the shaping term: that of the learner


@njit(error_model="numpy")
def nearest_source(x: float, y: float, z: float, sources: Any, e: int) -> float:
    """Distance, m, from (x, y, z) to the nearest of world `e`'s `sources` (n_envs, n_sources, 3)."""
    nearest = math.inf
    for k in range(sources.shape[1]):
        dx, dy, dz = x - sources[e, k, 0], y - sources[e, k, 1], z - sources[e, k, 2]
        nearest = min(nearest, math.sqrt(dx * dx + dy * dy + dz * dz))
    return nearest


@njit(cache=True, error_model="numpy")
def shape(
    motion: StateArray,
    ledger: StateArray,
    constants: StateArray,
    sources: FloatArray,
    stepping: BoolArray,
    rewards: FloatArray,
    is_step: bool,
) -> None:
    """Add the shaping term to `rewards`; after a reset, only note the potential of the worlds in `stepping`."""
    c = constants[0]
    for e in range(motion.shape[0]):
        if not (is_step or stepping[e]):
            continue
        for i in range(motion.shape[1]):
            m, book = motion[e, i], ledger[e, i]
            phi = 0.0
            if not m.terminated:
                phi = -c.reward_shaping * nearest_source(m.position[0], m.position[1], m.position[2], sources, e)
            if is_step and not math.isnan(book.potential):
                reward = c.discount * phi - book.potential
                rewards[e, i] += reward
                book.total_reward += reward
            book.potential = phi if m.active else math.nan  # the last step has been paid: no more after it


@njit(inline="always", error_model="numpy")
def pay(motion: Any, ledger: Any, senses: Any, outcome: int, sampled: bool, c: Any, rewards: Any, e: int) -> None:
    """Write world `e`'s rewards (n_envs, n_uavs) of this step, for every UAV that was flying when it began.

    `sampled`: whether the world flew; if it was ended by a declaration instead, its last samples are old.
    """
    team = 0.0
    if outcome == SUCCESS:
        team = c.reward_success
    elif outcome == FALSE_DECLARATION:
        team = c.reward_false_declaration
    for i in range(motion.shape[1]):
        m, book = motion[e, i], ledger[e, i]
        rewards[e, i] = 0.0
        if book.rewarded_time < 0.0:  # ended before this step
            continue
        reward = team + c.reward_time * (book.search_time - book.rewarded_time)
        reward += c.reward_energy * 1e-3 * (book.spent - book.rewarded_energy)
        if sampled and senses[e, i].fresh and m.ready:
            reward += c.reward_detection
        book.rewarded_time = book.search_time if m.active else -1.0
        book.rewarded_energy = book.spent
        book.total_reward += reward
        rewards[e, i] = reward
