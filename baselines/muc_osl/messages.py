"""Payloads of the MUC-OSL family: a Gaussian of 12 numbers, or all particles with 4 numbers each; single precision.

The frame's header (position and reading, 4 numbers) is sent by the radio itself. A payload of another length comes
from another policy and is left out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from baselines.belief.gaussian_fit import GAUSSIAN_NUMBERS
from baselines.belief.particle_filter import WEIGHT
from osl_env.parameters import FloatArray
from osl_env.radio import Message

GAUSSIAN_BYTES = 4 * GAUSSIAN_NUMBERS
PARTICLE_NUMBERS = 4  # x, y, z (m), weight
PARTICLE_BYTES = 4 * PARTICLE_NUMBERS
_NO_GAUSSIAN = np.full(GAUSSIAN_NUMBERS, np.nan, dtype=np.float32).tobytes()


def pack_gaussian(gaussian: FloatArray) -> bytes:
    """48 bytes: mean (3), m, and covariance (9), m^2, of `gaussian` (12,)."""
    return gaussian.astype(np.float32).tobytes()


def unpack_gaussians(inbox: Sequence[Message]) -> FloatArray:
    """(F, 12): the Gaussian of every frame of `inbox`, NaN where it carries none."""
    payloads = [m.payload if m.payload and len(m.payload) == GAUSSIAN_BYTES else _NO_GAUSSIAN for m in inbox]
    return np.frombuffer(b"".join(payloads), dtype=np.float32).reshape(-1, GAUSSIAN_NUMBERS).astype(np.float64)


def pack_particles(cloud: FloatArray) -> bytes:
    """16 bytes a particle of `cloud` (5, n): x, y, z, m, and weight."""
    return cloud[: WEIGHT + 1].astype(np.float32).T.tobytes()


def unpack_particles(inbox: Sequence[Message]) -> tuple[NDArray[np.float32], FloatArray, NDArray[np.int64]]:
    """The newest clouds of the neighbours: particles (n, 4), when each cloud was sent (S,), s, and its size (S,)."""
    newest: dict[int, Message] = {}
    for message in inbox:
        if message.payload and len(message.payload) % PARTICLE_BYTES == 0:
            before = newest.get(message.sender)
            if before is None or before.time <= message.time:
                newest[message.sender] = message
    clouds = list(newest.values())
    particles = np.frombuffer(b"".join([m.payload for m in clouds]), dtype=np.float32).reshape(-1, PARTICLE_NUMBERS)
    sent = np.array([m.time for m in clouds], dtype=np.float64)
    return particles, sent, np.array([len(m.payload) // PARTICLE_BYTES for m in clouds], dtype=np.int64)
