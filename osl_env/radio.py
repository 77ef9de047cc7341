"""Radio: who hears whom, how late, and what it costs.

At every decision a UAV sends one frame: its position and reading (4 numbers, 16 bytes) and its policy's payload. All
UAVs within `radius` get it after `latency`, unless it is lost (independently for each receiver). Bytes and energy are
charged to the sender whether anybody hears or not, except that a radio of radius 0 is off. E_T = P_T N_d / r_T
(MUC-OSL eq 8). The paper states neither P_T nor r_T: the defaults are those of a 100 mW, 250 kbit/s telemetry link.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numba import njit

from osl_env.numerics import uniform
from osl_env.parameters import FloatArray, Parameters, quantity
from osl_env.state import COMMUNICATING, BoolArray, StateArray

HEADER_BYTES = 16  # position (3 numbers of 4 bytes), reading and number of samples (2 bytes each)


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
def send_to_all(motion: Any, ledger: Any, senses: Any, clock: float, c: Any, e: int) -> None:
    """Send world `e`'s frames with a radio that reaches everybody at once.

    Nothing is copied: what each sender was and read when it sent is what it is and read, until it sends again.
    """
    for i in range(motion.shape[1]):
        if motion[e, i].active and motion[e, i].ready:
            ledger[e, i].messages += 1
            charge_bytes(ledger[e, i], c, c.header_bytes)
            senses[e, i].sent_time = clock


@njit(inline="always", error_model="numpy")
def _link(m: Any, s: Any, other: Any, c: Any) -> bool:
    """Whether the frame of a sender (motion, senses) gets to `other`: in range, and not lost."""
    dx, dy, dz = m.position[0] - other.position[0], m.position[1] - other.position[1], m.position[2] - other.position[2]
    linked = bool(dx * dx + dy * dy + dz * dz <= c.radius * c.radius)
    if c.loss > 0.0:  # drawn for every pair, so that it does not matter to the others who else is in range
        s.radio_stream, u = uniform(s.radio_stream)
        linked = linked and u >= c.loss
    return linked


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
    sent: StateArray,
    reach: BoolArray,
    cursor: int,
) -> None:
    """Send the frames of the worlds in `stepping` with a radio of limited radius, with latency or loss.

    `links` (n_envs, sender, receiver): who gets this step's frame. `heard` (n_envs, receiver, sender): the newest
    frame of each sender that has arrived. With latency, frames wait in `sent` (n_envs, sender, queue) with their
    receivers in `reach` (n_envs, sender, queue, receiver); `cursor` is the slot of the queue that this step writes.
    """
    n_envs, n_uavs = motion.shape
    c = constants[0]
    for e in range(n_envs):
        if not stepping[e]:
            continue
        clock = episode[e].clock
        for i in range(n_uavs):
            m, s = motion[e, i], senses[e, i]
            sends = m.active and m.ready
            if sends:
                ledger[e, i].messages += 1
                charge_bytes(ledger[e, i], c, c.header_bytes)
            for j in range(n_uavs):
                linked = sends and j != i and _link(m, s, motion[e, j], c) and motion[e, j].active
                links[e, i, j] = linked
                if linked and c.latency == 0.0:
                    _write_frame(heard[e, j, i], m, s, clock)
                if c.latency > 0.0:
                    reach[e, i, cursor, j] = linked
            if c.latency > 0.0:
                sent[e, i, cursor].known = False
                if sends:
                    _write_frame(sent[e, i, cursor], m, s, clock)
                _deliver(heard, sent, reach, e, i, clock - c.latency)


@njit(error_model="numpy")
def _deliver(heard: Any, sent: Any, reach: Any, e: int, sender: int, latest: float) -> None:
    """Give each receiver the newest frame of `sender` that was sent at or before `latest` and reached it."""
    for q in range(sent.shape[2]):
        old = sent[e, sender, q]
        if not old.known or old.time > latest + 1e-9:
            continue
        for j in range(heard.shape[1]):
            frame = heard[e, j, sender]
            if reach[e, sender, q, j] and (not frame.known or frame.time < old.time):
                for axis in range(3):
                    frame.position[axis] = old.position[axis]
                frame.reading = old.reading
                frame.sampling_time = old.sampling_time
                frame.time = old.time
                frame.known = True
