"""Pictures of the law's forces: cohesion over the distance and around robots, obstacles, and the goal in a plume."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from baselines.swarm.law import LawParameters, cohesion_force
from osl_env.geometry import Geometry
from osl_env.parameters import FloatArray
from training.figures import PALETTE
from training.reproduce.swarm.force_checks import Sensed, radial

_TEXT, _PRINTED = PALETTE[0], PALETTE[1]
_SOLID = "#8c8c8c"
_ARROW: dict[str, Any] = {"angles": "xy", "units": "inches", "zorder": 4}


@dataclass(frozen=True)
class Goal:
    """Robots in a plume, and what eq 1 makes of it."""

    positions: FloatArray  # (n, 2) m
    readings: FloatArray  # (n,) temporal means
    uphill: FloatArray  # (n, 2) m/s, k1 grad C
    upwind: FloatArray  # (n, 2) m/s, -k2 U
    plume: FloatArray  # (n_y, n_x)
    unit: str


def cohesion_over_distance(laws: dict[str, tuple[LawParameters, float]]) -> Figure:
    """A panel an arena, its law and delta_d, m: eq 5 with the sign of the text and as printed, for q = 1."""
    figure = Figure(figsize=(5.2 * len(laws), 4.2), layout="constrained")
    axes = figure.subplots(1, len(laws), squeeze=False)[0]
    for axis, (title, (law, delta_d)) in zip(axes, laws.items(), strict=True):
        near, far = law.repulsion_distance, law.attraction_distance
        parts = [np.linspace(0.25 * near, near, 200)[:-1], np.array([near, far]), np.linspace(far, delta_d, 200)[1:]]
        for sign, colour, line, label in ((1.0, _TEXT, "-", "text (ours)"), (-1.0, _PRINTED, "--", "printed")):
            signed = law._replace(sign=sign)
            forces = [radial(parts[0], signed), np.zeros(2), radial(parts[2], signed)]
            for k, (distances, force) in enumerate(zip(parts, forces, strict=True)):
                axis.plot(distances, force, line, color=colour, linewidth=2.0, label=label if k == 0 else None)
        largest = 1.35 * max(law.attraction_gain / far**2, law.repulsion_gain / near**2)
        linear = 0.2 * law.attraction_gain / delta_d**2
        axis.set_yscale("symlog", linthresh=linear)
        axis.set_ylim(-4 * largest, 4 * largest)
        decades = 10.0 ** np.arange(np.ceil(np.log10(2.0 * linear)), np.log10(4 * largest))
        ticks = [*-decades[::-1], 0.0, *decades]
        axis.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
        axis.minorticks_off()
        axis.axhline(0.0, color="0.5", linewidth=0.8)
        for name, place in (("R1", near), ("R2", far)):
            axis.axvline(place, color="0.5", linewidth=0.9, linestyle=":")
            axis.annotate(name, (place, 1.0), xycoords=("data", "axes fraction"), xytext=(3, -12),
                          textcoords="offset points", fontsize=9)  # fmt: skip
        axis.set(xlabel="distance to the neighbour, m", xlim=(0.0, delta_d))
        axis.set_title(title, fontsize=10)
    axes[0].set_ylabel("force, m/s (log); positive pulls")
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=2, fontsize=9, frameon=False)
    figure.suptitle("Cohesion between two robots (eq 5), q = 1", fontsize=11)
    return figure


def cohesion_field(law: LawParameters, robots: FloatArray, weights: FloatArray, delta_d: float) -> Figure:
    """What `robots` (n, 2) m with odor `weights` q (n,) together do to another one, wherever it is."""
    low, high = robots.min(axis=0) - 0.75, robots.max(axis=0) + 0.75
    spacing = 0.06
    x, y = np.meshgrid(*(np.arange(a, b + spacing, spacing) for a, b in zip(low, high, strict=True)))
    offset = np.zeros((*x.shape, len(robots), 3))
    offset[..., :2] = robots - np.stack([x, y], axis=-1)[..., None, :]
    heard = np.linalg.norm(offset, axis=-1) <= delta_d
    force = (cohesion_force(offset, weights, law) * heard[..., None]).sum(axis=-2)[..., :2]
    figure = Figure(figsize=(8.2, 6.4), layout="constrained")
    axis: Any = figure.subplots()
    _directions(figure, axis, (x, y), force, "force on another robot, m/s", 0.8 * spacing)
    angle = np.linspace(0.0, 2.0 * np.pi, 100)
    for (centre_x, centre_y), weight in zip(robots, weights, strict=True):
        for radius, line in ((law.repulsion_distance, "-"), (law.attraction_distance, ":")):
            axis.plot(centre_x + radius * np.cos(angle), centre_y + radius * np.sin(angle), line, color="black",
                      linewidth=1.0)  # fmt: skip
        axis.scatter(centre_x, centre_y, s=40 + 160 * weight, c=_TEXT, edgecolors="white", zorder=5)
        axis.annotate(f"q = {weight:g}", (centre_x, centre_y), xytext=(9, 9), textcoords="offset points", fontsize=9,
                      bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
                      zorder=6)  # fmt: skip
    axis.set(xlabel="x, m", ylabel="y, m", aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    figure.suptitle("Cohesion around three robots: R1 solid, R2 dotted; arrows are directions", fontsize=11)
    return figure


def obstacle_field(geometry: Geometry, size: tuple[float, float], there: Sensed, spacing: float) -> Figure:
    """The obstacle force where it is not zero, over the arena."""
    felt = np.linalg.norm(there.forces, axis=1) > 0.0
    figure = Figure(figsize=(10.5, 6.6), layout="constrained")
    axis: Any = figure.subplots()
    places = there.places[felt]
    title = "force away from obstacles and walls, m/s"
    _directions(figure, axis, (places[:, 0], places[:, 1]), there.forces[felt, :2], title, 0.85 * spacing)
    _draw_boxes(axis, geometry)
    axis.set(xlabel="x, m", ylabel="y, m", aspect="equal", xlim=(0.0, size[0]), ylim=(0.0, size[1]))
    figure.suptitle("Obstacle force (eq 8) by the range sensors; arrows are directions", fontsize=11)
    return figure


def _directions(figure: Figure, axis: Any, places: Any, force: FloatArray, label: str, length: float) -> None:
    """Arrows of one length, their colours the strength on a log scale; none where there is no force."""
    strength = np.linalg.norm(force, axis=-1)
    unit = np.divide(force, strength[..., None], out=np.full(force.shape, np.nan), where=strength[..., None] > 0.0)
    positive = strength[strength > 0.0]
    norm = LogNorm(float(positive.min()), float(np.quantile(positive, 0.995)))
    coloured = np.where(strength > 0.0, strength, np.nan)
    arrows = axis.quiver(
        *places, unit[..., 0], unit[..., 1], coloured, norm=norm, cmap="viridis_r", scale_units="xy",
        scale=1.0 / length, width=0.014, headwidth=4, headlength=4, headaxislength=3.5, pivot="mid", **_ARROW,
    )  # fmt: skip
    figure.colorbar(arrows, ax=axis, label=label, format="%g", shrink=0.85)


def goal_vectors(goal: Goal, geometry: Geometry, size: tuple[float, float], source: FloatArray) -> Figure:
    """Each robot's two wishes and their sum, as directions, over the plume."""
    figure = Figure(figsize=(10.5, 6.6), layout="constrained")
    axis: Any = figure.subplots()
    top = 10.0 ** np.ceil(np.log10(np.quantile(goal.plume, 0.999)))
    norm = LogNorm(top * 1e-3, top)
    shades = np.ma.masked_less(goal.plume, top * 1e-3)
    image = axis.imshow(shades, norm=norm, cmap="YlOrBr", origin="lower", extent=(0.0, size[0], 0.0, size[1]))
    figure.colorbar(image, ax=axis, label=f"concentration, {goal.unit}", format="%g", shrink=0.85)
    _draw_boxes(axis, geometry)
    for vectors, colour, width, metres, label in (
        (goal.upwind, PALETTE[5], 0.032, 0.28, "upwind, -k2 U"),
        (goal.uphill, PALETTE[2], 0.042, 0.34, "uphill, k1 grad C"),
        (goal.uphill + goal.upwind, "black", 0.016, 0.26, "goal vector G"),
    ):
        length = np.linalg.norm(vectors, axis=1, keepdims=True)
        unit = np.divide(vectors, length, out=np.full(vectors.shape, np.nan), where=length > 0.0)
        axis.quiver(*goal.positions.T, *unit.T, scale_units="xy", scale=1.0 / metres, color=colour, width=width,
                    label=label, **_ARROW)  # fmt: skip
    axis.scatter(*goal.positions.T, s=30, c=PALETTE[0], edgecolors="white", zorder=5, label="robot")
    axis.scatter(*source[:2], marker="*", s=170, c="black", edgecolors="white", zorder=5, label="source")
    axis.set(xlabel="x, m", ylabel="y, m", aspect="equal", xlim=(0.0, size[0]), ylim=(0.0, size[1]))
    figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=9, frameon=False)
    figure.suptitle("Goal vector (eq 1) in a plume; arrows are directions", fontsize=11)
    return figure


def _draw_boxes(axis: Any, geometry: Geometry) -> None:
    for low_x, low_y, _, high_x, high_y, _ in geometry.boxes:
        axis.add_patch(Rectangle((low_x, low_y), high_x - low_x, high_y - low_y, color=_SOLID, zorder=3))
