"""Pictures of single flights: the path in space by mode and by concentration, from above, and heights over time.

Places are in the paper's coordinates. A piece of the path bears the mode that the policy was in while it was flown, and
the concentration at its end; what is under four decades below the flight's largest is grey.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm, to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.ticker import FuncFormatter, MultipleLocator, NullFormatter
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from osl_env.parameters import FloatArray
from training.figures import PALETTE
from training.reproduce.chemotaxis.cells import FlownCell
from training.reproduce.chemotaxis.tracks import Track, in_paper_coordinates

MODE_COLOURS = {"scan": PALETTE[0], "search": PALETTE[1]}
_OTHER_MODE = PALETTE[7]
_SOURCE, _START, _BOUNDS, _FAINT, _WIND = "#d62728", "#222222", "#8c8c8c", "#c9c9c9", "#33669e"
_DECADES = 4
_ARROW = 4.0  # m in the plan
_BEYOND = 1.0  # m shown outside the bounds: a flight may leave them by a little
_AXES = ("x, m", "y, m", "z, m")
_STAR: dict[str, Any] = {
    "marker": "*",
    "color": _SOURCE,
    "markersize": 13,
    "markeredgecolor": "white",
    "markeredgewidth": 0.6,
}
_SQUARE: dict[str, Any] = {"marker": "s", "color": _START, "markersize": 6}
_RING: dict[str, Any] = {
    "marker": "o",
    "markersize": 10,
    "markerfacecolor": "none",
    "markeredgecolor": PALETTE[2],
    "markeredgewidth": 2,
}
_PLAIN = FuncFormatter(lambda value, _: f"{value:g}")  # figures are saved without formulas


def flight_picture(cell: FlownCell, track: Track) -> Figure:
    """One flight: two views in space, the plan, height and concentration over time."""
    figure = Figure(figsize=(12.0, 9.0))  # placed by hand: no layout engine knows how much of a 3D axes is empty
    by_mode: Any = figure.add_axes((0.0, 0.47, 0.43, 0.48), projection="3d", computed_zorder=False)
    by_gas: Any = figure.add_axes((0.46, 0.47, 0.43, 0.48), projection="3d", computed_zorder=False)
    shade_bar = figure.add_axes((0.925, 0.58, 0.012, 0.26))
    plan = figure.add_axes((0.06, 0.1, 0.36, 0.36))
    height = figure.add_axes((0.51, 0.29, 0.42, 0.17))
    gas = figure.add_axes((0.51, 0.1, 0.42, 0.17), sharex=height)
    norm = _decades(track)
    for axes in (by_mode, by_gas):
        _draw_box(axes, cell)
    by_mode.add_collection3d(Line3DCollection(_pieces(track.positions), colors=_mode_colours(track), linewidths=1.5))
    shades = _gas_pieces(Line3DCollection(_pieces(track.positions), linewidths=1.8), track, norm)
    by_gas.add_collection3d(shades)
    for axes in (by_mode, by_gas):
        _mark_in_space(axes, cell, track)
    by_mode.set_title("path by mode", fontsize=10, y=0.96)
    by_gas.set_title("path by concentration", fontsize=10, y=0.96)
    figure.colorbar(shades, cax=shade_bar, label="concentration", extend="min", format=_PLAIN)
    draw_plan(plan, cell, track)
    plan.set_title("from above", fontsize=10)
    plan.set(xlabel=_AXES[0], ylabel=_AXES[1])
    draw_height(height, cell, track)
    height.set_title("height and concentration over time", fontsize=10)
    height.set_ylabel("z, m")
    height.tick_params(labelbottom=False)
    _draw_gas(gas, track, norm)
    figure.legend(handles=legend_marks(track), loc="lower center", ncols=6, fontsize=9, frameon=False)
    figure.suptitle(f"{cell.name}, seed {track.record.seed}: {outcome_text(cell, track)}", fontsize=12, y=0.985)
    return figure


def overview(
    flights: Sequence[tuple[FlownCell, Track]],
    title: str,
    draw: Callable[[Any, FlownCell, Track], None],
    labels: tuple[str, str],
) -> Figure:
    """All flights as small multiples, a row a source: `draw` fills an axes, whose `labels` are of x and y."""
    sources = list(dict.fromkeys(cell.source for cell, _ in flights))
    starts = list(dict.fromkeys(cell.start for cell, _ in flights))
    figure = Figure(figsize=(1.0 + 2.8 * len(starts), 1.2 + 2.7 * len(sources)), layout="constrained")
    axes = figure.subplots(len(sources), len(starts), squeeze=False)
    for cell, track in flights:
        row, column = sources.index(cell.source), starts.index(cell.start)
        axis = axes[row, column]
        draw(axis, cell, track)
        axis.set_title(f"{cell.name}\n{outcome_text(cell, track)}", fontsize=9)
        axis.tick_params(labelsize=8)
        if row == len(sources) - 1:
            axis.set_xlabel(labels[0])
        if column == 0:
            axis.set_ylabel(labels[1])
    marks = {str(mark.get_label()): mark for _, track in flights for mark in legend_marks(track)}
    figure.legend(handles=list(marks.values()), loc="outside lower center", ncols=6, fontsize=9, frameon=False)
    figure.suptitle(title, fontsize=12)
    return figure


def outcome_text(cell: FlownCell, track: Track) -> str:
    """`13.25 s (paper 13.10 s)`, or how the flight failed."""
    record = track.record
    ended = f"{record.search_time:.2f} s" if record.success else f"failed, {record.ended.replace('_', ' ')}"
    return f"{ended} (paper {cell.paper:.2f} s)"


def legend_marks(track: Track) -> list[Line2D]:
    """Modes that were flown, start, source, first detection and end."""
    lines = [
        Line2D([], [], color=MODE_COLOURS.get(mode, _OTHER_MODE), label=mode or "no mode", linewidth=2)
        for mode in dict.fromkeys(track.modes[1:])
    ]
    lines.append(Line2D([], [], linestyle="none", label="start", **_SQUARE))
    if track.detected.any():
        lines.append(Line2D([], [], linestyle="none", label="first detection", **_RING))
    lines.append(Line2D([], [], linestyle="none", label="source", **_STAR))
    return lines


def draw_plan(axis: Any, cell: FlownCell, track: Track) -> None:
    """The path from above, by mode, in the bounds, with the wind's direction."""
    low, high = _bounds(cell)
    pieces = _pieces(track.positions[:, :2])
    axis.add_collection(LineCollection(list(pieces), colors=_mode_colours(track), linewidths=1.3))
    box = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]], [low[0], low[1]]])
    axis.plot(*box.T, color=_BOUNDS, linewidth=1.0, zorder=1)
    axis.plot(*track.positions[0, :2], **_SQUARE, zorder=4)
    axis.plot(*_source(cell)[:2], **_STAR, zorder=5)
    reach = Circle(tuple(_source(cell)[:2]), cell.cell.scenario.ending.success_radius, fill=False, color=_SOURCE)
    reach.set(linestyle=":", linewidth=1.0)
    axis.add_patch(reach)
    if track.detected.any():
        axis.plot(*track.positions[np.argmax(track.detected), :2], **_RING, zorder=4)
    _draw_wind(axis, track, np.array([low[0], high[1] + _BEYOND]))  # above the bounds, clear of the path
    axis.set_aspect("equal")
    axis.set(xlim=(low[0] - _BEYOND, high[0] + _BEYOND), ylim=(low[1] - _BEYOND, high[1] + 2 * _BEYOND))
    axis.grid(alpha=0.25)


