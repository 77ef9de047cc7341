"""Radio: who hears whom, how late, and what it costs.

At every decision a UAV sends one frame: its position and reading (4 numbers, 16 bytes) and its policy's payload. All
UAVs within `radius` get it after `latency`, unless it is lost (independently for each receiver). Bytes and energy are
charged to the sender whether anybody hears or not, except that a radio of radius 0 is off. One that a fault has
silenced neither sends nor hears. E_T = P_T N_d / r_T (MUC-OSL eq 8). The paper states neither P_T nor r_T: the
defaults are those of a 100 mW, 250 kbit/s telemetry link.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from osl_env.cells import MOST_RUNS, make_cells, runs_near, sort_into_cells
from osl_env.numerics import GAMMA, mix, uniform
from osl_env.parameters import FloatArray, Parameters, quantity
from osl_env.state import COMMUNICATING, BoolArray, StateArray

HEADER_BYTES = 16  # position (3 numbers of 4 bytes), reading and number of samples (2 bytes each)
_SAME_TIME = 1e-9  # s

ContactArray: TypeAlias = NDArray[np.int32]  # (n_envs, receiver, n_uavs): how many senders it has heard, their numbers


class Message(NamedTuple):
    """A frame as its receiver gets it."""

    sender: int  # UAV number
    time: float  # s, mission clock when sent
    position: FloatArray  # (3,) m, of the sender when it sent
    reading: float  # the sender's last sample: hits or concentration
    sampling_time: float  # s, over which its hits were counted
    payload: bytes  # what the sender's policy added


class Radio(Parameters):
    """Range, delay, loss and cost of the team's radio. The default hears everybody at once."""

    radius: float = quantity(math.inf, "m", ge=0, infinite=True)  # communication radius; 0: no radio
    latency: float = quantity(0.0, "s", ge=0, le=60)
    loss: float = quantity(0.0, "", ge=0, lt=1)  # probability that a receiver misses a frame
    power: float = quantity(0.1, "W", ge=0)  # P_T
    bit_rate: float = quantity(250e3, "bit/s", gt=0)  # r_T

    @property
    def reaches_all(self) -> bool:
        """Whether every frame reaches every UAV at once."""
        return math.isinf(self.radius) and self.latency == 0 and self.loss == 0

    @property
    def joule_per_byte(self) -> float:
        """Energy of sending one byte, J (eq 8)."""
        return 8.0 * self.power / self.bit_rate


@njit(inline="always", error_model="numpy")
def charge_bytes(ledger: Any, constants: Any, sent: int) -> None:
    """Enter `sent` bytes into one UAV's ledger; never beyond what the battery holds."""
    ledger.bytes += sent
    cost = min(sent * constants.joule_per_byte_sent, max(0.0, constants.capacity - ledger.spent))
    ledger.energy[COMMUNICATING] += cost
    ledger.spent += cost


@njit(inline="always", error_model="numpy")
def _write_frame(frame: Any, m: Any, s: Any, clock: float) -> None:
    for axis in range(3):
        frame.position[axis] = m.position[axis]
    frame.reading = s.reading
    frame.sampling_time = s.sampling_time
    frame.time = clock
    frame.known = True


@njit(inline="always", error_model="numpy")
def _on_air(m: Any) -> bool:
    """Whether a UAV's radio works: it hears, and sends when it decides."""
    return bool(m.active and not m.silent)


@njit(inline="always", error_model="numpy")
def send_to_all(motion: Any, ledger: Any, senses: Any, clock: float, c: Any, e: int) -> None:
    """Send world `e`'s frames with a radio that reaches everybody at once.

    Nothing is copied: what each sender was and read when it sent is what it is and read, until it sends again.
    """
    for i in range(motion.shape[1]):
        if _on_air(motion[e, i]) and motion[e, i].ready:
            ledger[e, i].messages += 1
            charge_bytes(ledger[e, i], c, c.header_bytes)
            senses[e, i].sent_time = clock


@njit(error_model="numpy")
def _link(m: Any, s: Any, c: Any, own: int, cells: Any, runs: Any, receivers: Any) -> int:
    """Who gets the frame of UAV `own`, into `receivers` (n_uavs,): those in range that do not lose it; their number.

    A receiver's loss is drawn from the frame and its own number alone: it does not matter to it who else is in range.
    """
    x, y, z = m.position[0], m.position[1], m.position[2]
    if c.loss > 0.0:
        s.radio_stream, _ = uniform(s.radio_stream)
    frame, n = mix(s.radio_stream), 0
    for r in range(runs_near(cells, x, y, z, runs)):
        for k in range(runs[r, 0], runs[r, 1]):
            dx, dy, dz = x - cells.places[k, 0], y - cells.places[k, 1], z - cells.places[k, 2]
            j = cells.sorted_names[k]
            reaches = j != own and dx * dx + dy * dy + dz * dz <= c.radius * c.radius
            if reaches and (c.loss == 0.0 or uniform(frame + np.uint64(j) * GAMMA)[1] >= c.loss):
                receivers[n] = j
                n += 1
    return n


