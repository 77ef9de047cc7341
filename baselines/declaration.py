"""When a searcher may say "the source is here" (MUC-OSL's loop; the paper page's reading of it).

A UAV declares the mean of its belief once it has had or heard of a detection, the belief's spread sqrt(tr Sigma) is
below `declare_spread`, and it is itself within `declare_distance` of that mean. The spread alone would declare falsely
in about half of the runs or more: a cloud of particles can collapse anywhere.
"""

from __future__ import annotations

import math

from osl_env.parameters import FloatArray, Parameters, quantity


class DeclarationParameters(Parameters):
    """Thresholds of the declaration; mixed into the parameters of policies that declare by `DeclarationRule`."""

    declare_spread: float = quantity(2.0, "m", gt=0)  # sqrt(tr Sigma) must be below
    declare_distance: float = quantity(3.0, "m", gt=0)  # the UAV must be within this of the mean


class DeclarationRule:
    """The rule for one UAV and episode: remembers whether anything has been detected."""

    __slots__ = ("_distance", "_spread", "heard")

    def __init__(self, parameters: DeclarationParameters) -> None:
        self._spread, self._distance = parameters.declare_spread, parameters.declare_distance
        self.heard = False  # of a detection, the UAV's own or a neighbour's

    def hear(self, hits: float) -> None:
        """Take note of a reading, own or received."""
        self.heard = self.heard or hits > 0.0

    def decide(self, mean: FloatArray, spread: float, position: FloatArray) -> FloatArray | None:
        """(3,) m, a copy of the belief's `mean`, if a UAV at `position` may declare it; None otherwise."""
        if not self.heard or spread >= self._spread or math.dist(mean, position) > self._distance:
            return None
        return mean.copy()
