"""Which readings a UAV learns of at a decision: its own, and those that the radio brought. Batched over worlds.

What comes from teammates are the radio's frames and nothing else: who hears whom is read from the world's links, after
`World.exchange`'s rules (a frame is sent by UAVs that decide, arrives after the latency, and is read at the receiver's
next decision). Readings are ordered by the time they were sent, then by UAV, a UAV's own among them. Where every frame
reaches everybody at once and all measure the same wind, all UAVs of a world know the same: there is one listener for
all of them, and what is computed from readings is computed once for the team.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numba import njit

from baselines.belief.likelihood import READING_COLUMNS
from osl_env.observation import Observation
from osl_env.parameters import FloatArray
from osl_env.radio import Message
from osl_env.scenario import Scenario
from osl_env.state import BoolArray, IntArray, StateArray
from osl_env.world import World

_SAME_TIME = 1e-9  # s
_ARRIVAL = READING_COLUMNS  # columns of a waiting frame after those of its reading
_SENDER = READING_COLUMNS + 1


@njit(inline="always", error_model="numpy")
def _write_reading(m: Any, s: Any, clock: float, row: Any) -> None:
    for axis in range(3):
        row[axis] = m.position[axis]
    row[3], row[4], row[5] = s.reading, s.sampling_time, clock


@njit(cache=True, error_model="numpy")
def gather_own(
    motion: StateArray, senses: StateArray, episode: StateArray, mask: BoolArray, rows: FloatArray, count: IntArray
) -> None:
    """Each UAV's own reading, if it decides now, into `rows` (n_worlds, n_uavs, 1, 6)."""
    for e in range(motion.shape[0]):
        for i in range(motion.shape[1]):
            count[e, i] = 0
            if mask[e] and motion[e, i].active and motion[e, i].ready:
                _write_reading(motion[e, i], senses[e, i], episode[e].clock, rows[e, i, 0])
                count[e, i] = 1


@njit(cache=True, error_model="numpy")
def gather_shared(
    motion: StateArray, senses: StateArray, episode: StateArray, mask: BoolArray, rows: FloatArray, count: IntArray
) -> None:
    """The readings of all UAVs that decide now, into `rows` (n_worlds, 1, n_uavs, 6)."""
    for e in range(motion.shape[0]):
        n = 0
        for i in range(motion.shape[1] if mask[e] else 0):
            if motion[e, i].active and motion[e, i].ready:
                _write_reading(motion[e, i], senses[e, i], episode[e].clock, rows[e, 0, n])
                n += 1
        count[e, 0] = n


@njit(cache=True, error_model="numpy")
def gather_heard(
    motion: StateArray,
    senses: StateArray,
    episode: StateArray,
    links: BoolArray,
    latency: float,
    mask: BoolArray,
    waiting: FloatArray,
    n_waiting: IntArray,
    rows: FloatArray,
    count: IntArray,
) -> None:
    """Send frames along `links` (n_worlds, sender, receiver), and hand out those that have arrived.

    `waiting` (n_worlds, n_uavs, capacity, 8) are frames on their way or not yet read, in the order sent; those that
    have arrived at a UAV that decides now go to `rows` (n_worlds, n_uavs, capacity + 1, 6), with its own reading.
    """
    n_worlds, n_uavs = motion.shape
    for e in range(n_worlds):
        clock = episode[e].clock
        for i in range(n_uavs):
            count[e, i] = 0
        for j in range(n_uavs if mask[e] else 0):
            if not (motion[e, j].active and motion[e, j].ready):
                continue
            for i in range(n_uavs):
                if links[e, j, i] and i != j:
                    frame = waiting[e, i, n_waiting[e, i]]
                    _write_reading(motion[e, j], senses[e, j], clock, frame)
                    frame[_ARRIVAL], frame[_SENDER] = clock + latency, float(j)
                    n_waiting[e, i] += 1
        for i in range(n_uavs if mask[e] else 0):
            if motion[e, i].silent:  # what was on its way is never heard
                n_waiting[e, i] = 0
            if motion[e, i].active and motion[e, i].ready:
                count[e, i] = _take(motion[e, i], senses[e, i], waiting[e, i], n_waiting, e, i, clock, rows[e, i])