@njit(error_model="numpy")
def _sort_hearers(motion: Any, e: int, radius: float, cells: Any) -> None:
    """Sort those of world `e` that hear into `cells`."""
    n = 0
    for i in range(motion.shape[1]):
        if _on_air(motion[e, i]):
            for axis in range(3):
                cells.points[n, axis] = motion[e, i].position[axis]
            cells.names[n] = i
            n += 1
    sort_into_cells(cells, n, radius)


@njit(inline="always", error_model="numpy")
def _entry(heard: Any, contacts: Any, sender: int) -> Any:
    """The entry for frames of `sender` at a receiver with `heard` and `contacts` (n_uavs,): a contact from now on."""
    frame = heard[sender]
    if not frame.known:
        contacts[0] += 1
        contacts[contacts[0]] = sender
    return frame


@njit(cache=True, error_model="numpy")
def send_in_range(
    motion: StateArray,
    ledger: StateArray,
    senses: StateArray,
    episode: StateArray,
    constants: StateArray,
    stepping: BoolArray,
    links: BoolArray,
    heard: StateArray,
    contacts: ContactArray,
    sent: StateArray,
    reach: BoolArray,
    cursor: int,
) -> None:
    """Send the frames of the worlds in `stepping` with a radio of limited radius, with latency or loss.

    `links` (n_envs, sender, receiver): who gets this step's frame. `heard` (n_envs, receiver, sender): the newest
    frame of each sender that has arrived; `contacts` (n_envs, receiver, n_uavs): how many senders these are, then their
    numbers, in no order that means anything. With latency, frames wait in `sent` (n_envs, sender, queue) with their
    receivers in `reach` (n_envs, sender, queue, receiver); `cursor` is the slot of the queue that this step writes.
    """
    n_uavs, c = motion.shape[1], constants[0]
    cells, runs, receivers = make_cells(n_uavs), np.empty((MOST_RUNS, 2), np.int64), np.empty(n_uavs, np.int64)
    for e in range(motion.shape[0]):
        if not stepping[e]:
            continue
        clock = episode[e].clock
        _sort_hearers(motion, e, c.radius, cells)
        for i in range(n_uavs):
            m, s = motion[e, i], senses[e, i]
            links[e, i, :] = False
            sends = _on_air(m) and m.ready
            n = _link(m, s, c, i, cells, runs, receivers) if sends else 0
            if sends:
                ledger[e, i].messages += 1
                charge_bytes(ledger[e, i], c, c.header_bytes)
            for k in range(n):
                j = receivers[k]
                links[e, i, j] = True
                if c.latency == 0.0:
                    _write_frame(_entry(heard[e, j], contacts[e, j], i), m, s, clock)
            if c.latency > 0.0:
                _queue(sent[e, i, cursor], reach[e, i, cursor], links[e, i], m, s, clock, sends)
                _deliver(motion, heard, contacts, sent, reach, e, i, cursor, clock - c.latency)


@njit(inline="always", error_model="numpy")
def _queue(waiting: Any, reach: Any, links: Any, m: Any, s: Any, clock: float, sends: bool) -> None:
    """Let this step's frame wait for its time, with its receivers; if there is none, nothing waits in its slot."""
    waiting.known = False
    if sends:
        reach[:] = links
        _write_frame(waiting, m, s, clock)


@njit(error_model="numpy")
def _deliver(
    motion: Any, heard: Any, contacts: Any, sent: Any, reach: Any, e: int, sender: int, cursor: int, latest: float
) -> None:
    """Give each receiver the frames of `sender` that were sent at or before `latest` and reach it, the oldest first."""
    queue = sent.shape[2]
    for k in range(1, queue + 1):
        q = (cursor + k) % queue
        frame = sent[e, sender, q]
        if not frame.known:
            continue
        if frame.time > latest + _SAME_TIME:
            break
        frame.known = False
        for j in range(heard.shape[1]):
            if reach[e, sender, q, j] and not motion[e, j].silent:
                entry = _entry(heard[e, j], contacts[e, j], sender)
                for axis in range(3):
                    entry.position[axis] = frame.position[axis]
                entry.reading, entry.sampling_time, entry.time = frame.reading, frame.sampling_time, frame.time
                entry.known = True
