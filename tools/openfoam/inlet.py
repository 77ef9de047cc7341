"""The unsteady air at the inlet, periodic in time.

With a laminar inlet and no obstacle the plume is a perfectly steady straight line. Here the direction wanders, and both
components fluctuate with a correlation in time and along the inlet. Spectrum in time: 1 / (1 + (2 pi f T)^2)^2, with
random phases, made by Fourier series of the inlet's period, so that the flow can be looped. Along y the noise
is smoothed by a Gaussian. The mean of u over the inlet is constant: the flow as a whole does not pulse.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d
from settings import Inlet

from osl_env.parameters import FloatArray

WALL = 0.1  # share of the inlet's width at each wall over which the cross-stream component goes to 0


def _coloured(rng: np.random.Generator, n_times: int, n_places: int, step: float, time: float) -> FloatArray:
    """Periodic noise (n_times, n_places) of unit variance, correlated over `time` s, white along the places."""
    spectrum = np.fft.rfft(rng.standard_normal((n_times, n_places)), axis=0)
    frequency = np.fft.rfftfreq(n_times, step)
    spectrum *= (1.0 / (1.0 + (2.0 * np.pi * frequency * time) ** 2))[:, None]
    spectrum[0] = 0.0
    series = np.fft.irfft(spectrum, n_times, axis=0)
    return np.asarray(series / series.std())


def profiles(inlet: Inlet, y: FloatArray, width: float) -> FloatArray:
    """Velocity (n_times, n, 2), m/s, at the heights `y` (n,), m, of an inlet of `width` m, over one period."""
    rng = np.random.default_rng(inlet.seed)
    n_times = round(inlet.period / inlet.step)
    angle = inlet.angle * _coloured(rng, n_times, 1, inlet.step, inlet.angle_time)
    noise = np.stack([_coloured(rng, n_times, y.size, inlet.step, inlet.noise_time) for _ in range(2)], axis=-1)
    noise = gaussian_filter1d(noise, inlet.noise_length / (y[1] - y[0]), axis=1, mode="reflect")
    noise *= inlet.noise / noise.std(axis=(0, 1))
    noise[..., 0] -= noise[..., 0].mean(axis=1, keepdims=True)
    velocity = noise + inlet.speed * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    velocity[..., 0] *= inlet.speed / velocity[..., 0].mean(axis=1, keepdims=True)
    to_wall = np.minimum(y, width - y) / (WALL * width)
    velocity[..., 1] *= np.sin(0.5 * np.pi * np.minimum(to_wall, 1.0))
    return np.asarray(velocity)
