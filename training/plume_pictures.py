"""Pictures of plumes: a horizontal slice through the source's height, and a vertical one along the mean wind.

Readings are shades on a log scale of four decades below the largest, with the unit at the colour bar; white is less. A
wind without gas is shown by its speed, on a linear scale. Arrows are the present wind, each where it blows; a single
one stands for a wind that is the same everywhere. What does not change in time is animated by lifting the horizontal
slice through all heights.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

from osl_env.parameters import FloatArray
from training.plume_subjects import Subject
from training.records import write_bytes

_SHADES = 140  # along the longer side of a slice
_ARROWS = 14  # along the longer side
_DECADES = 4
_SOURCE_COLOUR, _START_COLOUR, _WIND_COLOUR = "#d62728", "#0072B2", "#33669e"
_WIND_ON_SPEED_COLOUR = "#ffffff"  # arrows over the shades of a speed
_ANIMATION_DPI = 80
_WIDE, _HIGH, _MARGIN = 6.5, 6.0, 0.7  # inches: widest and highest panel, room for labels
_FLATTEST = 0.15  # height over length of the upright slice, below which its heights are drawn larger


@dataclass(frozen=True)
class Plane:
    """A rectangle in space: places are start + a * along + b * across, a and b between their ends."""

    start: FloatArray  # (3,) m
    along: FloatArray  # (3,) unit vectors
    across: FloatArray
    a: tuple[float, float]  # m
    b: tuple[float, float]

    def places(self, n_a: int, n_b: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The centres of `n_a` x `n_b` cells: their a (n_a,), b (n_b,), m, and places (n_b, n_a, 3), m."""
        a = self.a[0] + (self.a[1] - self.a[0]) * (np.arange(n_a) + 0.5) / n_a
        b = self.b[0] + (self.b[1] - self.b[0]) * (np.arange(n_b) + 0.5) / n_b
        return a, b, self.start + a[None, :, None] * self.along + b[:, None, None] * self.across

    @property
    def sides(self) -> tuple[float, float]:
        """Lengths, m."""
        return self.a[1] - self.a[0], self.b[1] - self.b[0]

    def cells(self, longest: int) -> tuple[int, int]:
        """Cells along a and b, about square, `longest` along the longer side."""
        sides = self.sides
        n_a, n_b = (max(1, round(longest * side / max(sides))) for side in sides)
        return n_a, n_b


def horizontal(subject: Subject, height: float) -> Plane:
    """The plane at `height`, m."""
    x, y, z = np.eye(3)
    low, high = subject.low, subject.high
    return Plane(z * height, x, y, (float(low[0]), float(high[0])), (float(low[1]), float(high[1])))


def upright(subject: Subject) -> Plane:
    """The upright plane along the mean wind through the first source; a is the distance downwind of it."""
    centre, along = subject.centre, subject.downwind
    ends = []
    for towards in (-1.0, 1.0):
        free = [
            ((high if towards * step > 0 else low) - at) / (towards * step)
            for at, step, low, high in zip(centre, along, subject.low, subject.high, strict=True)
            if abs(step) > 1e-9
        ]
        ends.append(towards * max(min(free), 0.0))
    ground = np.array([centre[0], centre[1], 0.0])
    z_ends = (float(subject.low[2]), float(subject.high[2]))
    return Plane(ground, along, np.array([0.0, 0.0, 1.0]), (ends[0], ends[1]), z_ends)