@njit(inline="always", error_model="numpy")
def _take(m: Any, s: Any, waiting: Any, n_waiting: Any, e: int, i: int, clock: float, rows: Any) -> int:
    """Move what has arrived by `clock` from `waiting` (capacity, 8) to `rows` (capacity + 1, 6), the own reading in its
    place among them; how many rows there are.
    """
    taken, kept = 0, 0
    own_taken = False
    for k in range(n_waiting[e, i]):
        frame = waiting[k]
        if frame[_ARRIVAL] > clock + _SAME_TIME:
            for column in range(_SENDER + 1):
                waiting[kept, column] = frame[column]
            kept += 1
            continue
        if not own_taken and frame[5] >= clock and frame[_SENDER] > i:
            _write_reading(m, s, clock, rows[taken])
            own_taken = True
            taken += 1
        for column in range(READING_COLUMNS):
            rows[taken, column] = frame[column]
        taken += 1
    if not own_taken:
        _write_reading(m, s, clock, rows[taken])
        taken += 1
    n_waiting[e, i] = kept
    return taken


class Readings:
    """What each listener of `n_worlds` worlds learns at a decision: `rows` (n_worlds, n_listeners, capacity, 6) and
    their `count` (n_worlds, n_listeners); columns as in `READING_COLUMNS`. Listeners that do not decide have none.
    """

    def __init__(self, scenario: Scenario, n_worlds: int, source: Literal["own", "heard"]) -> None:
        """`own`: a UAV's own readings alone; `heard`: with those that the radio brings."""
        self._scenario, self._source = scenario, source
        n_uavs, radio = scenario.team.n_uavs, scenario.radio
        at_once = scenario.hears_all and scenario.clock == "barrier" and scenario.anemometer.noise == 0
        self.shared = source == "heard" and at_once
        self.n_listeners = 1 if self.shared else n_uavs
        self._alone = source == "own" or n_uavs == 1 or radio.radius == 0
        capacity = 1 if source == "own" else n_uavs + 1
        self.rows = np.zeros((n_worlds, self.n_listeners, capacity, READING_COLUMNS))
        self.count: IntArray = np.zeros((n_worlds, self.n_listeners), np.int64)
        self._waiting = np.zeros((n_worlds, n_uavs, 0 if self._alone or self.shared else n_uavs, _SENDER + 1))
        self._n_waiting: IntArray = np.zeros((n_worlds, n_uavs), np.int64)

    def reset(self, mask: BoolArray) -> None:
        """Forget what is on its way in the worlds of `mask` (n_worlds,) bool."""
        self._n_waiting[mask] = 0
        self.count[mask] = 0

    def gather(self, world: World, mask: BoolArray) -> None:
        """What is new now in the worlds of `mask` (n_worlds,) bool; nothing in the others."""
        state = (world.motion, world.senses, world.episode)
        if self.shared:
            gather_shared(*state, mask, self.rows, self.count)
        elif self._alone:
            gather_own(*state, mask, self.rows, self.count)
        else:
            self._make_room()
            gather_heard(
                *state, world.links, self._scenario.radio.latency, mask, self._waiting, self._n_waiting, self.rows,
                self.count,
            )  # fmt: skip

    def _make_room(self) -> None:
        """Each UAV may get a frame of each other one now, besides those that wait."""
        n_worlds, n_uavs, capacity, columns = self._waiting.shape
        if int(self._n_waiting.max()) + n_uavs <= capacity:
            return
        wider = np.zeros((n_worlds, n_uavs, 2 * capacity + n_uavs, columns))
        wider[:, :, :capacity] = self._waiting
        self._waiting = wider
        self.rows = np.zeros((n_worlds, n_uavs, wider.shape[2] + 1, READING_COLUMNS))


def heard_rows(observation: Observation, inbox: Sequence[Message], uav: int) -> FloatArray:
    """The same for one UAV, number `uav`, from what its policy is given: (F, 6), ordered as above."""
    readings = [(frame.time, frame.sender, *frame.position, frame.reading, frame.sampling_time) for frame in inbox]
    own = (observation.time, uav, *observation.position, observation.reading, observation.sampling_time)
    rows = np.array(sorted([*readings, own], key=lambda row: (row[0], row[1])), dtype=np.float64)
    return rows[:, [2, 3, 4, 5, 6, 0]]
