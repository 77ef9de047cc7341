"""What playing a field back takes, for winds and plumes alike: where in its time each world is, and whether it fits.

Time in a field is s since its first frame. With `random_start` an episode begins anywhere in the loop, at a share of
the period that follows from the episode's seed alone: wind and plume that play back the same case, or two cases of one
period, are at the same time of it. With a `speed_factor` k all velocities are k times those of the field and its clock
runs k times as fast: the flow is similar, eddies travel along the same ways (and a concentration from an unchanged
release rate is 1 / k of the field's).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from osl_env.errors import InputError
from osl_env.fields.field import Field
from osl_env.fields.interpolation import locate
from osl_env.fields.library import load_field
from osl_env.numerics import uniform
from osl_env.parameters import FloatArray
from osl_env.state import BoolArray, IntArray
from osl_env.streams import Purpose, derive

_WIND = int(Purpose.WIND)
_START = 1  # index of the stream that an episode's start in a field is drawn from


@njit(cache=True, error_model="numpy")
def _shares(seeds: IntArray, out: FloatArray) -> None:
    for k in range(seeds.size):
        _, out[k] = uniform(derive(seeds[k], _WIND, _START))


def start_shares(seeds: IntArray) -> FloatArray:
    """(n,): the share of a field's period at which the episodes with `seeds` (n,) begin; uniform in [0, 1)."""
    out = np.empty(len(seeds))
    _shares(np.ascontiguousarray(seeds, np.int64), out)
    return out


@njit(cache=True, error_model="numpy")
def set_frames(
    times: FloatArray,
    period: float,
    speed_factor: float,
    starts: FloatArray,
    clock: FloatArray,
    due: BoolArray,
    frame: IntArray,
    blend: FloatArray,
) -> None:
    """In the worlds of `due` (n_envs,): the two frames that are blended at the times `clock` (n_envs,), s.

    `times` (n_t,) and `period` are the field's (0: its ends hold), `starts` (n_envs,) the time of the field, s, at
    which the episode began; written are `frame` (n_envs, 2) and `blend` (n_envs,), the weight of the second.
    """
    for e in range(due.size):
        if due[e]:
            first, second, weight = locate(times, period, starts[e] + speed_factor * clock[e])
            frame[e, 0], frame[e, 1], blend[e] = first, second, weight


def fitting_field(key: str, name: str, offset: Sequence[float], size: ArrayLike) -> Field:
    """The field `name` of the parameter `key`.

    Raises ValueError if it cannot be read or, moved by `offset` (3,) m, does not cover the arena of `size` (3,) m.
    """
    try:
        field = load_field(name)
    except InputError as error:
        raise ValueError(f"{key} = {name!r}: {error}") from None
    if not field.covers(size, offset):
        low, high = field.low + np.array(offset), field.high + np.array(offset)
        area = " x ".join(f"[0, {side:g}]" for side in np.asarray(size))
        covered = " x ".join(f"[{a:.6g}, {b:.6g}]" for a, b in zip(low, high, strict=True))
        raise ValueError(f"{key} = {name!r}: covers {covered} m; must cover the area {area} m (see offset)")
    return field


def writable(array: NDArray[Any]) -> NDArray[Any]:
    """`array` in a type that compiled code takes for writable, so that it is not compiled twice; it is not written.

    The memory is shared with `array` where numpy allows that.
    """
    view = array.view()
    try:
        view.flags.writeable = True
    except ValueError:
        return array.copy()
    return view
