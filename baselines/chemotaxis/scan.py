"""The lawn-mower pattern of the chemotaxis paper's SCAN, as pure geometry.

A layer is swept to and fro at one height: first from the start to the nearer side, then lane after lane, `lane_shift`
further towards one boundary, until the next lane would lie beyond it. The UAV then goes back over its start, changes
height there, and sweeps the next layer. Turns are `turn_margin` inside the bounds. The paper sweeps along y and goes
towards low x; `towards` turns the pattern. Of several UAVs each sweeps a strip of its own, as if that were the area.

Heights are those of the page: from a start above the middle height downwards by (start - floor) / layers, from any
other upwards by (ceiling - start) / layers. In the arena's coordinates the floor is at 0 m.

Readings of what the page leaves open: a last lane that is nearer to the boundary than the margin is moved to the
margin; in a strip narrower than four margins the margin is a quarter of the width, so that there is something to sweep;
a UAV that starts beside its strip comes back to the strip's edge, not to its start.
"""

from __future__ import annotations

from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from osl_env.parameters import FloatArray

Towards: TypeAlias = Literal["low_x", "high_x", "low_y", "high_y"]
FirstSide: TypeAlias = Literal["nearer", "farther", "low", "high"]

_OPPOSITE: dict[Towards, Towards] = {"low_x": "high_x", "high_x": "low_x", "low_y": "high_y", "high_y": "low_y"}
_SAME = 1e-9  # m


class Pattern(NamedTuple):
    """The shape of a scan."""

    towards: Towards = "low_x"  # the boundary that the lanes go to; sweeps are along it
    lane_shift: float = 4.0  # m between lanes
    turn_margin: float = 1.5  # m from the bounds to the turns
    first_side: FirstSide = "nearer"  # of the first sweep; as near: the high side

    def reversed(self) -> Pattern:
        """The same towards the opposite boundary."""
        return self._replace(towards=_OPPOSITE[self.towards])


def layer_heights(start: float, ceiling: float, layers: int) -> FloatArray:
    """(layers,) m: the heights of a scan that starts at `start`, between 0 and `ceiling` m."""
    span = -start if start > ceiling / 2.0 else ceiling - start
    return np.asarray(start + span / layers * np.arange(layers), dtype=np.float64)


def lanes(start: float, side: float, pattern: Pattern) -> list[float]:
    """Where the lanes after the first are, m, on the axis [0, `side`] that they go along; none if none fits."""
    sign = -1.0 if pattern.towards.startswith("low") else 1.0
    margin = min(pattern.turn_margin, side / 4.0)
    places, lane = [], start + sign * pattern.lane_shift
    while -_SAME <= lane <= side + _SAME:
        places.append(min(max(lane, margin), side - margin))
        lane += sign * pattern.lane_shift
    return places


def has_other_side(start: float, side: float, pattern: Pattern) -> bool:
    """Whether a whole `lane_shift` fits between the start and the margin of the boundary that lanes do not go to."""
    there = lanes(start, side, pattern.reversed())
    return bool(there) and abs(there[0] - start) > pattern.lane_shift - _SAME


def turns(low: float, high: float, start: float, pattern: Pattern) -> tuple[float, float]:
    """The first turn and the opposite one, m, of sweeps from `start` in the strip from `low` to `high`."""
    margin = min(pattern.turn_margin, (high - low) / 4.0)
    nearer_is_low = start < (low + high) / 2.0
    first_is_low = {"nearer": nearer_is_low, "farther": not nearer_is_low, "low": True, "high": False}
    ends = (low + margin, high - margin)
    return ends if first_is_low[pattern.first_side] else ends[::-1]


def scan_round(
    start: FloatArray, area: FloatArray, pattern: Pattern, heights: FloatArray, strip: int = 0, n_strips: int = 1
) -> FloatArray:
    """The way points (n, 3), m, of one round over all layers of strip number `strip`, which ends where it began.

    `start` and `area` (3,) m, `heights` (layers,) m. The first way point is the first layer's first turn: a UAV whose
    start is at another height goes there on its way.
    """
    along, across = (0, 1) if pattern.towards.endswith("x") else (1, 0)
    low, high = area[across] / n_strips * np.array([strip, strip + 1])
    home = np.array(start, dtype=np.float64)
    home[across] = min(max(home[across], low), high)
    begin, end = turns(float(low), float(high), float(home[across]), pattern)
    places = lanes(float(home[along]), float(area[along]), pattern)
    points: list[FloatArray] = []

    def add(lane: float, sweep: float, height: float) -> None:
        point = np.empty(3)
        point[along], point[across], point[2] = lane, sweep, height
        points.append(point)

    for k, height in enumerate(heights):
        side, other = begin, end
        add(home[along], side, height)
        for lane in places:
            add(lane, side, height)
            add(lane, other, height)
            side, other = other, side
        if not places:  # one sweep is better than none
            add(home[along], end, height)
        add(home[along], home[across], height)
        add(home[along], home[across], heights[(k + 1) % len(heights)])
    return np.array(points)
