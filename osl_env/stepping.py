"""The kernels of a step: one loop over the worlds of a batch, composed of the models' functions for one UAV or team.

A step is `fly_*` (declarations, legs or periods, clocks), the plume's reading, and `settle` (samples, radio, endings,
rewards). They are compiled once for all scenarios; what a scenario does not use is skipped by branches that never
change.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from osl_env.ending import end_flights
from osl_env.parameters import FloatArray
from osl_env.radio import ContactArray, charge_bytes, send_to_all
from osl_env.reward import pay
from osl_env.sensors import measure_wind, sample, sample_concentration
from osl_env.state import COMPUTING, FLYING_ON, HOVERING, RUNNING, BoolArray, IntArray, StateArray
from osl_env.streams import Purpose, derive

_SENSOR, _ANEMOMETER, _RADIO = int(Purpose.SENSOR), int(Purpose.ANEMOMETER), int(Purpose.RADIO)


@njit(cache=True, error_model="numpy")
def settle(
    motion: StateArray,
    ledger: StateArray,
    senses: StateArray,
    episode: StateArray,
    constants: StateArray,
    stepping: BoolArray,
    winds: FloatArray,
    rates: FloatArray,
    sniffers: StateArray | None,
    response: StateArray | None,
    faults: StateArray | None,
    sampling_time: float,
    talks: bool,
    rewards: FloatArray,
    team: StateArray,
    ends: bool,
) -> None:
    """What follows a flight or a reset: samples; the radio, where a frame reaches all at once (`talks`); and, with
    `ends`, `finish`.

    `winds` (n_envs, n_uavs or 1, 3), m/s. The gas sensor counts at the hit rates `rates` (n_envs, n_uavs), 1/s, or, if
    there are `sniffers` (n_envs, n_uavs), gives what they have averaged. Without sniffers or `faults` the kernel is
    compiled without what concerns them.
    One pass over the state instead of two where nothing has to come between samples and endings.
    """
    n_envs, n_uavs = motion.shape
    c, winds_each = constants[0], winds.shape[1] > 1
    for e in range(n_envs):
        if stepping[e]:
            for i in range(n_uavs):
                s = senses[e, i]
                s.fresh = False
                if motion[e, i].active and motion[e, i].ready:
                    wind = winds[e, i if winds_each else 0]
                    measure_wind(s, c, wind[0], wind[1], wind[2])
                    if sniffers is not None and response is not None:
                        sample_concentration(
                            motion[e, i], s, sniffers[e, i], episode[e], response[0], faults, i, sampling_time
                        )
                    else:
                        sample(motion[e, i], s, episode[e], c, rates[e, i], faults, i, sampling_time)
            if talks:
                send_to_all(motion, ledger, senses, episode[e].clock, c, e)
        if ends:
            _finish_team(motion, ledger, senses, episode, c, stepping, rewards, team, e)


@njit(cache=True, error_model="numpy")
def finish(
    motion: StateArray,
    ledger: StateArray,
    senses: StateArray,
    episode: StateArray,
    constants: StateArray,
    stepping: BoolArray,
    rewards: FloatArray,
    team: StateArray,
) -> None:
    """The end of a step: flights that are over, rewards (n_envs, n_uavs), and what concerns the `team` (n_envs,)."""
    c = constants[0]
    for e in range(motion.shape[0]):
        _finish_team(motion, ledger, senses, episode, c, stepping, rewards, team, e)


@njit(inline="always", error_model="numpy")
def _finish_team(
    motion: Any, ledger: Any, senses: Any, episode: Any, c: Any, stepping: Any, rewards: Any, team: Any, e: int
) -> None:
    if stepping[e]:
        end_flights(motion, ledger, episode, c, e)
    pay(motion, ledger, senses, episode[e].outcome, stepping[e], c, rewards, e)
    total, cut = 0.0, False
    for i in range(motion.shape[1]):
        total += rewards[e, i]
        cut = cut or motion[e, i].truncated
    over = episode[e].outcome != RUNNING
    team[e].reward = total / motion.shape[1]
    team[e].truncated = over and cut and episode[e].winner < 0
    team[e].terminated = over and not team[e].truncated


@njit(cache=True, error_model="numpy")
def begin(
    motion: StateArray,
    ledger: StateArray,
    senses: StateArray,
    heard: StateArray,
    contacts: ContactArray,
    sent: StateArray,
    episode: StateArray,
    constants: StateArray,
    rows: IntArray,
    seeds: IntArray,
    first_hover: float,
) -> None:
    """Clear the state of the worlds `rows` and begin their episodes with a hover of `first_hover` s."""
    c = constants[0]
    for k in range(rows.size):
        e = rows[k]
        world = episode[e]
        world.clock = first_hover
        world.seed = seeds[k]
        world.outcome = RUNNING
        world.winner = -1
        world.search_time = world.declaration_error = np.nan
        for axis in range(3):
            world.declared[axis] = np.nan
        for i in range(motion.shape[1]):
            m, book, s = motion[e, i], ledger[e, i], senses[e, i]
            _begin_motion(m, first_hover)
            _begin_ledger(book, m, c, first_hover)
            s.reading = s.sampling_time = s.sent_time = 0.0
            s.first_detection_time = np.nan
            s.detections = 0
            s.dead = False
            s.gas_stream = derive(seeds[k], _SENSOR, i)
            s.anemometer_stream = derive(seeds[k], _ANEMOMETER, i)
            s.radio_stream = derive(seeds[k], _RADIO, i)
            for n in range(contacts[e, i, 0] if contacts.shape[1] > 0 else 0):
                heard[e, i, contacts[e, i, 1 + n]].known = False
            if contacts.shape[1] > 0:
                contacts[e, i, 0] = 0
            for q in range(sent.shape[2] if sent.shape[1] > 0 else 0):
                sent[e, i, q].known = False


@njit(error_model="numpy")
def _begin_motion(m: Any, first_hover: float) -> None:
    for axis in range(3):
        m.velocity[axis] = m.heading[axis] = 0.0
        m.target[axis] = m.origin[axis] = m.position[axis]
    m.leg_turn = m.leg_flight = m.leg_path = m.leg_flying_energy = m.leg_hovering_energy = 0.0
    m.leg_hover = m.leg_end = first_hover
    m.turns = 0
    m.samples = 1 if first_hover > 0.0 else 0
    m.active = m.ready = True
    m.collided = m.silent = False
    m.fate = FLYING_ON
    m.exhausted = m.terminated = m.truncated = False


@njit(error_model="numpy")
def _begin_ledger(book: Any, m: Any, c: Any, first_hover: float) -> None:
    for kind in range(book.energy.size):
        book.energy[kind] = 0.0
    book.turning_time = book.flying_time = book.waiting_time = book.path = 0.0
    book.hovering_time = book.search_time = first_hover
    book.energy[HOVERING] = min(first_hover * c.hovering_power, c.capacity)
    book.spent = book.energy[HOVERING]
    book.turns = book.flights = book.decisions = book.collisions = book.messages = book.bytes = 0
    book.hovers = m.samples
    book.total_reward = 0.0
    book.rewarded_energy = book.spent
    book.rewarded_time = first_hover
    book.potential = 0.0


@njit(cache=True, error_model="numpy")
def charge_payloads(
    motion: StateArray, ledger: StateArray, constants: StateArray, lengths: IntArray, bits: FloatArray
) -> None:
    """Enter payload bytes and computed bits (n_envs, n_uavs) of the UAVs that decide now; never beyond the battery."""
    c = constants[0]
    talks = c.radius > 0.0 and motion.shape[1] > 1
    for e in range(motion.shape[0]):
        for i in range(motion.shape[1]):
            book = ledger[e, i]
            if not (motion[e, i].active and motion[e, i].ready):
                continue
            cost = min(bits[e, i] * c.joule_per_bit_computed, max(0.0, c.capacity - book.spent))
            book.energy[COMPUTING] += cost
            book.spent += cost
            if talks and lengths[e, i] > 0 and not motion[e, i].silent:
                charge_bytes(book, c, lengths[e, i])
