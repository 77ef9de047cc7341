"""Workloads of GaSLAM's source term estimation: Metropolis-Hastings over the 700 cells of the paper's tunnel."""

from __future__ import annotations

import math

import numpy as np
from workloads import Call, Workload

from baselines.gaslam.cells import Cells
from baselines.gaslam.source_term import SourceTerm, SourceTermParameters

TUNNEL = Cells(np.zeros(3), np.array([7.0, 2.0, 0.5]))
WIND = (0.2, 0.0, 0.0)
SOURCE = (16.0 * math.pi * WIND[0], 1.5, 1.2, 0.3, 0.03, 0.15, 0.03, 0.15)


def estimate(iterations: int, count: int, target: float, used: float = 1.0) -> Workload:
    """A warm start of `iterations`, a fifth of them burn-in, with the share `used` of the cells."""

    def prepare() -> Call:
        parameters = SourceTermParameters(iterations=4 * iterations // 5, burn_in=iterations // 5)
        term, rng = SourceTerm(TUNNEL, parameters), np.random.default_rng(0)
        readings = term.plume_map(SOURCE, WIND) + rng.normal(0.0, parameters.sigma_e, TUNNEL.n)
        use = rng.random(TUNNEL.n) < used
        start = term.sample(readings, use, WIND, rng)
        return lambda: term.sample(readings, use, WIND, np.random.default_rng(1), start)

    return Workload(prepare, "s", count, target)


WORKLOADS_SOURCE_TERM = {
    "source term, an iteration over 700 cells": estimate(10000, 10000, 2.7e-6),
    "source term, a decision of 2000 iterations": estimate(2000, 1, 6e-3),
    "source term, a decision, a third of the cells": estimate(2000, 1, 6e-3, 1.0 / 3.0),
}
