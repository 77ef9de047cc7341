"""Which of the recorded guesses GaSLAM declares in the end: a vote in the manner of RANSAC.

Once the posterior's entropy E is below Th_E (`entropy_threshold`) and alpha is above 0, the source's estimate is
recorded each time that it is made, with its entropy. When the time budget ends, the guess with the most others within

    S_th = 2 sqrt(x_r^2 + y_r^2 + z_r^2)                                                               (10)

defines the inliers, x_r, y_r and z_r being the sides of the posterior's bins; of equals the first. What is declared is
the inliers' mean, weighted by 1 / (E + 0.1), E in nats.

The paper weights by the entropy recorded with each guess. That favours the worst, and is 0 / 0 where all entropies
vanish: `weighting = "printed"` restores it, with equal weights in that case; "equal" gives the plain mean.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from scipy.spatial.distance import pdist, squareform

from osl_env.parameters import FloatArray, Parameters, quantity

_SOFTENING = 0.1  # nats


class VoteParameters(Parameters):
    """Parameters of recording and of the vote; mixed into the parameters of the policy."""

    entropy_threshold: float = quantity(3.0, "", ge=0, infinite=True)  # Th_E, nats
    weighting: Literal["inverse", "printed", "equal"] = "inverse"
    inlier_factor: float = quantity(2.0, "", gt=0)  # of S_th (10)


class Guesses:
    """The guesses of one UAV and episode."""

    __slots__ = ("_entropies", "_parameters", "_places", "recording")

    def __init__(self, parameters: VoteParameters) -> None:
        self._parameters = parameters
        self._places: list[FloatArray] = []
        self._entropies: list[float] = []
        self.recording = False  # S_r

    def __len__(self) -> int:
        """How many guesses are recorded."""
        return len(self._places)

    def low(self, entropy: float) -> bool:
        """Whether `entropy`, nats, is below the threshold."""
        return entropy < self._parameters.entropy_threshold

    def take(self, place: FloatArray, entropy: float, alpha: float) -> None:
        """Take note of the estimate `place` (3,) m with its `entropy`, nats, once recording has begun."""
        self.recording = self.recording or (self.low(entropy) and alpha > 0.0)
        if self.recording:
            self._places.append(np.array(place, dtype=np.float64))
            self._entropies.append(entropy)

    def vote(self, bins: FloatArray) -> FloatArray | None:
        """The voted source (3,), m, with posterior `bins` of the sides (3,), m; None if nothing is recorded."""
        if not self._places:
            return None
        places, entropies = np.array(self._places), np.array(self._entropies)
        within = self._parameters.inlier_factor * math.sqrt(float(np.square(bins).sum()))
        near = squareform(pdist(places)) <= within
        inliers = near[int(np.argmax(near.sum(axis=1)))]
        weights = self._weights(entropies[inliers])
        voted: FloatArray = weights @ places[inliers] / weights.sum()
        return voted

    def _weights(self, entropies: FloatArray) -> FloatArray:
        if self._parameters.weighting == "inverse":
            return 1.0 / (entropies + _SOFTENING)
        if self._parameters.weighting == "printed" and entropies.sum() > 0.0:
            return entropies
        return np.ones_like(entropies)
