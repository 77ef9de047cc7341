"""The picture of a field: its wind and a plume in it at one moment, and how strongly the wind fluctuates."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from osl_env.fields import Field
from osl_env.parameters import FloatArray

_ARROWS = 30  # along the wind


def draw(field: Field, gas: FloatArray, path: Path) -> None:
    """Draw the last frame with the gas (nx, ny), relative to its largest value, and the rms of the wind across."""
    assert field.wind is not None
    low, high = field.low, field.high
    extent = (low[0], high[0], low[1], high[1])
    solid = np.ma.masked_where(field.free[:, :, 0].T, np.ones(field.shape[1::-1]))
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 3.4), layout="constrained")
    share = np.log10(np.maximum(gas / gas.max(), 1e-3)).T
    image = left.imshow(share, origin="lower", extent=extent, cmap="YlOrBr", interpolation="bilinear")
    figure.colorbar(image, ax=left, label="log10 of gas, relative", shrink=0.8)
    _arrows(left, field)
    rms = np.ma.masked_where(~field.free[:, :, 0].T, field.wind[:, :, :, 0, 1].std(axis=0).T)
    image = right.imshow(rms, origin="lower", extent=extent, cmap="viridis")
    figure.colorbar(image, ax=right, label="rms of v, m/s", shrink=0.8)
    for axes in (left, right):
        axes.imshow(solid, origin="lower", extent=extent, cmap="gray", vmin=0, vmax=2)
        axes.set(xlabel="x, m", ylabel="y, m")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=80)
    plt.close(figure)


def _arrows(axes: Axes, field: Field) -> None:
    assert field.wind is not None
    every = max(field.shape[0] // _ARROWS, 1)
    x, y = field.centres("x")[every // 2 :: every], field.centres("y")[every // 2 :: every]
    wind = field.wind[-1, every // 2 :: every, every // 2 :: every, 0]
    axes.quiver(x, y, wind[..., 0].T, wind[..., 1].T, color="steelblue", scale=20, width=0.002)
