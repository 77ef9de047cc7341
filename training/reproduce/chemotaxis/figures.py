"""Flight times as strips: a row a cell, a dot a seed, and the paper's single flight beside them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from training.figures import PALETTE
from training.reproduce.chemotaxis.cells import FlownCell

_OURS, _PAPER, _PINNED = PALETTE[0], PALETTE[1], PALETTE[6]
_SCATTER = 0.22  # of a row's height: dots of equal times lie above each other
_INCHES_PER_ROW = 0.42
_NAMES = ("ours, one flight a seed", "ours, 10-90 % of the seeds", "ours, median", "ours, pinned seed", "paper")


@dataclass(frozen=True)
class Panel:
    """One axes: a title, and a labelled cell in each row."""

    title: str
    rows: tuple[tuple[str, FlownCell], ...]


def strips(panels: Sequence[Panel], title: str) -> Figure:
    """Panels side by side on one scale of time; rows from the top."""
    n_rows = max(len(panel.rows) for panel in panels)
    width = 2.2 + 3.4 * len(panels) if len(panels) > 1 else 7.5
    figure = Figure(figsize=(width, 1.9 + _INCHES_PER_ROW * n_rows), layout="constrained")
    # rows of different panels bear the same labels: said once
    axes = figure.subplots(1, len(panels), squeeze=False, sharex=True, sharey=True)[0]
    for axis, panel in zip(axes, panels, strict=True):
        for row, (_, cell) in enumerate(panel.rows):
            _strip(axis, row, cell)
        axis.set_title(panel.title, fontsize=10)
        axis.set_xlabel("flight time, s")
        axis.grid(axis="x", alpha=0.3)
    axes[0].set_yticks(range(n_rows), [label for label, _ in panels[0].rows])
    axes[0].set_ylim(n_rows - 0.5, -0.5)
    axes[0].set_xlim(left=0.0)
    figure.get_layout_engine().set(wspace=0.06)  # type: ignore[union-attr, call-arg]
    _legend(figure, axes)
    figure.suptitle(title, fontsize=11)
    return figure


def _legend(figure: Figure, axes: Sequence[Any]) -> None:
    """One entry a kind of mark, whichever panel shows it."""
    marks = {name: handle for axis in axes for handle, name in zip(*axis.get_legend_handles_labels(), strict=True)}
    shown = [name for name in _NAMES if name in marks]
    figure.legend(
        [marks[name] for name in shown],
        shown,
        loc="outside lower center",
        ncols=5 if len(axes) > 1 else 3,
        fontsize=8,
        frameon=False,
    )


def _strip(axis: Any, row: int, cell: FlownCell) -> None:
    times = cell.times
    low, high = cell.spread
    seeds, interval, middle, pinned, paper = _NAMES
    if times.size:
        heights = row + _SCATTER * np.linspace(-1.0, 1.0, times.size + 2)[1:-1]
        axis.plot([low, high], [row, row], color=_OURS, linewidth=7, alpha=0.25, solid_capstyle="butt", label=interval)
        axis.plot(times, heights, "o", color=_OURS, markersize=3, alpha=0.7, linestyle="none", label=seeds)
        axis.plot(cell.median, row, "|", color=_OURS, markersize=15, markeredgewidth=2, linestyle="none", label=middle)
    if not math.isnan(cell.pinned_time):
        axis.plot(
            cell.pinned_time, row, "o", markerfacecolor="none", markeredgecolor=_PINNED, markersize=6.5,
            linestyle="none", label=pinned, zorder=4,
        )  # fmt: skip
    if not math.isnan(cell.paper):
        axis.plot(cell.paper, row, "D", color=_PAPER, markersize=6, linestyle="none", label=paper, zorder=3)
    if cell.failures:
        axis.annotate(
            f"{len(cell.records) - cell.n_successes} failed", (1.0, row), xycoords=("axes fraction", "data"),
            xytext=(-3, 7), textcoords="offset points", ha="right", fontsize=7, color="#b00020",
        )  # fmt: skip
