"""Plume finding: the team sweeps the area in a line, crosswind, and moves upwind when its width is covered.

A. Marjovi and L. Marques, "Optimal swarm formation for odor plume finding", IEEE Transactions on Cybernetics 44, 2014:
for a swarm that moves crosswind the best formation is a diagonal line with equal distances. Here the line's ranks are
the UAV numbers. Each robot follows its own place in a line that moves by the clock, `_PACE` of the robots' speed, so
that nobody has to be heard and one that was held up catches up.

    A line that is as long as the area is wide goes straight upwind, abreast, closed up to fit. A shorter one is set at
    `line_angle` to the crosswind, sweeps from side to side, and takes a step upwind at each side that passes what all
    its robots have swept. At the upwind end it turns back downwind.

Upwind is against the robot's own low-passed wind; without wind it is +x. In three dimensions the robots fly at heights
of their own, which divide the volume's height. Not in the paper: pace, steps, heights, and the spacing as a share of
the distance at which neighbours are heard (the paper's depends on the wind and the environment).
"""

from __future__ import annotations

import math

from baselines.policy import Briefing
from osl_env.parameters import FloatArray, Parameters, quantity

_PACE = 0.8  # of the robots' speed
_CALM = 1e-3  # m/s: no wind
_SHARE_OF_HEARING = 0.5  # of delta_d: the default spacing
_CLEARANCE = 1.2  # of the range sensors' range: where a wall does not push


class FindingParameters(Parameters):
    """The line of plume finding; mixed into the parameters of the policies that search by it."""

    line_spacing: float | None = quantity(None, "m", gt=0)  # between neighbours; None: half of delta_d
    line_angle: float = quantity(math.pi / 4.0, "rad", ge=0, le=1.5)  # to the crosswind, if it sweeps; 0: abreast
    wind_time: float = quantity(20.0, "s", gt=0)  # time constant of the low-passed wind


class Line:
    """One robot's place in the line, as a function of time and of the wind that it has measured."""

    __slots__ = (
        "_angle",
        "_height",
        "_margin",
        "_middle",
        "_n",
        "_pace",
        "_rank",
        "_row",
        "_spacing",
        "_start",
        "_wind",
        "_wind_time",
    )

    def __init__(self, parameters: FindingParameters, briefing: Briefing, hearing: float) -> None:
        """`hearing` (delta_d), m."""
        self._n, self._rank = briefing.n_uavs, briefing.uav
        self._middle = (float(briefing.area[0]) / 2.0, float(briefing.area[1]) / 2.0)
        self._spacing = parameters.line_spacing or _SHARE_OF_HEARING * hearing
        self._angle, self._wind_time = parameters.line_angle, parameters.wind_time
        self._pace = _PACE * float(briefing.speed)
        shell = _CLEARANCE * briefing.range_sensors.range if briefing.range_sensors.count else 0.0
        self._margin = min(max(self._spacing / 2.0, shell), min(self._middle) / 2.0)  # m, from the bounds
        level = float(briefing.area[2]) * (briefing.uav + 0.5) / briefing.n_uavs
        self._start: tuple[float, float] = (float(briefing.start[0]), float(briefing.start[1]))
        self._height = float(briefing.start[2]) if briefing.planar else level
        self._wind: tuple[float, float] | None = None  # m/s, low-passed
        self._row: float | None = None  # that it began in

    def measure(self, wind: FloatArray, elapsed: float) -> None:
        """Take note of `wind` (3,) m/s, `elapsed` s after the one before."""
        x, y = float(wind[0]), float(wind[1])
        if self._wind is None:
            self._wind = (x, y)
            return
        gain = -math.expm1(-elapsed / self._wind_time)
        self._wind = (self._wind[0] + gain * (x - self._wind[0]), self._wind[1] + gain * (y - self._wind[1]))

    def place(self, time: float) -> tuple[float, float, float]:
        """Where the robot should be at `time`, s: x, y, z, m."""
        ex, ey = self._upwind()
        mx, my = self._middle
        reach = abs(ex) * mx + abs(ey) * my - self._margin  # m from the middle, upwind and downwind
        width = abs(ey) * mx + abs(ex) * my - self._margin  # to either side
        across, along, swing, step = self._shape(width)
        rows = max(0.0, math.floor((2.0 * reach - along * (self._n - 1)) / step + 1e-9))
        if self._row is None:
            begun = (self._start[0] - mx) * ex + (self._start[1] - my) * ey
            self._row = min(max(round((begun + reach) / step), 0.0), rows)
        sweeps, rest = divmod(self._pace * time, 2.0 * swing + step)
        side = -1.0 if sweeps % 2.0 else 1.0
        row = _folded(self._row + sweeps + max(0.0, rest - 2.0 * swing) / step, rows)
        u = min(-reach + row * step + self._rank * along, reach)
        v = side * (swing - min(rest, 2.0 * swing)) + (self._rank - (self._n - 1) / 2.0) * across
        x, y = mx + u * ex - v * ey, my + u * ey + v * ex
        return min(max(x, 0.0), 2.0 * mx), min(max(y, 0.0), 2.0 * my), self._height

    def _upwind(self) -> tuple[float, float]:
        x, y = self._wind or (0.0, 0.0)
        speed = math.hypot(x, y)
        return (-x / speed, -y / speed) if speed > _CALM else (1.0, 0.0)

    def _shape(self, width: float) -> tuple[float, float, float, float]:
        """m: from one robot to the next across and along the wind, half of a sweep, and the step upwind after it."""
        gaps = self._n - 1
        if gaps * self._spacing >= 2.0 * width:
            return 2.0 * width / gaps if gaps else 0.0, 0.0, 0.0, self._spacing
        across, along = self._spacing * math.cos(self._angle), self._spacing * math.sin(self._angle)
        return across, along, width - gaps * across / 2.0, max(self._n * along, self._spacing)


def _folded(row: float, last: float) -> float:
    """A row counted on beyond the `last`, where the line turns back; and again at row 0."""
    return last - abs(row % (2.0 * last) - last) if last > 0.0 else 0.0
