"""The environment's flat observation as a feature: from a world's state, or from one UAV's Observation.

Both forms are the same numbers bit for bit: the flat vector of `osl_env.observation` is written in single precision,
and so it is here. The table of neighbours comes last in it, nearest first, so that it can be cut or padded: what range
sensors see is left out.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from baselines.features.spec import NEIGHBOUR_SIZE, OWN_SIZE, TEAM_NAMES
from osl_env.arena import Arena
from osl_env.observation import Observation, ObservationLayout
from osl_env.parameters import FloatArray
from osl_env.placement import Sources, Team
from osl_env.scenario import Scenario
from osl_env.state import BoolArray

Float32Array = NDArray[np.float32]

NEAR_SCALE = np.float32(5.0)  # m
_COLUMNS = len(TEAM_NAMES)


@njit(cache=True, error_model="numpy")
def write_team(
    flat: Float32Array, side: np.float32, slots: int, mask: BoolArray, out: Float32Array, start: int
) -> None:
    """The team table into `out` (n_worlds, n_uavs, ..) from column `start` on, from flat observations.

    Only in the worlds of `mask`; `side`: the area's longest side, m.
    """
    known = (flat.shape[2] - OWN_SIZE) // NEIGHBOUR_SIZE
    for e in range(flat.shape[0]):
        for i in range(flat.shape[1] if mask[e] else 0):
            for slot in range(slots):
                first = start + slot * _COLUMNS
                place = out[e, i, first : first + _COLUMNS]
                at = OWN_SIZE + slot * NEIGHBOUR_SIZE
                if slot >= known or flat[e, i, at] == 0.0:
                    place[:] = 0.0
                    continue
                x, y, z = flat[e, i, at + 1] * side, flat[e, i, at + 2] * side, flat[e, i, at + 3] * side
                near = np.float32(np.sqrt(x * x + y * y + z * z)) + NEAR_SCALE
                for column in range(4):
                    place[column] = flat[e, i, at + column]
                place[4], place[5], place[6] = x / near, y / near, z / near
                for column in range(3):
                    place[7 + column] = flat[e, i, at + 4 + column]


class FlatRow:
    """Makes the flat observation of one UAV from its Observation and what it was told before take-off."""

    def __init__(
        self, area: FloatArray, speed: float, energy_capacity: float, time_limit: float, reading_scale: float
    ) -> None:
        """Area in m, greatest speed in m/s, battery in J, time limit in s, the gas sensor's typical reading."""
        told = Scenario.model_validate({
            "arena": Arena(size=(float(area[0]), float(area[1]), float(area[2]))),
            "team": Team(n_uavs=2, starts=((0.0, 0.0, 0.0),) * 2),
            "sources": Sources(positions=((0.0, 0.0, 0.0),)),
            "vehicle": {"speed": speed},
            "energy": {"capacity": energy_capacity},
            "ending": {"time_limit": time_limit},
        })  # fmt: skip
        layout = ObservationLayout(told, reading_scale)
        columns = []
        for field in layout.fields:
            if field.normalised == "no":
                continue
            linear = field.normalised == "linear"
            scales = list(field.scale) * (field.size // len(field.scale))
            columns += [(x, field.offset, 0.0, 1.0) if linear else (1.0, 0.0, 1.0, x) for x in scales]
        self._area = np.array(area, dtype=np.float64)
        self._transform = np.array(columns, dtype=np.float32).T

    def flat(self, observation: Observation) -> Float32Array:
        """The normalised vector (own numbers, then 7 for each neighbour)."""
        o = observation
        own = [o.position, self._area, o.velocity, o.wind]
        own += [np.array([float(o.ready), o.reading, o.sampling_time, o.energy_left, o.time_left])]
        parts = [o.detection_mask, o.detection_age, o.detection_offset, o.detection_reading]
        own += [_table(parts)]
        parts = [o.neighbour_mask, o.neighbour_offset, o.neighbour_reading, o.neighbour_sampling_time, o.neighbour_age]
        own += [_table(parts)]
        row = np.concatenate(own).astype(np.float32)
        repeats = (row.size - OWN_SIZE) // NEIGHBOUR_SIZE
        one = self._transform
        gain, offset, bend, base = np.concatenate([one[:, :OWN_SIZE], *[one[:, OWN_SIZE:]] * repeats], axis=1)
        normalised: Float32Array = (row * gain + offset) / (np.abs(row) * bend + base)
        return np.clip(normalised, np.float32(-1.0), np.float32(1.0))


def _table(columns: list[Any]) -> FloatArray:
    """Columns (n,) or (n, 3) side by side, row after row."""
    arrays = [np.asarray(column, dtype=np.float64) for column in columns]
    return np.concatenate([a[:, None] if a.ndim == 1 else a for a in arrays], axis=1).reshape(-1)
