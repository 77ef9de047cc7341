"""Workloads of the Gaussian puffs: the long series at many receptors, and a tick and a reading in batches of worlds."""

from __future__ import annotations

import numpy as np
from workloads import Call, Workload

from osl_env.air import uniform_air
from osl_env.geometry import open_air
from osl_env.plumes.base import Scene
from osl_env.plumes.puff import GaussianPuffPlume, puff_series


def hour_at_receptors(n_receptors: int) -> Workload:
    """1 h of one source, a puff and a reading each second: FastGaussianPuff takes 2.8 s at 1000 receptors.

    Its kind of case: a methane source 2.5 m above the ground in the middle of a site of 100 x 100 m, with the receptors
    up to 10 m high; wind of 3 m/s that swings through 280 degrees; air of class C; puffs end after 60 s.
    """

    def prepare() -> Call:
        plume = GaussianPuffPlume(
            gas_unit="ppm",
            molar_mass=16.04,
            release_rate=3500 / 3600,
            interval=1.0,
            step=1.0,
            max_age=60.0,
            rise=0.0,
            ground=0.0,
            dispersion={"kind": "briggs_open_country", "stability": "C"},
            steady_start=False,
        )
        time = np.arange(3600.0)
        angle = 0.7 * np.pi * np.sin(time / 300.0) + 0.3 * np.sin(time / 37.0)
        winds = 3.0 * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(time)], axis=-1)
        receptors = np.random.default_rng(0).uniform((-50, -50, 0), (50, 50, 10), (n_receptors, 3))
        source = np.array([[0.0, 0.0, 2.5]])
        return lambda: puff_series(plume, source, winds, receptors)

    return Workload(prepare, "s", 1, 0.3 if n_receptors == 1000 else None)


def tick_and_reading(n_envs: int) -> Workload:
    """A tick of the chemotaxis plume (51 puffs) and a reading in each world."""

    def prepare() -> Call:
        plume = GaussianPuffPlume(ground=-1.0)
        air = uniform_air(n_envs)
        air.mean[:] = (2.0, 0.0, 0.0)
        positions = np.random.default_rng(0).uniform((10, 10, 0), (30, 20, 10), (n_envs, 1, 3))
        sources = np.tile((10.0, 15.0, 5.0), (n_envs, 1, 1))
        area = np.array([30.0, 30.0, 10.0])
        scene = Scene(sources, np.ones((n_envs, 1)), air, open_air(), area, positions)
        state = plume.allocate(n_envs, 1)
        rows, due, out = np.arange(n_envs), np.ones(n_envs, np.bool_), np.zeros((n_envs, 1))
        plume.begin(state, scene, rows, rows)

        def call() -> None:
            plume.advance(state, scene, due)
            plume.read(state, scene, positions, due, out)

        return call

    return Workload(prepare, "1/s", n_envs)


WORKLOADS_PUFF = {
    "puffs, 1 h at 1000 receptors": hour_at_receptors(1000),
    "puffs, 1 h at 8 receptors": hour_at_receptors(8),
    "puffs, tick and reading, 1 world": tick_and_reading(1),
    "puffs, tick and reading, 256 worlds": tick_and_reading(256),
}
