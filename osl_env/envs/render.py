"""Pictures of an episode with matplotlib: the plume, the UAVs' tracks coloured by their readings, the source, a belief.

The plume is shown by two slices through the first source, as shades of log10 of the present hit rate or concentration:
the horizontal one lies on the floor, the vertical one along the far wall. This is for people to look at: it shows the
source, which no observation does.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from osl_env.geometry import SOLID
from osl_env.parameters import FloatArray
from osl_env.world import World

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LOG_RATE_SHOWN = (-3.0, 0.5)  # decades of the hit rate, 1/s, that the slices shade
_DECADES_SHOWN = 3.0  # of a concentration, below its largest value in the horizontal slice
_SLICE_POINTS = 60  # along the longer side
_SOURCE_COLOUR = "#d62728"
_MAX_NAMED = 8  # UAVs with lines of their own in the legend: more would cover the scene
_MARKERS = 40  # of detections along the longest side
_MAX_BLOCKS = 400  # of solid cells that are drawn: each takes about a millisecond
_TICKS = 8  # intervals along the longest side, of which at most 6 are shown: a flat box has room for one upwards


class TrackRecorder:
    """Keeps where the UAVs of one world have been and what they read there, and draws it."""

    def __init__(self, world: World, env: int = 0) -> None:
        """Begin with the present state of world `env`, right after its reset."""
        self.world, self.env = world, env
        self.positions: list[FloatArray] = []
        self.readings: list[FloatArray] = []
        self.record()

    def record(self) -> None:
        """Note the present positions and readings."""
        self.positions.append(self.world.motion["position"][self.env].copy())
        self.readings.append(self.world.senses["reading"][self.env].copy())

    def draw(self, particles: FloatArray | None = None, size: tuple[int, int] = (800, 500)) -> NDArray[np.uint8]:
        """The scene as an RGB image (height, width, 3); `size` is (width, height) in pixels. `particles` (n, 3) m."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        figure = self.figure(particles, size)
        canvas: Any = FigureCanvasAgg(figure)
        canvas.draw()
        image: NDArray[np.uint8] = np.asarray(canvas.buffer_rgba())[..., :3].copy()
        return image

    def figure(self, particles: FloatArray | None = None, size: tuple[int, int] = (800, 500)) -> Figure:
        """The scene as a matplotlib figure of `size` (width, height) pixels."""
        from matplotlib.figure import Figure
        from matplotlib.ticker import MaxNLocator

        figure = Figure(figsize=(size[0] / 100, size[1] / 100), dpi=100)
        axes: Any = figure.add_axes((0.02, -0.04, 0.84, 1.06), projection="3d", computed_zorder=False)
        area = self.world.scenario.arena.size
        axes.set(
            xlim=(0, area[0]), ylim=(0, area[1]), zlim=(0, area[2]), xlabel="x (m)", ylabel="y (m)", zlabel="z (m)"
        )
        axes.set_box_aspect(area, zoom=1.0)
        for axis, side in zip((axes.xaxis, axes.yaxis, axes.zaxis), area, strict=True):
            bins = max(1, min(6, round(_TICKS * side / max(area))))
            axis.set_major_locator(MaxNLocator(bins, steps=[1, 2, 2.5, 5, 10]))
        axes.view_init(elev=28, azim=-58)
        self._draw_plume(axes, figure)
        self._draw_obstacles(axes)
        self._draw_wind(axes)
        if particles is not None:
            axes.scatter(*particles.T, s=4, c="#555555", alpha=0.5, label="particles", zorder=3)
        self._draw_tracks(axes)
        sources = self.world.source_position[self.env]
        axes.scatter(*sources.T, marker="*", s=160, c=_SOURCE_COLOUR, edgecolors="white", label="source", zorder=6)
        clock = float(self.world.episode["clock"][self.env])
        axes.set_title(f"{self.world.scenario.name}, {clock / 60:.1f} min", fontsize=11, y=0.94)
        figure.legend(loc="upper left", fontsize=8)
        return figure

    def _slice(self, first: int, second: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Grids (m) and log10 hit rate of the slice that two axes span through the first source."""
        area = self.world.scenario.arena.size
        points = _SLICE_POINTS
        u, v = np.meshgrid(np.linspace(0, area[first], points), np.linspace(0, area[second], points), indexing="ij")
        places = np.empty((points, points, 3))
        places[:] = self.world.source_position[self.env, 0]
        places[..., first], places[..., second] = u, v
        rate = self.world.concentration(self.env, places)
        return u, v, np.log10(np.maximum(rate, 1e-12))

    def _draw_plume(self, axes: Any, figure: Figure) -> None:
        x, y, floor = self._slice(0, 1)
        plume = self.world.scenario.plume
        low, high = _LOG_RATE_SHOWN
        if plume.measures == "concentration":
            high = max(float(floor.max()), -9.0)
            low = high - _DECADES_SHOWN
        style = {"levels": np.linspace(low, high, 15), "cmap": "YlOrBr", "alpha": 0.75, "zorder": 0}

        def shown(values: FloatArray) -> FloatArray:
            return np.where(values > low, np.minimum(values, high), np.nan)

        shades = axes.contourf(x, y, shown(floor), zdir="z", offset=0, **style)
        x, z, wall = self._slice(0, 2)
        axes.contourf(x, shown(wall), z, zdir="y", offset=self.world.scenario.arena.size[1], **style)
        ticks = np.arange(math.ceil(low), math.floor(high) + 1)
        bar = figure.colorbar(shades, cax=figure.add_axes((0.91, 0.2, 0.015, 0.5)), ticks=ticks)
        quantity = "mean hit rate" if plume.measures == "hit_rate" else "concentration"
        bar.set_label(f"log10 of the {quantity} ({plume.unit})", fontsize=8)

    def _draw_obstacles(self, axes: Any) -> None:
        geometry = self.world.scenario.arena.geometry
        cells = [
            np.concatenate([geometry.origin + geometry.spacing * low, geometry.origin + geometry.spacing * high])
            for low, high in _blocks(geometry.cells == SOLID)
        ]
        for x0, y0, z0, x1, y1, z1 in [*geometry.boxes, *cells]:
            axes.bar3d(x0, y0, z0, x1 - x0, y1 - y0, z1 - z0, color="#888888", alpha=0.5, zorder=2)
        for x, y, radius, bottom, top in geometry.cylinders:
            angle, height = np.meshgrid(np.linspace(0, 2 * np.pi, 25), [bottom, top])
            ring = x + radius * np.cos(angle), y + radius * np.sin(angle)
            axes.plot_surface(*ring, height, color="#888888", alpha=0.5, zorder=2)

    def _draw_wind(self, axes: Any) -> None:
        wind = self.world.episode["wind"][self.env]
        speed = float(np.linalg.norm(wind))
        if speed == 0:
            return
        area = self.world.scenario.arena.size
        length = 0.15 * max(area)
        start = np.array([0.12 * area[0], 0.85 * area[1], area[2]])
        axes.quiver(*start, *(wind / speed * length), color="#1f77b4", arrow_length_ratio=0.3)
        axes.text(*start, f" wind {speed:.1f} m/s", color="#1f77b4", fontsize=8)

    def _draw_tracks(self, axes: Any) -> None:
        tracks, readings = np.stack(self.positions, axis=1), np.stack(self.readings, axis=1)
        sensor = self.world.scenario.gas_sensor
        threshold = float(getattr(sensor, "threshold", 0.0)) if sensor.reports == "concentration" else 0.0
        detection_label: str | None = "detections"
        for i, (track, reading) in enumerate(zip(tracks, readings, strict=True)):
            colour = f"C{i % 10}"
            label = f"UAV {i}" if len(tracks) <= _MAX_NAMED else "UAVs" if i == 0 else None
            axes.plot(*track.T, color=colour, linewidth=1.0, alpha=0.8, label=label, zorder=4)
            axes.scatter(*track[-1], color=colour, marker="o", s=40, edgecolors="black", zorder=6)
            detected = reading > threshold
            if self.world.scenario.in_periods:  # samples all the way: markers would cover the track
                detected = _spaced(track, detected, max(self.world.scenario.arena.size) / _MARKERS)
            if detected.any():
                strength = np.minimum(reading[detected] / (2 * sensor.scale), 1.0)
                axes.scatter(
                    *track[detected].T, c=strength, cmap="autumn_r", vmin=0, vmax=1, s=12 + 40 * strength,
                    edgecolors="black", linewidths=0.4, zorder=5, label=detection_label,
                )  # fmt: skip
                detection_label = None


def _spaced(track: FloatArray, chosen: NDArray[np.bool_], spacing: float) -> NDArray[np.bool_]:
    """Of the `chosen` (n,) places of `track` (n, 3), m, those that are `spacing` m from the one kept before."""
    kept, last = np.zeros_like(chosen), None
    for k in np.flatnonzero(chosen):
        if last is None or np.linalg.norm(track[k] - track[last]) >= spacing:
            kept[k], last = True, k
    return kept


def _blocks(solid: NDArray[np.bool_]) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Boxes of cells, low (3,) and high (3,) index, that fill `solid` (nx, ny, nz) without overlap."""
    left = solid.copy()
    for _ in range(_MAX_BLOCKS):
        if not left.any():
            return
        low = np.array(np.unravel_index(int(left.argmax()), left.shape))
        high = low + 1
        for axis in range(3):
            while high[axis] < left.shape[axis]:
                layer = [slice(a, b) for a, b in zip(low, high, strict=True)]
                layer[axis] = slice(high[axis], high[axis] + 1)
                if not left[tuple(layer)].all():
                    break
                high[axis] += 1
        left[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = False
        yield low, high
