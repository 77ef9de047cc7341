"""Position errors along each axis as box plots on log scales: the cases side by side, in each a box a setting.

Errors below a millimetre are drawn as one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, NullFormatter

from osl_env.parameters import FloatArray
from training.figures import PALETTE
from training.reproduce.gaslam.averages import by_case, by_setting
from training.reproduce.gaslam.published import published
from training.reproduce.gaslam.runs import Flown

_PANELS: tuple[tuple[str, Callable[[Flown], FloatArray]], ...] = (
    ("PE", lambda one: one.values("pe")),
    ("along x (the wind)", lambda one: one.axis_errors()[:, 0]),
    ("along y", lambda one: one.axis_errors()[:, 1]),
    ("along z (up)", lambda one: one.axis_errors()[:, 2]),
)
_LEAST = 1e-3  # m
_GROUP = 0.84  # of the room of a case that its boxes take
_PLAIN = FuncFormatter(lambda value, _: f"{value:g}")  # figures are saved without formulas
_SCATTER = 0.18  # of a box's width: dots of equal errors lie beside each other


def error_boxes(flown: Sequence[Flown], title: str, note: str = "") -> Figure:
    """Four panels: the position error and its parts along the axes, each on its own scale; runs are dots."""
    settings, cases = list(by_setting(flown)), by_case(flown)
    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    for axes, (label, errors_of) in zip(figure.subplots(2, 2).flat, _PANELS, strict=True):
        for place, members in enumerate(cases.values()):
            for k, one in enumerate(members):
                _box(axes, place + _shift(k, len(members)), _GROUP / len(members), errors_of(one), PALETTE[k])
            paper = published(next(iter(members)).name, "pe")
            if label == "PE":
                axes.plot([place - 0.5, place + 0.5], [paper, paper], color="black", linewidth=1.0, linestyle="--")
        axes.set_xticks(range(len(cases)), [f"case {name}" for name in cases])
        axes.set_xlim(-0.5, len(cases) - 0.5)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(_PLAIN)
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.set_ylabel("position error, m" if label == "PE" else f"error {label.split(' (')[0]}, m")
        axes.set_title(label, fontsize=10)
        axes.grid(axis="y", alpha=0.3)
        for edge in np.arange(0.5, len(cases) - 0.5):
            axes.axvline(edge, color="0.85", linewidth=0.8)
    _legend(figure, settings)
    figure.suptitle(f"{title}\n{note}" if note else title, fontsize=11)
    return figure


def _shift(k: int, n: int) -> float:
    return _GROUP * ((k + 0.5) / n - 0.5)


def _box(axes: Any, place: float, width: float, errors: FloatArray, colour: str) -> None:
    if errors.size == 0:
        return
    errors = np.maximum(errors, _LEAST)
    axes.boxplot(
        errors, positions=[place], widths=0.8 * width, showfliers=False, patch_artist=True, manage_ticks=False,
        boxprops={"facecolor": colour, "alpha": 0.3, "edgecolor": colour},
        medianprops={"color": colour, "linewidth": 2}, whiskerprops={"color": colour}, capprops={"color": colour},
    )  # fmt: skip
    across = place + _SCATTER * width * np.linspace(-1.0, 1.0, errors.size)
    axes.plot(across, errors, "o", color=colour, markersize=2.5, linestyle="none", zorder=3)


def _legend(figure: Figure, settings: Sequence[str]) -> None:
    marks: list[Any] = [Patch(facecolor=PALETTE[k], alpha=0.5, label=setting) for k, setting in enumerate(settings)]
    marks += figure.axes[0].plot([], [], color="black", linewidth=1.0, linestyle="--", label="the paper's mean PE")
    figure.legend(handles=marks, loc="outside lower center", ncols=len(marks), fontsize=9, frameon=False)