class Panel:
    """One plane of a picture, drawn once and brought up to date as time goes on."""

    def __init__(self, axes: Any, subject: Subject, plane: Plane, norm: Normalize) -> None:
        """Draw the present."""
        self.axes, self.subject, self.plane = axes, subject, plane
        self._least = float(norm.vmin or 0.0)
        _, _, self._places = plane.places(*plane.cells(_SHADES))
        extent = (*plane.a, *plane.b)
        colours = "viridis" if subject.unit == "m/s" else "YlOrBr"
        style = {"origin": "lower", "extent": extent, "interpolation": "nearest"}
        self.image = axes.imshow(self._shades(), norm=norm, cmap=colours, aspect="auto", **style)
        solid = subject.solid(self._places)
        if solid.any():
            grey = np.zeros((*solid.shape, 4))
            grey[solid] = (0.55, 0.55, 0.55, 1.0)
            axes.imshow(grey, aspect="auto", **style)
        axes.set(xlim=plane.a, ylim=plane.b)
        self._draw_arrows()

    def _shades(self) -> Any:
        readings = self.subject.readings(self._places)
        return np.ma.masked_less(readings, self._least) if self._least > 0 else readings

    def _draw_arrows(self) -> None:
        subject, plane = self.subject, self.plane
        speed = float(np.linalg.norm(subject.wind))
        if subject.uniform_wind:
            a, b, places = plane.places(1, 1)
            a, b = self._clear_corner()
            length = 0.1 * max(plane.sides)
        else:
            n_a, n_b = plane.cells(_ARROWS)
            a, b, places = plane.places(n_a, n_b)
            length = 0.9 * plane.sides[0] / n_a
        self._arrow_places = places
        speed = max(speed, 1.5 * float(np.linalg.norm(subject.winds(places), axis=-1).mean()), 1e-3)
        u, v = self._arrow_sides()
        self.arrows = self.axes.quiver(
            a, b, u, v, angles="xy", scale_units="xy", scale=speed / length, pivot="middle",
            color=_WIND_ON_SPEED_COLOUR if subject.unit == "m/s" else _WIND_COLOUR,
            units="inches", width=0.016 if not subject.uniform_wind else 0.032, alpha=0.8, zorder=3,
        )  # fmt: skip

    def _clear_corner(self) -> tuple[FloatArray, FloatArray]:
        """The a and b of the corner that is farthest from the source, a little inside."""
        plane, away = self.plane, self.subject.centre - self.plane.start
        source = np.array([away @ plane.along, away @ plane.across])
        low, sides = np.array([plane.a[0], plane.b[0]]), np.array(plane.sides)
        corners = low + sides * np.array([[0.12, 0.85], [0.88, 0.85], [0.12, 0.15], [0.88, 0.15]])
        best = corners[np.argmax(np.linalg.norm(corners - source, axis=1))]
        return best[:1], best[1:]

    def _arrow_sides(self) -> tuple[FloatArray, FloatArray]:
        winds = self.subject.winds(self._arrow_places)
        winds[self.subject.solid(self._arrow_places)] = np.nan
        return winds @ self.plane.along, winds @ self.plane.across

    def update(self) -> None:
        """Draw the present."""
        self.image.set_data(self._shades())
        if self.subject.changes:
            self.arrows.set_UVC(*self._arrow_sides())

    def lift(self, height: float) -> None:
        """Show the horizontal plane at another height, m."""
        self._places[..., 2] = height
        self.image.set_data(self._shades())


class Picture:
    """A figure of two panels: `horizontal` above and `upright` below, side by side where the box is deep."""

    def __init__(self, subject: Subject) -> None:
        """Draw the present of `subject`."""
        self.subject = subject
        flat, wall = horizontal(subject, float(subject.centre[2])), upright(subject)
        self.figure, (top, bottom, side) = _layout(flat, wall)
        norm = _norm(subject, (flat, wall))
        self.flat, self.wall = Panel(top, subject, flat, norm), Panel(bottom, subject, wall, norm)
        top.set(xlabel="x (m)", ylabel="y (m)")
        where = "of the source" if len(subject.sources) else "of the middle"
        bottom.set(xlabel=f"distance downwind {where} (m)", ylabel="z (m)")
        self._draw_marks(top, bottom)
        bar = self.figure.colorbar(self.flat.image, cax=side, format="%g")
        bar.set_label(f"{subject.quantity} ({subject.unit})")
        self._title = self.figure.text(0.5, 0.985, "", ha="center", va="top", fontsize=10)
        self._say(float(subject.centre[2]))

    def _draw_marks(self, top: Any, bottom: Any) -> None:
        subject, wall = self.subject, self.wall.plane
        if len(subject.sources):
            star = {"marker": "*", "s": 130, "c": _SOURCE_COLOUR, "edgecolors": "white", "zorder": 5}
            top.scatter(subject.sources[:, 0], subject.sources[:, 1], label="source", clip_on=False, **star)
            bottom.scatter([0.0], [subject.centre[2]], clip_on=False, **star)
        if len(subject.starts):
            look = {"marker": "^", "s": 36, "c": _START_COLOUR, "edgecolors": "white", "zorder": 5, "clip_on": False}
            top.scatter(*subject.starts.T[:2], label="UAV start", **look)
        ends = wall.start[:2] + np.outer(wall.a, wall.along[:2])
        top.plot(*ends.T, color="#888888", linewidth=0.8, linestyle=":", label="other slice", zorder=2)
        self._level = bottom.axhline(subject.centre[2], color="#888888", linewidth=0.8, linestyle=":", zorder=2)
        left, _, _, above = self.flat.axes.get_position().extents
        handles, labels = top.get_legend_handles_labels()
        place: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (left, above), "borderaxespad": 0.2}
        self.figure.legend(handles, labels, **place, ncols=3, fontsize=8, frameon=False)

    def _say(self, height: float) -> None:
        subject = self.subject
        speed = float(np.linalg.norm(subject.wind))
        when = f", {subject.time:.0f} s" if subject.changes else ""
        words = f"{subject.name}: {subject.quantity} at z = {height:.3g} m{when}; mean wind {speed:.2g} m/s"
        self._title.set_text(words)

    def update(self) -> None:
        """Draw the present."""
        self.flat.update()
        self.wall.update()
        self._say(float(self.subject.centre[2]))

    def lift(self, height: float) -> None:
        """Show the horizontal slice at `height`, m."""
        self.flat.lift(height)
        self._level.set_ydata([height, height])
        self._say(height)


