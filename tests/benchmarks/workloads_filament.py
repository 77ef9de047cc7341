"""Workloads of the filament plume: updates, readings (against the number of filaments), and many worlds at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from workloads import Call, Workload

from osl_env.air import uniform_air
from osl_env.arena import Arena
from osl_env.geometry import open_air
from osl_env.plumes.base import Scene
from osl_env.plumes.filament import FilamentPlume

AREA = (100.0, 60.0, 30.0)
LONG_AREA = (910.0, 60.0, 30.0)  # in which the plume is 900 m long, not 90 m
THOUSAND = 11.5  # filaments/s that are 1000 in the arena at once
WORLDS = 256


def developed(
    n_envs: int, rate: float, area: tuple[float, float, float] = AREA
) -> tuple[FilamentPlume, Any, Scene, Any]:
    """A plume in a wind of 1 m/s that has filled the arena; the model, its state, the scene, and all worlds due."""
    plume = FilamentPlume(filament_rate=rate, max_age=1.5 * area[0])
    air = uniform_air(n_envs)
    air.mean[:, 0] = 1.0
    sources = np.tile((10.0, 30.0, 15.0), (n_envs, 1, 1))
    scene = Scene(sources, np.ones((n_envs, 1)), air, open_air(), np.array(area), np.zeros((n_envs, 3, 3)))
    state, due = plume.allocate(n_envs, 1, Arena(size=area)), np.ones(n_envs, bool)
    plume.begin(state, scene, np.arange(n_envs), np.arange(n_envs))
    for _ in range(int(2.6 * area[0])):
        plume.advance(state, scene, due)
    return plume, state, scene, due


def update() -> Call:
    plume, state, scene, due = developed(1, THOUSAND)
    return lambda: plume.advance(state, scene, due)


def update_of_many_worlds() -> Call:
    plume, state, scene, due = developed(WORLDS, 50.0)
    return lambda: plume.advance(state, scene, due)


def readings(rate: float, area: tuple[float, float, float] = AREA) -> Call:
    """100 readings at random places of the plume's box."""
    plume, state, scene, due = developed(1, rate, area)
    places = np.random.default_rng(0).uniform((10.0, 20.0, 5.0), (area[0], 40.0, 25.0), (1, 100, 3))
    out = np.empty((1, 100))
    return lambda: plume.read(state, scene, places, due, out)


def filaments_of_many_worlds() -> int:
    """Live filaments in the workload of many worlds: 50/s for some 90 s in each."""
    return int(developed(1, 50.0)[1].live[0]) * WORLDS


def bytes_per_filament() -> float:
    """Memory of a world's plume for each filament, the working space of an ordering included."""
    state = FilamentPlume().allocate(1, 1, Arena(size=AREA))
    keys_order_and_cells = 3 * 4.0  # 32-bit numbers; at most as many cells as filaments
    return float(sum(array.nbytes for array in state)) / state.bodies.shape[2] + keys_order_and_cells


SHORT, LONG = "filaments: 100 readings of 1000", "filaments: 100 readings of 10,000*"  # * in a 10 x longer plume
WORKLOADS_FILAMENT = {
    "filaments: update of 1000": Workload(update, "s", 1, 20e-6),
    SHORT: Workload(lambda: readings(THOUSAND), "s", 1, 40e-6),
    LONG: Workload(lambda: readings(THOUSAND, LONG_AREA), "s", 1),
    "filaments: 100 readings of 16,000": Workload(lambda: readings(16 * THOUSAND), "s", 1),
    "filaments: 256 worlds, a filament": Workload(update_of_many_worlds, "s", WORLDS * 4500, 10e-9),
}
