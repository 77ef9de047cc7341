"""What a plume says of the mean on its axis, against the plume itself."""

from __future__ import annotations

import numpy as np
import pytest

from osl_env.air import uniform_air
from osl_env.geometry import open_air
from osl_env.parameters import FloatArray
from osl_env.plumes.base import PlumeModel, Scene
from osl_env.plumes.field import FieldPlume
from osl_env.plumes.filament import FilamentPlume
from osl_env.plumes.pseudo_gaussian import PseudoGaussianPlume
from osl_env.plumes.puff import GaussianPuffPlume

SOURCE = np.array([10.0, 25.0, 25.0])
SPEED = 1.5  # m/s
DISTANCES = np.array([5.0, 8.0, 12.0])  # m; nearer and farther, the length of a puff counts


def mean_on_axis(plume: PlumeModel, n_envs: int, ticks: int, samples: int) -> FloatArray:
    """The mean over worlds, and over `samples` 2 s apart after `ticks`, at DISTANCES."""
    from osl_env.arena import Arena

    arena = Arena(size=(60.0, 50.0, 50.0))
    air = uniform_air(n_envs)
    air.mean[:, 0] = SPEED
    places = np.tile(SOURCE + np.outer(DISTANCES, [1.0, 0.0, 0.0]), (n_envs, 1, 1))
    scene = Scene(np.tile(SOURCE, (n_envs, 1, 1)), np.ones((n_envs, 1)), air, open_air(), np.array(arena.size), places)
    due, state = np.ones(n_envs, np.bool_), plume.allocate(n_envs, 1, arena)
    plume.begin(state, scene, np.arange(n_envs), np.arange(n_envs))
    readings = []
    for k in range(ticks + samples * 4 if plume.tick is not None else 1):
        plume.advance(state, scene, due)
        if plume.tick is None or (k >= ticks and k % 4 == 0):
            readings.append(np.empty((n_envs, len(DISTANCES))))
            plume.read(state, scene, places, due, readings[-1])
    mean: FloatArray = np.mean(readings, axis=(0, 1))
    return mean


@pytest.mark.parametrize(
    ("plume", "tolerance"),
    [
        (PseudoGaussianPlume(), 1e-12),
        (GaussianPuffPlume(interval=0.1, step=0.5, rise=0.0, ground=None), 0.01),
        # 32 worlds x 50 samples; the variance is about the mean times 0.35 c0, correlated for some 2 s: under 3 % each
        (FilamentPlume(floor="open"), 0.1),
    ],
    ids=lambda value: getattr(value, "kind", ""),
)
def test_the_mean_on_the_axis_is_what_the_plume_gives(plume: PlumeModel, tolerance: float) -> None:
    found = mean_on_axis(plume, 32, 60, 50)
    told = [plume.axis_mean(x, SPEED) for x in DISTANCES]
    np.testing.assert_allclose(found, told, rtol=tolerance)


def test_a_plume_that_cannot_say_it_says_infinity_and_calm_air_is_finite() -> None:
    assert FieldPlume().axis_mean(3.0, 1.0) == np.inf
    for plume in (PseudoGaussianPlume(), GaussianPuffPlume(), FilamentPlume()):
        assert 0 < plume.axis_mean(3.0, 0.0) < np.inf
