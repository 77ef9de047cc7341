"""The law of `law` for many robots of many worlds at once, from the frames that each has heard.

Every robot is worked out by itself, from its own numbers and the frames in its own inbox: the batch changes nothing.
A frame that several robots hear is one object, so each is unpacked once. A payload is the sender's temporal mean
concentration (float32) and whether it knows of the plume (1 byte); with any other payload, as another policy's in a
mixed team, the frame's reading stands in for the mean. Of several frames of one sender the newest counts.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from baselines.driving import concentration
from baselines.swarm.law import LawParameters, _direction, _odor_weight, _pull, _shove, _slope
from osl_env.parameters import FloatArray
from osl_env.radio import Message
from osl_env.state import BoolArray, IntArray

_FRAME = struct.Struct("<f?")  # temporal mean concentration, plume known
ROBOT = np.dtype(
    [
        ("uav", np.int64),
        ("speed", np.float64),  # m/s, the greatest
        ("hearing", np.float64),  # m: neighbours farther away do not count
        ("concentration", np.float64),  # C_i, the temporal mean
        ("largest", np.float64),  # Cmax
        ("planar", np.bool_),
        ("tracks", np.bool_),  # follows the law once the plume is known, else goes where it wishes
        ("found", np.bool_),  # knows of the plume
    ]
)


class Frames(NamedTuple):
    """The frames that a batch of robots has heard, each once, and who has heard which."""

    begin: IntArray  # (n_robots + 1,): robot i has heard the frames entry[begin[i]:begin[i + 1]]
    entry: IntArray  # (heard,)
    sender: IntArray  # (n_frames,)
    position: FloatArray  # (n_frames, 3) m
    concentration: FloatArray  # (n_frames,)
    found: BoolArray  # (n_frames,)


def pack(mean: float, found: bool) -> bytes:
    """The payload of a frame."""
    return _FRAME.pack(mean, found)


def unpack(message: Message, counts: bool) -> tuple[float, bool]:
    """The concentration of a frame's sender, and whether it knows of the plume; `counts`: readings are hits."""
    if len(message.payload) == _FRAME.size:
        mean, found = _FRAME.unpack(message.payload)
        if math.isfinite(mean):
            return mean, found
    return concentration(counts, message.reading, message.sampling_time), False


def gather(inboxes: Sequence[Sequence[Message]], counts: bool) -> Frames:
    """The frames of `inboxes`, one for each robot."""
    begin = np.zeros(len(inboxes) + 1, dtype=np.int64)
    np.cumsum(np.fromiter(map(len, inboxes), np.int64, len(inboxes)), out=begin[1:])
    heard = list(chain.from_iterable(inboxes))
    entry, first = _number(np.fromiter(map(id, heard), np.int64, len(heard)))
    frames = [heard[k] for k in first.tolist()]
    told = [unpack(frame, counts) for frame in frames]
    return Frames(
        begin,
        entry,
        np.array([frame.sender for frame in frames], dtype=np.int64),
        np.array([frame.position for frame in frames], dtype=np.float64).reshape(-1, 3),
        np.array([mean for mean, _ in told], dtype=np.float64),
        np.array([found for _, found in told], dtype=np.bool_),
    )


@njit(cache=True, error_model="numpy")
def _number(keys: IntArray) -> tuple[IntArray, IntArray]:
    """The different `keys` numbered in the order met: each key's number, and where each number was first met."""
    size = 16
    while size < 2 * keys.size:
        size *= 2
    table = np.full(size, -1, dtype=np.int64)  # of numbers, by hash, with the next free place after a clash
    entry = np.empty(keys.size, dtype=np.int64)
    first = np.empty(keys.size, dtype=np.int64)
    count = 0
    for k in range(keys.size):
        place = ((keys[k] >> 4) * 2654435761) & (size - 1)
        while table[place] >= 0 and keys[first[table[place]]] != keys[k]:
            place = (place + 1) & (size - 1)
        if table[place] < 0:
            table[place] = count
            first[count] = k
            count += 1
        entry[k] = table[place]
    return entry, first[:count]


