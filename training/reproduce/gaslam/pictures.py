"""The five maps of a run: the truth, the kernel map, its confidence, the source term's map, and the final map.

Each is cut twice: at the source's height, seen from above, and along the wind at the source's y, seen from the side,
with heights drawn larger. Concentrations share one scale over two decades below the truth's largest; white is less,
and grey is where no reading reaches. The track is the whole flight's, whatever its height.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from osl_env.parameters import FloatArray
from training.figures import PALETTE
from training.reproduce.gaslam.runs import Run

_DECADES = 2
_SOURCE, _TRACK, _UNKNOWN = "#d62728", PALETTE[0], "#d9d9d9"
_STAR: dict[str, Any] = {"marker": "*", "color": _SOURCE, "markersize": 13, "markeredgecolor": "white"}
_RING: dict[str, Any] = {  # the star under it stays to be seen
    "marker": "o",
    "markersize": 11,
    "markerfacecolor": "none",
    "markeredgecolor": PALETTE[2],
    "markeredgewidth": 2,
}
_SQUARE: dict[str, Any] = {"marker": "s", "color": "#222222", "markersize": 5, "markeredgecolor": "white"}
_GAS, _CONFIDENCE = "YlOrBr", "Blues"
_PLAIN = FuncFormatter(lambda value, _: f"{value:g}")  # figures are saved without formulas


def five_maps(run: Run, title: str) -> Figure:
    """The maps of `run` below each other, from above on the left and from the side on the right."""
    maps, track = run.landed.maps, run.landed.track
    rows: list[tuple[str, FloatArray | None]] = [
        ("truth", run.truth),
        ("kernel map", maps.kernel),
        ("confidence", maps.confidence),
        ("source term's map", maps.plume),
        ("final map", maps.final),
    ]
    figure = Figure(figsize=(12.5, 10.5), layout="constrained")
    grid = figure.subplots(len(rows), 2, sharex=True, sharey="col")
    gas = LogNorm(10.0**-_DECADES * float(run.truth.max() or 1.0), float(run.truth.max() or 1.0))
    shades: dict[str, Any] = {}
    for (name, values), pair in zip(rows, grid, strict=True):
        confidence = name == "confidence"
        norm, colours = (Normalize(0.0, 1.0), _CONFIDENCE) if confidence else (gas, _GAS)
        unknown = maps.confidence <= 0.0 if name in ("kernel map", "confidence") else np.zeros(maps.cells.n, np.bool_)
        for axes, up in zip(pair, (1, 2), strict=True):
            shades[name] = _slice(axes, run, values, unknown, up, norm, colours)
            axes.plot(track[:, 0], track[:, up], color=_TRACK, linewidth=0.5, alpha=0.4)
            _mark(axes, run, up)
        pair[0].set_title(f"{name}{_figures(run, name)}", fontsize=9, loc="left")
    _label(figure, grid, run, shades)
    source = run.landed.source
    views = f"left: from above at the source's z = {source[2]:.2f} m; right: from the side at its y = {source[1]:.2f} m"
    figure.suptitle(f"{title}\n{views}, heights enlarged", fontsize=11)
    return figure


def _slice(axes: Any, run: Run, values: FloatArray | None, unknown: Any, up: int, norm: Any, colours: str) -> Any:
    """The cells through the source as an image: x to the right, axis `up` upwards."""
    cells = run.landed.maps.cells
    across = 3 - up
    layer = np.unravel_index(cells.nearest(run.landed.source), cells.shape)[across]
    extent = (cells.low[0], cells.high[0], cells.low[up], cells.high[up])
    if values is None:
        axes.text(0.5, 0.5, "none", transform=axes.transAxes, ha="center", va="center")
        values = np.zeros(cells.n)
    shown = np.ma.masked_array(values, unknown | (values < (norm.vmin or 0.0))).reshape(cells.shape)
    style: dict[str, Any] = {"origin": "lower", "extent": extent, "interpolation": "nearest", "aspect": "auto"}
    grey = np.where(unknown.reshape(cells.shape).take(layer, axis=across).T[..., None], _rgba(_UNKNOWN), 0.0)
    axes.imshow(grey, **style)
    return axes.imshow(shown.take(layer, axis=across).T, norm=norm, cmap=colormaps[colours], **style)


def _rgba(colour: str) -> FloatArray:
    red, green, blue = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return np.array([red, green, blue, 1.0])


def _mark(axes: Any, run: Run, up: int) -> None:
    landed = run.landed
    axes.plot(landed.track[0, 0], landed.track[0, up], linestyle="none", **_SQUARE)
    axes.plot(landed.source[0], landed.source[up], linestyle="none", **_STAR)
    if landed.declared is not None:
        axes.plot(landed.declared[0], landed.declared[up], linestyle="none", **_RING)


def _figures(run: Run, name: str) -> str:
    """What is measured of a map."""
    if name == "final map":
        return f": RMSE {run.rmse:.4f}, SC {run.sc:.3f}"
    if name == "source term's map" and not np.isnan(run.rmse_ste):
        return f": RMSE {run.rmse_ste:.4f}"
    if name == "truth":
        return f", averaged over the flight; a map of zeros has RMSE {run.empty_rmse:.4f}, SC {run.empty_sc:.3f}"
    return ""


def _label(figure: Figure, grid: Any, run: Run, shades: dict[str, Any]) -> None:
    for label, column in zip(("y, m", "z, m"), grid.T, strict=True):
        for axes in column:
            axes.set_ylabel(label)
        column[-1].set_xlabel("x, m")
    low, high = run.landed.maps.cells.low, run.landed.maps.cells.high
    grid[0, 0].set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    grid[0, 1].set_ylim(low[2], high[2])
    for name, rows in (("truth", slice(0, 2)), ("confidence", slice(2, 3)), ("final map", slice(3, 5))):
        label = name if name == "confidence" else "concentration"
        extend = "neither" if name == "confidence" else "min"
        bar = figure.colorbar(shades[name], ax=grid[rows, :], label=label, extend=extend, format=_PLAIN, pad=0.02)
        bar.ax.tick_params(labelsize=8)
    marks = [
        Line2D([], [], linestyle="none", label="source", **_STAR),
        Line2D([], [], linestyle="none", label="declared", **_RING),
        Line2D([], [], linestyle="none", label="start", **_SQUARE),
        Line2D([], [], color=_TRACK, linewidth=1.0, label="track"),
        Line2D([], [], marker="s", linestyle="none", color=_UNKNOWN, markersize=9, label="no reading"),
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=len(marks), fontsize=9, frameon=False)
