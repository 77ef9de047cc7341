"""Workloads of the fields: loading one as large as those that ship, and playing one back in batches of worlds."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from workloads import Call, Workload

from osl_env.air import uniform_air
from osl_env.arena import Arena
from osl_env.fields import Field, read_field, save_field
from osl_env.geometry import open_air
from osl_env.plumes.base import Scene
from osl_env.plumes.field import FieldPlume
from osl_env.winds.field import FieldWind

SIZE = (6.0, 4.0, 2.0)  # m
_FOLDER = tempfile.TemporaryDirectory(prefix="osl-fields-")  # removed at the end of the process


def eddies(n_t: int = 400, cell: float = 0.05) -> Field:
    """100 s at 4 Hz of eddies that drift along x in an arena of 6 x 4 m, which turn over in some seconds, and gas."""
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(0, SIZE[0], cell), np.arange(0, SIZE[1], cell), indexing="ij")
    times = 0.25 * np.arange(n_t)
    wind = np.zeros((n_t, *x.shape, 1, 3), np.float32)
    wind[..., 0] = 0.5
    for _ in range(12):
        kx, ky = rng.normal(0, 4, 2)  # 1/m
        rate, phase = rng.normal(0.5 * kx, 1.0), rng.uniform(0, 2 * np.pi)
        wave = 0.05 * np.sin(kx * x + ky * y - rate * times[:, None, None] + phase)[..., None]
        wind[..., 0] += ky / np.hypot(kx, ky) * wave
        wind[..., 1] -= kx / np.hypot(kx, ky) * wave
    gas = np.abs(wind[..., 1]) * 100
    return Field(times, np.full(3, cell / 2), np.full(3, cell), wind, gas, period=100.0)


def loading() -> Workload:
    """A wind field of 4 x 6 m at 5 cm, 4 Hz, 100 s."""

    def prepare() -> Call:
        path = Path(_FOLDER.name) / "wind.npz"
        field = eddies()
        save_field(Field(field.times, field.origin, field.spacing, field.wind, period=field.period), path)
        return lambda: read_field(path)

    return Workload(prepare, "s", 1, 0.2)


def playing(n_envs: int) -> Workload:
    """A tick of wind and gas from a field, and a reading in each world."""

    def prepare() -> Call:
        path, arena = Path(_FOLDER.name) / "both.npz", Arena(size=SIZE)
        save_field(eddies(40), path)
        wind, plume = FieldWind(field=str(path), random_start=True), FieldPlume(fields=(str(path),), random_start=True)
        air, played = wind.allocate(n_envs, arena), plume.allocate(n_envs, 1, arena)
        positions = np.random.default_rng(0).uniform(0, 1, (n_envs, 1, 3)) * SIZE
        nothing = np.zeros((n_envs, 1, 3))
        scene = Scene(nothing, np.ones((n_envs, 1)), uniform_air(n_envs), open_air(), np.array(SIZE), positions)
        rows, due, out = np.arange(n_envs), np.ones(n_envs, np.bool_), np.zeros((n_envs, 1))
        wind.begin(air, rows, rows, 0.0)
        plume.begin(played, scene, rows, rows)
        clock = np.zeros(n_envs)

        def call() -> None:
            clock[:] += 0.1
            wind.advance(air, due, clock, 0.1)
            plume.advance(played, scene, due)
            plume.read(played, scene, positions, due, out)

        return call

    return Workload(prepare, "s", n_envs)


WORKLOADS_FIELDS = {
    "field of 4x6 m, load": loading(),
    "field, a tick and a reading, 1 world": playing(1),
    "field, a tick and a reading, 256 worlds": playing(256),
}
