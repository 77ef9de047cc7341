"""What the network sees and what it moves: the team's situation, and the levers of the scoring rule.

Every `MACRO_BEATS` beats it looks at the situation (the same for all UAVs that have heard the same) and sets the
levers: weights of features of the candidates, apart for the search without and with a trace, and the rule's times. All
levers at 0 are the scripted rule.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from baselines.search_agent.sight import FEATURES, N_FEATURES, in_wind, squash, wind_frame
from osl_env.parameters import FloatArray

MACRO_BEATS = 5  # that levers stay as they are
WEIGHT_SCALE = 0.5  # of a feature, at a lever's end
SITUATION_FEATURES = (
    "team", "spread", "spread_along", "spread_across", "spread_up", "entropy", "heard", "searching", "silence",
    "clock", "certainty", "wind", "strength", "range", "length", "width", "height", "last_hits", "nearest",
    "mean_distance", "wall_along", "wall_against", "ceiling", "floor",
)  # fmt: skip
N_SITUATION = len(SITUATION_FEATURES)
TRACE_LEVERS = (
    "travel", "turns", "stays", "same_goal", "of_belief", "of_support", "information", "hit", "leg_information",
    "leg_hit", "spread_change", "spread_rate", "nearer", "distance", "mass_near", "from_own_along", "spreads_along",
    "off_axis", "off_level", "from_other_goals", "nearer_than_others",
)  # fmt: skip
SEARCH_LEVERS = (
    "travel", "stays", "of_belief", "of_support", "information", "hit", "hit_rate", "spread_change", "distance",
    "mass_near", "spreads_along", "off_axis", "off_level", "from_other_goals", "nearer_than_others",
)  # fmt: skip
TIMES = ("stand", "horizon", "dwell", "entropy_weight")  # of the rule, halved or doubled at a lever's ends
N_LEVERS = len(TRACE_LEVERS) + len(SEARCH_LEVERS) + len(TIMES)
_TRACE = np.array([FEATURES.index(name) for name in TRACE_LEVERS])
_SEARCH = np.array([FEATURES.index(name) for name in SEARCH_LEVERS])
_REFERENCE = FEATURES.index("reference")


def set_levers(levers: NDArray[Any], base: Any, settings: Any, weights: FloatArray, rows: Any = slice(None)) -> None:
    """Set `weights` (B, 2, N_FEATURES) and the times of `settings` (B,) of crews `rows` from `levers` (n, N_LEVERS).

    `levers` are clipped to [-1, 1]; `base` (1,) holds the times at 0.
    """
    moved = np.clip(np.asarray(levers, dtype=np.float64), -1.0, 1.0)
    fresh = np.zeros((len(moved), 2, N_FEATURES))
    fresh[:, :, _REFERENCE] = 1.0
    ends = np.cumsum([len(TRACE_LEVERS), len(SEARCH_LEVERS)])
    fresh[:, 0, _TRACE] = WEIGHT_SCALE * moved[:, : ends[0]]
    fresh[:, 1, _SEARCH] = WEIGHT_SCALE * moved[:, ends[0] : ends[1]]
    weights[rows] = fresh
    for column, name in enumerate(TIMES, start=int(ends[1])):
        settings[name][rows] = base[name] * 2.0 ** moved[:, column]


@njit(error_model="numpy")
def _wall(place: Any, along: Any, area: Any, sign: float) -> float:
    """Metres from `place` to the side of the volume, down the wind (`sign` 1) or up it (-1)."""
    nearest = 1e3
    for axis in range(2):
        step = sign * along[axis]
        if abs(step) > 1e-6:
            nearest = min(nearest, (area[axis] - place[axis]) / step if step > 0.0 else -place[axis] / step)
    return nearest


@njit(cache=True, error_model="numpy")
def describe(situations: Any, mates: Any, settings: Any, models: FloatArray, out: NDArray[np.float32]) -> None:
    """The situation of each crew: out (B, N_SITUATION)."""
    along, spreads = np.empty(2), np.empty(3)
    for b in range(situations.shape[0]):
        situation, s, row, mean = situations[b], settings[b], out[b], situations[b].mean
        wind_frame(situation, along, spreads)
        count, nearest, total = 0, 1e3, 0.0
        for i in range(mates.shape[1]):
            if mates[b, i].known:
                x, y, z = in_wind(mates[b, i].position, mean, along)
                far = math.sqrt(x * x + y * y + z * z)
                count, nearest, total = count + 1, min(nearest, far), total + far
        trace = spreads[0] ** 2 + spreads[1] ** 2 + spreads[2] ** 2
        row[0], row[1] = count / 8.0, math.log(math.sqrt(trace) + 0.05) / 3.0
        for axis in range(3):
            row[2 + axis] = math.log(spreads[axis] + 0.05) / 3.0
            row[14 + axis] = squash(s.area[axis], 100.0)
        row[5], row[6] = situation.entropy / 10.0, 1.0 if situation.heard else 0.0
        row[7] = 1.0 if situation.searching else 0.0
        row[8] = squash(situation.clock - situation.last_detection, 30.0)
        row[9], row[10] = squash(situation.clock, 300.0), situation.certainty
        row[11] = squash(math.sqrt(situation.wind[0] ** 2 + situation.wind[1] ** 2), 1.0)
        row[12], row[13] = squash(s.strength, 2.5), models[b, 2]
        row[17], row[18] = squash(situation.last_hits, 1.0), squash(nearest, 20.0)
        row[19] = squash(total / max(count, 1), 20.0)
        row[20], row[21] = squash(_wall(mean, along, s.area, 1.0), 20.0), squash(_wall(mean, along, s.area, -1.0), 20.0)
        row[22], row[23] = squash(s.area[2] - mean[2], 10.0), squash(mean[2], 10.0)