def _draw_wind(axis: Any, track: Track, tail: FloatArray) -> None:
    speed = float(np.linalg.norm(track.wind[:2]))
    if speed > 0.0:
        tip = tail + _ARROW * track.wind[:2] / speed
        axis.annotate("", tip, tail, arrowprops={"arrowstyle": "-|>", "color": _WIND})
        axis.text(tail[0] + 1.1 * _ARROW, tail[1], f"wind {speed:g} m/s", fontsize=8, color=_WIND, va="center")


def draw_height(axis: Any, cell: FlownCell, track: Track) -> None:
    """Height over time, by mode, in the bounds, with the source's height."""
    low, high = _bounds(cell)
    path = np.column_stack([track.times, track.positions[:, 2]])
    axis.add_collection(LineCollection(list(_pieces(path)), colors=_mode_colours(track), linewidths=1.6))
    axis.axhline(low[2], color=_BOUNDS, linewidth=1.0)
    axis.axhline(high[2], color=_BOUNDS, linewidth=1.0)
    axis.axhline(_source(cell)[2], color=_SOURCE, linewidth=1.0, linestyle="--")
    axis.plot(*path[0], **_SQUARE, clip_on=False, zorder=4)
    axis.plot(path[-1, 0], _source(cell)[2], **_STAR, clip_on=False, zorder=5)
    if track.detected.any():
        axis.plot(*path[np.argmax(track.detected)], **_RING, zorder=4)
    axis.yaxis.set_major_locator(MultipleLocator(2.0))
    axis.set(xlim=(0.0, float(track.times[-1])), ylim=(0.0, high[2] + _BEYOND))
    axis.grid(alpha=0.25)


