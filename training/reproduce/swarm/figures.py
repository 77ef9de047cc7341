"""Search time over the number of robots, as the paper draws it: a panel a number of obstacles, a line an emission or
a policy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from training.figures import MARKERS, PALETTE
from training.reproduce.swarm.averages import Pool
from training.reproduce.swarm.runs import Setting

_COLUMNS = 3  # of the legend, below each panel
_OFFSET = 0.02  # of the axis' width, between the lines: their intervals do not hide each other


def time_over_team(
    pool: Pool, settings: Sequence[Setting], title: str, panel_of: Callable[[Setting], str],
    line_of: Callable[[Setting], str],
) -> Figure:  # fmt: skip
    """Mean search time, failed runs as the limit, with its interval; the share of failed runs at the point, if any."""
    panels, lines = ([*dict.fromkeys(map(name, settings))] for name in (panel_of, line_of))
    teams = sorted({setting.n_robots for setting in settings})
    figure = Figure(figsize=(2.0 + 3.2 * len(panels) if len(panels) > 1 else 7.5, 4.3), layout="constrained")
    axes = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
    for axis, panel in zip(axes, panels, strict=True):
        for k, line in enumerate(lines):
            members = [one for one in settings if panel_of(one) == panel and line_of(one) == line]
            shift = (k - (len(lines) - 1) / 2) * _OFFSET * (teams[-1] - teams[0] or 1)
            _line(axis, pool, sorted(members, key=lambda one: one.n_robots), line, k, shift)
        axis.set_title(panel, fontsize=10)
        axis.set_xlabel("robots, N")
        axis.set_xticks(teams)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("search time, s")
    axes[0].set_ylim(bottom=0.0)
    handles, names = axes[0].get_legend_handles_labels()
    columns = min(len(names), _COLUMNS * len(panels))
    figure.legend(handles, names, loc="outside lower center", ncols=columns, fontsize=9, frameon=False)
    figure.suptitle(title, fontsize=11)
    return figure


def _line(axis: Any, pool: Pool, settings: Sequence[Setting], label: str, k: int, shift: float) -> None:
    if not settings:
        return
    means = np.array([pool.mean([setting]).estimate for setting in settings])
    colour = PALETTE[k]
    axis.errorbar(
        [setting.n_robots + shift for setting in settings],
        means[:, 0],
        yerr=np.abs(means[:, 1:].T - means[:, 0]),
        color=colour, marker=MARKERS[k], markersize=5, linewidth=1.4, elinewidth=0.9, capsize=2, label=label,
    )  # fmt: skip
    for setting, (mean, _, high) in zip(settings, means, strict=True):
        failed = 1.0 - pool.flown[setting].success.value
        if failed > 0.0:
            top = mean if np.isnan(high) else high
            axis.annotate(
                f"{failed * 100:.0f} %", (setting.n_robots + shift, top), xytext=(0, 3), textcoords="offset points",
                ha="center", fontsize=7, color=colour,
            )  # fmt: skip
