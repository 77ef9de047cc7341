"""What a gas sensor is: parameters, what it needs of the plume, and what its readings are."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar, Literal

import numpy as np
from numba import njit

from osl_env.parameters import Parameters
from osl_env.state import DETECTION_MEMORY, StateArray

HITS_SCALE = 5.0  # a count that is neither few nor many, for normalising observations

# (1,): what the kernels need of a sensor of concentrations, in the plume's unit; all zero for a counter
RESPONSE = np.dtype(
    [
        ("period", np.float64),  # s
        ("rise_time", np.float64),  # s
        ("recovery_time", np.float64),  # s
        ("noise", np.float64),
        ("relative_noise", np.float64),
        ("drift", np.float64),  # per sqrt(s)
        ("threshold", np.float64),
        ("full_scale", np.float64),  # infinite: none
        ("resolution", np.float64),  # 0: none
        ("count_unit", np.float64),  # for one count a second; 0: the sensor reports concentration
        ("max_count", np.float64),  # infinite: none
    ],
    align=True,
)


class GasSensor(Parameters):
    """Base of the gas sensors. `measures` says which quantity of a plume the sensor needs."""

    measures: ClassVar[Literal["hit_rate", "concentration"]]

    @property
    @abstractmethod
    def reports(self) -> Literal["hits", "concentration"]:
        """What a reading is: a count of hits, or a concentration in the plume's unit."""

    @property
    @abstractmethod
    def scale(self) -> float:
        """A reading that is neither small nor large, in its own unit: observations are normalised by it."""

    def response(self) -> StateArray:
        """RESPONSE (1,): the numbers that the kernels of concentration sensors need; all zero for a counter."""
        return np.zeros(1, RESPONSE)


@njit(inline="always", error_model="numpy")
def remember(senses: Any, motion: Any, reading: Any, clock: Any) -> None:
    """Put a detection in front of the remembered ones."""
    for k in range(DETECTION_MEMORY - 1, 0, -1):
        senses.detection_time[k] = senses.detection_time[k - 1]
        senses.detection_reading[k] = senses.detection_reading[k - 1]
        for axis in range(3):
            senses.detection_position[k, axis] = senses.detection_position[k - 1, axis]
    senses.detection_time[0] = clock
    senses.detection_reading[0] = reading
    for axis in range(3):
        senses.detection_position[0, axis] = motion.position[axis]
    if senses.detections == 0:
        senses.first_detection_time = clock
    senses.detections += 1
    senses.fresh = True