def _layout(flat: Plane, wall: Plane) -> tuple[Figure, list[Any]]:
    """A figure with axes for both panels, in the proportions of their planes, and for the colour bar.

    All by hand, in inches: an automatic layout leaves gaps about panels of fixed proportions, and costs time in every
    picture of an animation.
    """
    (width, depth), (length, height) = flat.sides, wall.sides
    beside = depth > 1.2 * width
    w_1 = _WIDE * width / depth if beside else min(_WIDE, _HIGH * width / depth)
    w_2 = _WIDE if beside else w_1
    h_1, h_2 = w_1 * depth / width, w_2 * min(max(height / length, _FLATTEST), 1.0)
    if beside:
        below, left = _MARGIN, _MARGIN + w_1 + _MARGIN
        places = [(_MARGIN, below, w_1, h_1), (left, below, w_2, h_2)]
    else:
        below = _MARGIN + h_2 + _MARGIN
        places = [(_MARGIN, below, w_1, h_1), (_MARGIN, _MARGIN, w_2, h_2)]
    right = max(x + w for x, _, w, _ in places)
    size = right + 1.3, below + max(h_1, h_2 if beside else 0.0) + 0.75
    places.append((right + 0.2, _MARGIN, 0.2, size[1] - 0.75 - _MARGIN))
    figure = Figure(figsize=size)
    axes = [figure.add_axes((x / size[0], y / size[1], w / size[0], h / size[1])) for x, y, w, h in places]
    return figure, axes


def _norm(subject: Subject, planes: tuple[Plane, ...]) -> Normalize:
    """The scale of the shades: from what is in `planes` now."""
    readings = [subject.readings(plane.places(*plane.cells(_SHADES))[2]).ravel() for plane in planes]
    largest = max(float(values.max()) for values in readings)
    if subject.unit == "m/s":
        return Normalize(0.0, largest or 1.0)
    decade = 10.0 ** math.floor(math.log10(largest)) if largest > 0 else 1.0
    top = next(step * decade for step in (1, 2, 5, 10) if step * decade >= largest * 0.999)
    return LogNorm(top * 10.0**-_DECADES, top)


def moments(picture: Picture, seconds: float, frames: int) -> Iterator[None]:
    """Bring `picture` on by `seconds` in `frames` steps; or lift its slice through the heights if nothing changes."""
    subject = picture.subject
    if subject.changes:
        for _ in range(frames):
            subject.go_on(seconds / frames)
            picture.update()
            yield
        return
    low, high = float(subject.low[2]), float(subject.high[2])
    for height in low + (high - low) * (np.arange(frames) + 0.5) / frames:
        picture.lift(float(height))
        yield


def page(figure: Figure, dpi: int = _ANIMATION_DPI) -> Any:
    """`figure` as a page of an animation: a PIL image with a palette (an octree's: the median cut loses thin lines)."""
    from PIL.Image import Quantize, fromarray

    figure.set_dpi(dpi)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy()).quantize(method=Quantize.FASTOCTREE)


def write_gif(pages: list[Any], path: Path, fps: float) -> None:
    """Write `pages` as an endless animation of `fps` pages a second, whole or not at all."""
    settings = {"save_all": True, "append_images": pages[1:], "duration": round(1000 / fps), "loop": 0}
    write_bytes(path, lambda file: pages[0].save(file, format="GIF", **settings))
