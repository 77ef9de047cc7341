"""The Python side of the radio: carries the policies' payloads along the links that the kernels drew.

Work grows with the links there are: each frame is made once and shared by all who get it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from itertools import compress
from typing import TYPE_CHECKING, Any

import numpy as np

from osl_env.radio import Message
from osl_env.state import BoolArray, IntArray

if TYPE_CHECKING:
    from osl_env.world import World

_SAME_TIME = 1e-9  # s
_FEW = 64  # UAVs


class Mailbox:
    """Frames on their way and not yet read: for each UAV a queue of (arrival time, messages), in the order sent."""

    def __init__(self, latency: float, n_envs: int, n_uavs: int) -> None:
        """`latency` in s."""
        self._latency = latency
        self._waiting = [[deque[tuple[float, list[Message]]]() for _ in range(n_uavs)] for _ in range(n_envs)]

    def clear(self, envs: IntArray) -> None:
        """Forget what is on its way in the worlds `envs`."""
        for env in envs:
            for waiting in self._waiting[env]:
                waiting.clear()

    def exchange(self, world: World, payloads: Sequence[Sequence[bytes | None]]) -> list[list[list[Message]]]:
        """Send this step's frames with `payloads`, and hand out to each ready UAV what has arrived."""
        ready = world.motion["ready"] & world.motion["active"] & world.running[:, None]
        sent = _sent(_frames(world, payloads, ready), world.links & ready[:, :, None])
        hears = (ready if world.faults is None else ready & ~world.motion["silent"]).tolist()
        return [
            [
                self._hand_out(waiting, fresh, clock, listens)
                for waiting, fresh, listens in zip(self._waiting[env], sent, hears[env], strict=False)
            ]
            for env, clock in enumerate(world.episode["clock"].tolist())
        ]

    def _hand_out(
        self, waiting: deque[tuple[float, list[Message]]], fresh: list[Message], clock: float, listens: bool
    ) -> list[Message]:
        """What a UAV reads now, if it `listens`, of what is `waiting` for it and what has been sent now, `fresh`."""
        if listens and not waiting and self._latency == 0.0:
            return fresh
        if fresh:
            waiting.append((clock + self._latency, fresh))
        arrived: list[Message] = []
        while listens and waiting and waiting[0][0] <= clock + _SAME_TIME:
            arrived += waiting.popleft()[1]
        return arrived


def _frames(world: World, payloads: Sequence[Sequence[bytes | None]], ready: BoolArray) -> list[Message | None]:
    """This step's frame of each UAV of each world, one after the other; None of those that are not `ready`."""
    positions = world.motion["position"].copy()
    positions.setflags(write=False)
    frames: list[Message | None] = []
    columns = zip(
        world.episode["clock"].tolist(), positions, ready.tolist(), world.senses["reading"].tolist(),
        world.senses["sampling_time"].tolist(), payloads, strict=True,
    )  # fmt: skip
    for clock, places, sends, readings, times, told in columns:
        for i, payload in enumerate(told):
            frames.append(Message(i, clock, places[i], readings[i], times[i], payload or b"") if sends[i] else None)
    return frames


def _sent(frames: list[Message | None], links: BoolArray) -> Iterator[list[Any]]:
    """The `frames` that each UAV of each world gets along `links` (n_envs, sender, receiver), in the order sent."""
    n_envs, n_uavs, _ = links.shape
    by_receiver = links.transpose(0, 2, 1)
    if n_uavs <= _FEW:  # looking at every pair costs less than finding the links
        flags = by_receiver.tobytes()
        for row in range(n_envs * n_uavs):
            begin = row // n_uavs * n_uavs
            yield list(compress(frames[begin : begin + n_uavs], flags[row * n_uavs : (row + 1) * n_uavs]))
        return
    found = np.flatnonzero(by_receiver)
    ends = np.searchsorted(found, np.arange(n_uavs, links.size + 1, n_uavs)).tolist()
    senders = (found // n_uavs**2 * n_uavs + found % n_uavs).tolist()
    begin = 0
    for end in ends:
        yield [frames[sender] for sender in senders[begin:end]]
        begin = end