@njit(error_model="numpy")
def _cut(x: float, y: float, z: float, speed: float) -> tuple[float, float, float]:
    """A velocity, in its direction no faster than `speed`."""
    size = math.sqrt(x * x + y * y + z * z)
    share = speed / size if size > speed else 1.0
    return share * x, share * y, share * z


@njit(error_model="numpy")
def _law_of(row: Any) -> LawParameters:
    return LawParameters(
        row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10], row[11]
    )  # fmt: skip


@njit(error_model="numpy")
def _listen(robot: Any, frames: Any, i: int, newest: Any) -> None:
    """Keep Cmax and whether the plume is known up to date, and note each sender's newest frame in `newest`."""
    robot.largest = max(robot.largest, robot.concentration)
    for e in range(frames.begin[i], frames.begin[i + 1]):
        k = frames.entry[e]
        newest[frames.sender[k]] = e
        robot.largest = max(robot.largest, frames.concentration[k])
        robot.found = robot.found or frames.found[k]


@njit(error_model="numpy")
def _social(robot: Any, law: Any, position: Any, frames: Any, i: int, newest: Any) -> tuple[float, float, float]:
    """k1 grad C (eqs 2 to 4) and the cohesion (eqs 5 to 7) of robot `i`."""
    fx = fy = fz = 0.0
    for e in range(frames.begin[i], frames.begin[i + 1]):
        k = frames.entry[e]
        if newest[frames.sender[k]] != e:
            continue
        x, y = frames.position[k, 0] - position[0], frames.position[k, 1] - position[1]
        z = 0.0 if robot.planar else frames.position[k, 2] - position[2]
        distance = math.sqrt(x * x + y * y + z * z)
        if distance > robot.hearing:
            continue
        slope = _slope(distance, frames.concentration[k] - robot.concentration)
        size = law.gradient_gain * slope + _pull(
            distance, _odor_weight(frames.concentration[k], robot.largest, law), law
        )
        ux, uy, uz = _direction(x, y, z, distance, robot.uav, frames.sender[k])
        fx, fy, fz = fx + size * ux, fy + size * uy, fz + size * uz
    return fx, fy, fz


@njit(cache=True, error_model="numpy")
def steer(
    robots: Any,
    laws: FloatArray,
    position: FloatArray,
    wind: FloatArray,
    wished: FloatArray,
    ranges: FloatArray,
    frames: Frames,
    velocity: FloatArray,
) -> None:
    """The velocities (n, 3) m/s of `robots` (n,) ROBOT, whose `largest` and `found` are brought up to date.

    `laws` (n, 12): the LawParameters of each. `wished` (n, 3) m/s stands for eqs 1 to 7 where the law is not followed.
    `ranges` (n, R) m. Each velocity is F (eq 9), cut to the robot's speed, as is what is wished.
    """
    newest = np.full(max(frames.sender.max(), 0) + 1 if frames.sender.size else 1, -1, dtype=np.int64)
    turn = 2.0 * math.pi / max(ranges.shape[1], 1)
    for i in range(robots.shape[0]):
        robot, law = robots[i], _law_of(laws[i])
        _listen(robot, frames, i, newest)
        if robot.tracks and robot.found:
            fx, fy, fz = _social(robot, law, position[i], frames, i, newest)
            fx -= law.wind_gain * wind[i, 0]
            fy -= law.wind_gain * wind[i, 1]
            fz -= law.wind_gain * wind[i, 2]
        else:
            fx, fy, fz = _cut(wished[i, 0], wished[i, 1], wished[i, 2], robot.speed)
        for k in range(ranges.shape[1]):
            push = _shove(ranges[i, k], law)
            if push > 0.0:
                fx -= push * math.cos(k * turn)
                fy -= push * math.sin(k * turn)
        if robot.planar:
            fz = 0.0
        velocity[i, 0], velocity[i, 1], velocity[i, 2] = _cut(fx, fy, fz, robot.speed)
