"""The Python side of the radio: carries the policies' payloads along the links that the kernels drew."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from osl_env.radio import Message
from osl_env.state import IntArray

if TYPE_CHECKING:
    from osl_env.world import World

_SAME_TIME = 1e-9  # s


class Mailbox:
    """Frames on their way and not yet read: for each UAV a list of (arrival time, message), in the order sent."""

    def __init__(self, latency: float, n_envs: int, n_uavs: int) -> None:
        """`latency` in s."""
        self._latency = latency
        self._waiting: list[list[list[tuple[float, Message]]]] = [[[] for _ in range(n_uavs)] for _ in range(n_envs)]

    def clear(self, envs: IntArray) -> None:
        """Forget what is on its way in the worlds `envs`."""
        for env in envs:
            for waiting in self._waiting[env]:
                waiting.clear()

    def exchange(self, world: World, payloads: Sequence[Sequence[bytes | None]]) -> list[list[list[Message]]]:
        """Send this step's frames with `payloads`, and hand out to each ready UAV what has arrived."""
        ready = world.motion["ready"] & world.motion["active"] & world.running[:, None]
        links = world.links
        inboxes: list[list[list[Message]]] = []
        for env in range(world.n_envs):
            if not ready[env].any():
                inboxes.append([[] for _ in range(world.n_uavs)])
                continue
            clock = float(world.episode["clock"][env])
            if links[env].any():
                self._send(world, env, clock, payloads[env], ready[env].tolist(), links[env].tolist())
            inboxes.append([self._collect(env, i, clock) if ready[env, i] else [] for i in range(world.n_uavs)])
        return inboxes

    def _send(
        self,
        world: World,
        env: int,
        clock: float,
        payloads: Sequence[bytes | None],
        ready: list[bool],
        pairs: list[list[bool]],
    ) -> None:
        """Put the frames of world `env` on their way along its linked `pairs` [sender][receiver]."""
        senses = world.senses[env]
        readings, times = senses["reading"].tolist(), senses["sampling_time"].tolist()
        positions = world.motion["position"][env].copy()
        positions.setflags(write=False)
        for sender in range(world.n_uavs):
            if not ready[sender]:
                continue
            position = positions[sender]
            message = Message(sender, clock, position, readings[sender], times[sender], payloads[sender] or b"")
            for receiver, linked in enumerate(pairs[sender]):
                if linked:
                    self._waiting[env][receiver].append((clock + self._latency, message))

    def _collect(self, env: int, uav: int, clock: float) -> list[Message]:
        waiting = self._waiting[env][uav]
        if self._latency == 0.0:
            messages = [message for _, message in waiting]
            waiting.clear()
            return messages
        arrived = [message for arrival, message in waiting if arrival <= clock + _SAME_TIME]
        self._waiting[env][uav] = [entry for entry in waiting if entry[0] > clock + _SAME_TIME]
        return arrived
