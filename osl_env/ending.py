"""What ends an episode: declarations, reaching the source, empty batteries, the time limit.

A declared position within `success_radius` of a source is a success, any other a false declaration; either ends the
episode for the team. If several UAVs declare (or reach) in the same step, the one with the least search time of its
own counts. A UAV whose battery is empty terminates, and so does one that runs into an obstacle under the rule `end` or
that a fault strikes down (`osl_env.faults`); one that has used up its time or its decisions is truncated; when none is
left, the episode is over.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from osl_env.parameters import FloatArray
from osl_env.reward import nearest_source
from osl_env.state import ENDED, FALSE_DECLARATION, RUNNING, SUCCESS, BoolArray, IntArray, StateArray
from osl_env.vehicles.legs import charge_leg, is_lost


@njit(error_model="numpy")
def _end_episode(motion: Any, ledger: Any, episode: Any, c: Any, e: int, outcome: int, winner: int) -> None:
    """End world `e`'s episode for all its UAVs; legs in flight are charged up to now."""
    world = episode[e]
    world.outcome = outcome
    world.winner = winner
    world.search_time = ledger[e, winner].search_time
    for i in range(motion.shape[1]):
        m = motion[e, i]
        if not m.active:
            continue
        if not m.ready:
            duration = m.leg_turn + m.leg_flight + m.leg_hover
            if duration > 0.0:
                share = min(1.0, max(0.0, 1.0 - (m.leg_end - world.clock) / duration))
                charge_leg(m, ledger[e, i], c, share)
        m.active = False
        m.terminated = True
        m.truncated = False


@njit(cache=True, error_model="numpy")
def any_declares(actions: IntArray, threshold: int) -> bool:
    """Whether any of `actions` is `threshold` or above, that is, declares."""
    for e in range(actions.shape[0]):
        for i in range(actions.shape[1]):
            if actions[e, i] >= threshold:
                return True
    return False


@njit(cache=True, error_model="numpy")
def own_places(motion: StateArray, actions: IntArray, threshold: int, declarations: FloatArray) -> None:
    """Fill `declarations` (n_envs, n_uavs, 3) with the UAV's own place if its action declares, else with NaN."""
    for e in range(motion.shape[0]):
        for i in range(motion.shape[1]):
            for axis in range(3):
                says = actions[e, i] >= threshold
                declarations[e, i, axis] = motion[e, i].position[axis] if says else math.nan


@njit(cache=True, error_model="numpy")
def judge(
    motion: StateArray,
    ledger: StateArray,
    episode: StateArray,
    constants: StateArray,
    sources: FloatArray,
    declarations: FloatArray,
) -> None:
    """Judge the declared places (n_envs, n_uavs, 3), m, NaN for none; where there is one, the episode ends."""
    c = constants[0]
    for e in range(motion.shape[0]):
        if episode[e].outcome != RUNNING:
            continue
        winner, best = -1, math.inf
        for i in range(motion.shape[1]):
            says = motion[e, i].active and motion[e, i].ready and not math.isnan(declarations[e, i, 0])
            if says and ledger[e, i].search_time < best:
                winner, best = i, ledger[e, i].search_time
        if winner < 0:
            continue
        world = episode[e]
        x, y, z = declarations[e, winner, 0], declarations[e, winner, 1], declarations[e, winner, 2]
        world.declared[0], world.declared[1], world.declared[2] = x, y, z
        world.declaration_error = nearest_source(x, y, z, sources, e)
        outcome = SUCCESS if world.declaration_error <= c.success_radius else FALSE_DECLARATION
        _end_episode(motion, ledger, episode, c, e, outcome, winner)


@njit(cache=True, error_model="numpy")
def end_at_source(
    motion: StateArray,
    ledger: StateArray,
    episode: StateArray,
    constants: StateArray,
    sources: FloatArray,
    stepping: BoolArray,
) -> None:
    """The rule `reach`: end the episodes in which a UAV that decides now is within the success radius of a source."""
    c = constants[0]
    for e in range(motion.shape[0]):
        winner, best = -1, math.inf
        for i in range(motion.shape[1] if stepping[e] else 0):
            m = motion[e, i]
            if not (m.active and m.ready) or is_lost(m, c) or ledger[e, i].search_time >= best:
                continue
            if nearest_source(m.position[0], m.position[1], m.position[2], sources, e) <= c.success_radius:
                winner, best = i, ledger[e, i].search_time
        if winner >= 0:
            _end_episode(motion, ledger, episode, c, e, SUCCESS, winner)


@njit(inline="always", error_model="numpy")
def end_flights(motion: Any, ledger: Any, episode: Any, c: Any, e: int) -> None:
    """After a step of world `e`: who is lost, whose time is up; the episode is over when none is left."""
    flying = False
    for i in range(motion.shape[1]):
        m, book = motion[e, i], ledger[e, i]
        if not m.active:
            continue
        if m.ready:
            m.terminated = is_lost(m, c)
            m.truncated = not m.terminated and (book.search_time >= c.time_limit or book.decisions >= c.max_decisions)
            m.active = not (m.terminated or m.truncated)
        flying = flying or m.active
    if not flying and episode[e].outcome == RUNNING:
        episode[e].outcome = ENDED
