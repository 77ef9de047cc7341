"""What a wind is: parameters, and the air's velocity in each world of a batch."""

from __future__ import annotations

from abc import abstractmethod

from osl_env.parameters import FloatArray, Parameters
from osl_env.state import IntArray


class Wind(Parameters):
    """Base of the wind models. Velocities point where the air goes."""

    @abstractmethod
    def draw(self, seeds: IntArray) -> FloatArray:
        """Mean wind velocity (n, 3), m/s, of the episodes with `seeds` (n,)."""