def _draw_gas(axis: Any, track: Track, norm: LogNorm) -> None:
    least = float(norm.vmin or 0.0)
    seen = np.where(track.readings >= least, track.readings, np.nan)
    axis.semilogy(track.times, seen, color="#6a3d9a", linewidth=1.2)
    axis.yaxis.set_major_formatter(_PLAIN)
    axis.yaxis.set_minor_formatter(NullFormatter())
    axis.axhline(track.threshold, color="#222222", linewidth=1.0, linestyle=":")
    axis.text(1.01, track.threshold, "threshold", transform=axis.get_yaxis_transform(), fontsize=8, va="center")
    axis.set(xlabel="time, s", ylabel="concentration", ylim=(least, 2.0 * float(norm.vmax or 1.0)))
    axis.grid(alpha=0.25)


def _draw_box(axes: Any, cell: FlownCell) -> None:
    low, high = _bounds(cell)
    for k in range(3):
        others = [n for n in range(3) if n != k]
        for first in (low, high):
            for second in (low, high):
                edge = np.zeros((2, 3))
                edge[:, others[0]], edge[:, others[1]] = first[others[0]], second[others[1]]
                edge[:, k] = low[k], high[k]
                axes.plot(*edge.T, color=_BOUNDS, linewidth=0.8, zorder=1)
    axes.set(
        xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]), xlabel=_AXES[0], ylabel=_AXES[1],
        zlabel=_AXES[2],
    )  # fmt: skip
    axes.set_box_aspect(high - low, zoom=0.98)
    axes.zaxis.set_major_locator(MultipleLocator(2.5))
    axes.view_init(elev=28, azim=-58)


def _mark_in_space(axes: Any, cell: FlownCell, track: Track) -> None:
    axes.plot(*track.positions[:1].T, linestyle="none", **_SQUARE, zorder=5)
    if track.detected.any():
        place = track.positions[np.argmax(track.detected)]
        axes.plot(*place[:, None], linestyle="none", **_RING, zorder=5)
    source = _source(cell)
    foot = np.array([source, [source[0], source[1], _bounds(cell)[0][2]]])
    axes.plot(*foot.T, color=_SOURCE, linewidth=0.8, linestyle="--", zorder=4)
    axes.plot(*source[:, None], linestyle="none", **_STAR, zorder=6)


def _bounds(cell: FlownCell) -> tuple[FloatArray, FloatArray]:
    """The lowest and the highest corner, (3,) m, paper's coordinates."""
    return in_paper_coordinates((0.0, 0.0, 0.0)), in_paper_coordinates(cell.cell.scenario.arena.size)


def _source(cell: FlownCell) -> FloatArray:
    return in_paper_coordinates(cell.cell.scenario.sources.positions[0])


def _pieces(path: FloatArray) -> FloatArray:
    """(n - 1, 2, k) the pieces of a path (n, k)."""
    return np.stack([path[:-1], path[1:]], axis=1)


def _mode_colours(track: Track) -> list[tuple[float, float, float, float]]:
    return [to_rgba(MODE_COLOURS.get(mode, _OTHER_MODE)) for mode in track.modes[1:]]


def _decades(track: Track) -> LogNorm:
    most = max(float(track.readings.max()), track.threshold)
    return LogNorm(most / 10.0**_DECADES, most)


def _gas_pieces(pieces: Any, track: Track, norm: LogNorm) -> Any:
    """`pieces` shaded by the concentration at their ends."""
    pieces.set_cmap(colormaps["viridis"].with_extremes(under=_FAINT))
    pieces.set_norm(norm)
    pieces.set_array(np.maximum(track.readings[1:], float(norm.vmin or 0.0) * 1e-3))
    return pieces
