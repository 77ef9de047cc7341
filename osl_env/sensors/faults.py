"""Faults of gas sensors, as events of a scenario: from a time on, for a time, the readings of one UAV or all are wrong.

    dead   0                          stuck  the last reading before the fault
    bias   reading + magnitude        gain   reading * magnitude
    noise  reading + magnitude * a standard normal draw

A fault changes the reading that the UAV reports (and with it what counts as a detection), not the sensor's state: once
it is over, readings are what they would have been without it. Counts stay whole numbers, readings stay in the sensor's
range. Faults that overlap act one after the other, in the scenario's order. The magnitude is in the reading's unit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numba import njit
from pydantic import model_validator

from osl_env.numerics import mix, normal
from osl_env.parameters import Parameters, quantity
from osl_env.state import StateArray

_KINDS = ("dead", "stuck", "bias", "gain", "noise")
_DEAD, _STUCK, _BIAS, _GAIN, _NOISE = range(len(_KINDS))
_ALL_UAVS = -1
_SALT = np.uint64(0xD1B54A32D192ED03)  # sets the noise of faults apart from the sensor's own draws

FAULTS = np.dtype(  # (n_faults,)
    [
        ("uav", np.int64),  # -1: all
        ("kind", np.int64),
        ("start", np.float64),  # s, mission clock
        ("end", np.float64),
        ("magnitude", np.float64),
    ],
    align=True,
)


class SensorFault(Parameters):
    """A fault of gas sensors between two times of the mission clock."""

    uav: int | None = quantity(None, "", ge=0)  # its number; None: all UAVs
    kind: Literal["dead", "stuck", "bias", "gain", "noise"] = "dead"
    start: float = quantity(0.0, "s", ge=0)
    end: float = quantity(math.inf, "s", gt=0, infinite=True)
    magnitude: float = quantity(0.0, "reading unit")  # of a bias or noise; the factor of a gain

    @model_validator(mode="after")
    def _consistent(self) -> SensorFault:
        if self.end <= self.start:
            raise ValueError(f"end = {self.end:g}: must be later than start = {self.start:g}")
        if self.kind in ("gain", "noise") and self.magnitude < 0:
            raise ValueError(f"magnitude = {self.magnitude:g}: must be at least 0 for {self.kind!r}")
        return self


def fault_table(faults: Sequence[SensorFault]) -> StateArray:
    """FAULTS (n,) for the kernels."""
    table = np.zeros(len(faults), FAULTS)
    for row, fault in zip(table, faults, strict=True):
        row["uav"] = _ALL_UAVS if fault.uav is None else fault.uav
        row["kind"] = _KINDS.index(fault.kind)
        row["start"], row["end"], row["magnitude"] = fault.start, fault.end, fault.magnitude
    return table


@njit(error_model="numpy")
def faulty_reading(faults: Any, uav: int, clock: float, reading: float, previous: float, stream: np.uint64) -> float:
    """What UAV number `uav` reports at `clock`, s, for `reading`, if `previous` was its last report.

    `stream` is the sensor's, which is left as it is: noise is drawn beside it.
    """
    for k in range(faults.size):
        fault = faults[k]
        if (fault.uav != _ALL_UAVS and fault.uav != uav) or clock < fault.start or clock >= fault.end:
            continue
        if fault.kind == _DEAD:
            reading = 0.0
        elif fault.kind == _STUCK:
            reading = previous
        elif fault.kind == _BIAS:
            reading += fault.magnitude
        elif fault.kind == _GAIN:
            reading *= fault.magnitude
        else:
            instant = np.float64(clock).view(np.uint64)  # a sensor without noise draws nothing: its stream stands still
            _, noise = normal(mix(mix(stream ^ instant) ^ (_SALT + np.uint64(k))))
            reading += fault.magnitude * noise
    return reading
