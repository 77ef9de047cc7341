"""Workloads of GaSLAM's gas map: a kernel update, the maps at a goal, and the true mean map that judges a run."""

from __future__ import annotations

import numpy as np
from workloads import Call, Workload

from baselines.gaslam.cells import Cells
from baselines.gaslam.gaseous import gaseous
from baselines.gaslam.kernel_map import KernelMap
from osl_env.parameters import FloatArray
from training.gas_mapping import true_mean_map

FLIGHT = 2700  # readings of a run: 270 s at 10 Hz


def tunnel_cells() -> Cells:
    """The paper's 14 x 10 x 5 cells."""
    return Cells(np.zeros(3), np.array([7.0, 2.0, 0.5]))


def course() -> FloatArray:
    """(FLIGHT, 3) m: a reading every 0.05 m from goal to random goal, as at 0.5 m/s."""
    goals = np.random.default_rng(0).uniform((0, 0, 0), (7, 2, 0.5), (100, 3))
    lengths = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(goals, axis=0), axis=1))))
    flown = np.arange(FLIGHT) * 0.05
    return np.stack([np.interp(flown, lengths, along) for along in goals.T], axis=1)


def kernel_updates() -> Workload:
    """Every reading of a run, from the empty map on."""

    def prepare() -> Call:
        places, wind, cells = course(), np.array([0.2, 0.05, 0.0]), tunnel_cells()

        def call() -> None:
            kernel_map = KernelMap(cells)
            for place in places:
                kernel_map.add(place, 3.0, wind)

        return call

    return Workload(prepare, "s", FLIGHT, 4e-6)


def maps_at_a_goal() -> Workload:
    """Mean, variance, confidence and the gaseous cells once, when all readings of a run are in."""

    def prepare() -> Call:
        kernel_map, wind = KernelMap(tunnel_cells()), np.array([0.2, 0.05, 0.0])
        readings = np.random.default_rng(1).exponential(30, FLIGHT)
        places = course()
        for place, reading in zip(places[1:], readings[1:], strict=True):
            kernel_map.add(place, reading, wind)

        def call() -> object:
            kernel_map.add(places[0], 3.0, wind)  # or the maps would be those of the call before
            return gaseous(kernel_map.mean, 5.0, kernel_map.measured), kernel_map.variance

        return call

    return Workload(prepare, "s", 1)


def truth_of_a_run() -> Workload:
    """The mean over 270 s of the filaments of GaSLAM's case A at 700 cells."""

    def prepare() -> Call:
        cells = tunnel_cells()
        return lambda: true_mean_map("tunnel-a", 0, cells, 270.0)

    return Workload(prepare, "s", 1)


WORKLOADS_GASLAM = {
    "gaslam: kernel update, 700 cells": kernel_updates(),
    "gaslam: maps at a goal, 700 cells": maps_at_a_goal(),
    "gaslam: true mean map, 270 s": truth_of_a_run(),
}
