"""A watched flight as snapshots side by side, and as an animation.

The plume's shades are on a log scale, three decades below the largest concentration away from the source; white is
less. Arrows are the wind, blue dots the robots with their latest tracks, the black star is the source.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from training.figures import PALETTE
from training.plume_pictures import page
from training.reproduce.swarm.film import Film, Moment

_ROBOT, _SOURCE, _WIND, _SOLID = PALETTE[0], "black", "#5f7f9f", "#8c8c8c"
_COLUMNS, _ROWS, _WIDE = 3, 2, 3.6  # snapshots, and the width of one, inches
_PAGE = 6.4  # inches, the width of the arena in an animation
_DECADES = 3
_LARGEST = 0.999  # quantile of the concentrations over all moments: the source itself is far above the plume
_TRAIL = 0.08  # of the flight: what is drawn of the tracks


class Panel:
    """One moment of a film, drawn once and brought up to date."""

    def __init__(self, axes: Any, film: Film) -> None:
        """Draw the first moment."""
        self.film, self.axes = film, axes
        self.trail = max(1, round(_TRAIL * len(film.times)))
        moment = film.moments[0]
        extent = (0.0, film.size[0], 0.0, film.size[1])
        self.image = axes.imshow(
            _visible(moment, film), norm=shades(film), cmap="YlOrBr", origin="lower", extent=extent,
            interpolation="nearest",
        )  # fmt: skip
        places = film.wind_places
        spacing = film.size[0] / places.shape[1]
        fastest = max(float(np.quantile(np.linalg.norm(one.wind, axis=-1), 0.95)) for one in film.moments)
        self.arrows = axes.quiver(
            places[..., 0], places[..., 1], moment.wind[..., 0], moment.wind[..., 1], angles="xy", scale_units="xy",
            scale=max(fastest, 1e-3) / (0.85 * spacing), pivot="middle", color=_WIND, units="inches", width=0.010,
            alpha=0.55, zorder=2,
        )  # fmt: skip
        for low_x, low_y, _, high_x, high_y, _ in film.geometry.boxes:
            axes.add_patch(Rectangle((low_x, low_y), high_x - low_x, high_y - low_y, color=_SOLID, zorder=3))
        for x, y, radius, *_ in film.geometry.cylinders:
            axes.add_patch(Circle((x, y), radius, color=_SOLID, zorder=3))
        self.tracks = LineCollection([], colors=_ROBOT, linewidths=0.8, alpha=0.6, zorder=4)
        axes.add_collection(self.tracks)
        self.robots = axes.scatter([], [], s=22, c=_ROBOT, edgecolors="white", linewidths=0.6, zorder=6)
        axes.scatter(*film.source[:2], marker="*", s=150, c=_SOURCE, edgecolors="white", zorder=5)
        axes.set(xlim=extent[:2], ylim=extent[2:], aspect="equal")
        self.show(moment)

    def show(self, moment: Moment) -> None:
        """Draw `moment`."""
        film = self.film
        self.image.set_data(_visible(moment, film))
        self.arrows.set_UVC(moment.wind[..., 0], moment.wind[..., 1])
        robots = film.tracks[moment.step]
        self.robots.set_offsets(robots)
        since = max(0, moment.step - self.trail)
        self.tracks.set_segments(list(np.moveaxis(film.tracks[since : moment.step + 1], 1, 0)))
        self.axes.set_title(f"{film.times[moment.step]:.0f} s", fontsize=10)


def shades(film: Film) -> LogNorm:
    """The scale of the plume's shades, one for all moments."""
    largest = float(np.quantile(np.stack([moment.plume for moment in film.moments]), _LARGEST))
    top = 10.0 ** np.ceil(np.log10(largest)) if largest > 0 else 1.0
    return LogNorm(top * 10.0**-_DECADES, top)


def _visible(moment: Moment, film: Film) -> Any:
    return np.ma.masked_less(moment.plume, float(shades(film).vmin or 0.0))


def snapshots(film: Film, title: str) -> Figure:
    """Moments evenly spread over the flight, the start and the end among them."""
    count = min(_COLUMNS * _ROWS, len(film.moments))
    chosen = [film.moments[k] for k in np.linspace(0, len(film.moments) - 1, count).round().astype(int)]
    height = _WIDE * film.size[1] / film.size[0]
    figure = Figure(figsize=((_WIDE + 0.2) * _COLUMNS + 1.9, (height + 0.35) * _ROWS + 0.8), layout="constrained")
    axes = figure.subplots(_ROWS, _COLUMNS, sharex=True, sharey=True)
    image: Any = None
    for axis, moment in zip(axes.flat, chosen, strict=False):
        panel = Panel(axis, film)
        panel.show(moment)
        image = panel.image
    for axis in axes.flat[count:]:
        axis.set_visible(False)
    for axis in axes[-1]:
        axis.set_xlabel("x, m")
    for axis in axes[:, 0]:
        axis.set_ylabel("y, m")
    unit = film.cell.scenario.plume.unit
    figure.colorbar(image, ax=axes, label=f"concentration, {unit}", format="%g", shrink=0.8)
    figure.suptitle(title, fontsize=11)
    return figure


def pages(film: Film, title: str) -> Iterator[Any]:
    """The pages of an animation, one a moment."""
    width = _PAGE
    height = width * film.size[1] / film.size[0]
    figure = Figure(figsize=(width + 1.7, height + 1.25))
    size = figure.get_size_inches()
    axes = figure.add_axes((0.65 / size[0], 0.55 / size[1], width / size[0], height / size[1]))
    panel = Panel(axes, film)
    axes.set(xlabel="x, m", ylabel="y, m")
    side = figure.add_axes(((0.65 + width + 0.15) / size[0], 0.55 / size[1], 0.18 / size[0], height / size[1]))
    figure.colorbar(panel.image, cax=side, label=f"concentration, {film.cell.scenario.plume.unit}", format="%g")
    figure.suptitle(title, fontsize=11)
    for moment in film.moments:
        panel.show(moment)
        yield page(figure)
