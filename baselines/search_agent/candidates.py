"""Where a UAV may go next: candidate goals made from its place, the wind and the belief.

Directions are those of the wind's frame (along it, across it, up), so that a network meets the same geometry in every
wind. Goals of four kinds: its own (staying, and the goal that it has), neighbours of its place, the belief's (mean,
multiples of its spread, downwind of it), and places of the belief's support with places downwind of those, where such
a source would be smelt. All are clipped to the volume.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from osl_env.parameters import FloatArray

OWN, NEIGHBOUR, BELIEF, SUPPORT = 0, 1, 2, 3
_HOPS = (2.5, 5.0)  # m, to the neighbours
_MULTIPLES = (1.0, 2.0)  # of the belief's spread
_STANDS = ((0.75, 0.0), (0.75, 1.0), (0.75, -1.0), (1.5, 0.0), (1.5, 1.0), (1.5, -1.0))  # spreads along, across
_DOWNWIND = (4.0, 10.0, 20.0)  # m
_N_SUPPORT = 8
_SUPPORT_DOWNWIND = (6.0, 14.0)  # m
_HALTON = 0.6180339887498949  # golden ratio: the support's places rotate from decision to decision

_AXES = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [0, -1.0, 0], [0, 0, 1.0], [0, 0, -1.0]])


def _table() -> tuple[FloatArray, FloatArray]:
    """Kinds (K,), and rows (K, 4): origin's kind, and the offset along, across, up, in m or in spreads."""
    kinds, rows = [OWN, OWN], [(0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]
    for hop in _HOPS:
        kinds += [NEIGHBOUR] * len(_AXES)
        rows += [tuple(hop * axis) for axis in _AXES]
    kinds += [BELIEF] * (1 + len(_AXES) * len(_MULTIPLES) + len(_STANDS) + len(_DOWNWIND))
    rows += [(0.0, 0.0, 0.0)]
    rows += [tuple(multiple * axis) for multiple in _MULTIPLES for axis in _AXES]
    rows += [(along, across, 0.0) for along, across in _STANDS]
    rows += [(distance, 0.0, 0.0) for distance in _DOWNWIND]
    for distance in (0.0, *_SUPPORT_DOWNWIND):
        kinds += [SUPPORT] * _N_SUPPORT
        rows += [(distance, 0.0, 0.0)] * _N_SUPPORT
    return np.array(kinds), np.array(rows, dtype=np.float64)


KINDS, OFFSETS = _table()
N_CANDIDATES = len(KINDS)  # K
_FIRST_DOWNWIND = 2 + len(_HOPS) * 6 + 1 + 6 * len(_MULTIPLES) + len(_STANDS)  # belief's offsets from here on are in m
_FIRST_SUPPORT = _FIRST_DOWNWIND + len(_DOWNWIND)


@njit(error_model="numpy")
def write_candidates(
    own: Any, goal: Any, along: Any, mean: Any, spreads: Any, support: Any, area: Any, decision: int, out: Any
) -> None:
    """Write the goals to `out` (K, 3), m.

    own, goal (3,) m: the UAV's place and its goal so far; along (2,): unit vector of the wind; mean (3,), m, and
    spreads (3,), m, along, across and up, of the belief; support (3, P), m; area (3,), m.
    """
    turn = (decision * _HALTON) % 1.0
    for k in range(out.shape[0]):
        a, c, u = OFFSETS[k, 0], OFFSETS[k, 1], OFFSETS[k, 2]
        x, y, z = own[0], own[1], own[2]
        if k == 1:
            x, y, z = goal[0], goal[1], goal[2]
        elif KINDS[k] == BELIEF:
            x, y, z = mean[0], mean[1], mean[2]
            if k < _FIRST_DOWNWIND:
                a, c, u = a * spreads[0], c * spreads[1], u * spreads[2]
        elif KINDS[k] == SUPPORT:
            place = ((k - _FIRST_SUPPORT) % _N_SUPPORT + turn) / _N_SUPPORT
            point = min(int(place * support.shape[1]), support.shape[1] - 1)
            x, y, z = support[0, point], support[1, point], support[2, point]
        out[k, 0] = min(max(x + a * along[0] - c * along[1], 0.0), area[0])
        out[k, 1] = min(max(y + a * along[1] + c * along[0], 0.0), area[1])
        out[k, 2] = min(max(z + u, 0.0), area[2])
