"""Figures of benchmarks, as PNG: policies side by side, or curves over a swept parameter."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.text import Text

from baselines import Policy
from osl_env.envs.render import TrackRecorder
from osl_env.scenario import Scenario
from osl_env.world import World
from training.benchmark import Sweep
from training.comparison import Group
from training.flight import fly
from training.overall import Profiles
from training.records import write_bytes
from training.statistics import Estimate

# Okabe and Ito's palette, told apart by colour-blind readers
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8C8C8C", "#7A5195", "#A6761D")
MARKERS = "osD^vPX*<>"
_LINES = ("-", "--", ":")
_PANELS = (("success_rate", 100.0, "success rate, %"), ("capped_search_time", 1 / 60, "capped mean search time, min"))
_ENERGY = (
    ("energy_flying", "flying (distance)"),
    ("energy_hovering", "hovering (sampling)"),
    ("energy_turning", "turning"),
    ("energy_waiting", "waiting for the slowest"),
)


def save(figure: Figure, path: Path) -> None:
    """Write `figure` to `path` (.png), whole or not at all."""
    write_bytes(path, lambda file: write_png(figure, file))


def write_png(figure: Figure, file: IO[bytes], dpi: int = 150) -> None:
    """Write `figure` into an open file."""
    _verbatim(figure)
    FigureCanvasAgg(figure)  # attaches itself: no global pyplot state
    figure.savefig(file, format="png", dpi=dpi)


def svg(figure: Figure) -> str:
    """`figure` as an SVG document without background, its texts as texts."""
    _verbatim(figure)
    file = io.StringIO()
    FigureCanvasSVG(figure)
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "osl"}):
        figure.savefig(file, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    return file.getvalue()


def _verbatim(figure: Figure) -> None:
    """A dollar in a label is a dollar, not the beginning of a formula."""
    for text in figure.findobj(Text):
        text.set_parse_math(False)


def profile_lines(profiles: Profiles) -> Figure:
    """Performance profiles: the share of the episodes that have found the source, over the search time."""
    figure = Figure(figsize=(7.5, 4.6), layout="constrained")
    axis = figure.subplots()
    minutes = profiles.thresholds / 60
    for k, (label, profile) in enumerate(profiles.of.items()):
        colour, line = PALETTE[k % len(PALETTE)], _LINES[k // len(PALETTE) % len(_LINES)]
        axis.plot(minutes, profile.share * 100, label=label, linewidth=1.6, color=colour, linestyle=line)
        axis.fill_between(minutes, profile.low * 100, profile.high * 100, color=colour, alpha=0.15, linewidth=0)
    axis.set_xlim(0.0, float(minutes[-1]))
    axis.set_ylim(0.0, 101.0)
    axis.set_xlabel("search time, min")
    axis.set_ylabel("episodes with the source found, %")
    axis.grid(alpha=0.3)
    figure.legend(loc="outside right upper", fontsize=8, frameon=False)
    return figure


def last_moment(policy: Policy, scenario: Scenario, seed: int) -> Figure:
    """The episode with `seed` flown again, as it ended: tracks, plume, source, and the winner's (or UAV 0's) belief."""
    recorder: list[TrackRecorder] = []

    def watch(world: World) -> None:
        if recorder:
            recorder[0].record()
        else:
            recorder.append(TrackRecorder(world))

    flight = fly(policy, scenario, [seed], watch=watch)
    belief = flight.team[0][max(0, int(flight.world.episode["winner"][0]))].belief()
    return recorder[0].figure(None if belief is None else belief.particles)


def side_by_side(groups: Sequence[Group], title: str) -> Figure:
    """One row a scenario; success rate left, capped mean search time right; a policy is a dot, the best in orange.

    Without a title the scenarios' names are left out as well, for a page that says them.
    """
    n_policies = max(len(group.rows) for group in groups)
    figure = Figure(figsize=(9.0, 1.0 + len(groups) * (0.7 + 0.27 * n_policies)), layout="constrained")
    axes = figure.subplots(len(groups), 2, squeeze=False)
    for group, (rate, time) in zip(groups, axes, strict=True):
        rows = sorted(group.rows, key=lambda row: -row.estimates["capped_search_time"].value)
        for axis, (measure, scale, label) in zip((rate, time), _PANELS, strict=True):
            for height, row in enumerate(rows):
                colour = PALETTE[1] if row.best else PALETTE[0]
                _dot(axis, height, row.estimates[measure], scale, colour)
            axis.set_yticks(range(len(rows)), [row.label for row in rows] if axis is rate else [""] * len(rows))
            axis.set_xlabel(label)
            axis.grid(axis="x", alpha=0.3)
        rate.set_xlim(0.0, 102.0)
        time.set_xlim(0.0, rows[0].result.case.cell.scenario.ending.time_limit / 60 * 1.02)
        if title:
            rate.set_title(group.scenario, loc="left", fontsize=10)
    figure.suptitle(title, fontsize=11)
    return figure


def _dot(axis: Any, height: int, estimate: Estimate, scale: float, colour: str) -> None:
    axis.plot(estimate.value * scale, height, "o", color=colour, markersize=5, clip_on=False, zorder=3)
    if not math.isnan(estimate.low):
        axis.plot([estimate.low * scale, estimate.high * scale], [height, height], color=colour, linewidth=1.5)


def curves(groups: Sequence[Group], title: str, sweep: Sweep | None) -> Figure:
    """Success rate and capped mean search time over the swept value (or the scenarios), one curve a policy.

    Scenarios that are swept each have a column of their own, the rate above the time.
    """
    by_scenario: dict[str, list[Group]] = {}
    for group in groups:
        by_scenario.setdefault("" if sweep is None else group.scenario, []).append(group)
    n = len(by_scenario)
    figure = Figure(figsize=(9.5, 4.2) if n == 1 else (1.5 + 3.6 * n, 7.2), layout="constrained")
    axes = figure.subplots(1, 2, squeeze=False).T if n == 1 else figure.subplots(2, n, squeeze=False, sharey="row")
    labels = list(dict.fromkeys(row.label for group in groups for row in group.rows))
    for (name, members), column in zip(by_scenario.items(), axes.T, strict=True):
        _curves(column, members, labels, sweep)
        if n > 1:
            column[0].set_title(name, fontsize=10)
            column[0].set_xlabel("")
    for axis in axes[:, 1:].flat:
        axis.set_ylabel("")
    for rate, time in axes.T:  # after all curves: an axis that others share keeps the limits that it is given
        rate.set_ylim(0.0, 103.0)
        time.set_ylim(bottom=0.0)
    handles, names = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=min(len(names), 6), fontsize=8, frameon=False)
    figure.suptitle(title, fontsize=11)
    return figure


def _curves(axes: Sequence[Any], groups: Sequence[Group], labels: Sequence[str], sweep: Sweep | None) -> None:
    """The curves of one scenario (or one curve over the scenarios), a measure an axis."""
    finite = all(group.value is not None and math.isfinite(group.value) for group in groups)
    places = [float(group.value or 0.0) for group in groups] if finite else [float(k) for k in range(len(groups))]
    width = (max(places) - min(places)) / max(len(places) - 1, 1)
    for k, label in enumerate(labels):
        shift = (k - (len(labels) - 1) / 2) * 0.05 * width  # intervals of neighbouring curves do not hide each other
        points = [
            (place + shift, row.estimates)
            for place, group in zip(places, groups, strict=True)
            for row in group.rows
            if row.label == label
        ]
        for axis, (measure, scale, _) in zip(axes, _PANELS, strict=True):
            values = np.array([[*estimates[measure]] for _, estimates in points]) * scale
            bars = np.abs(values[:, 1:].T - values[:, 0])
            axis.errorbar(
                [x for x, _ in points],
                values[:, 0],
                yerr=bars,
                color=PALETTE[k % len(PALETTE)],
                marker=MARKERS[k % len(MARKERS)],
                markersize=4.5,
                linewidth=1.3,
                elinewidth=0.8,
                label=label,
            )
    for axis, (_, _, name) in zip(axes, _PANELS, strict=True):
        axis.set_ylabel(name)
        axis.set_xlabel((sweep.label or sweep.key) if sweep else "scenario")
        axis.set_xticks(places, _ticks(groups), rotation=0 if max(map(len, _ticks(groups))) <= 10 else 15)
        axis.grid(alpha=0.3)


def _ticks(groups: Sequence[Group]) -> list[str]:
    return [
        group.scenario if group.value is None else "∞" if math.isinf(group.value) else f"{group.value:g}"
        for group in groups
    ]


def energy_bars(groups: Sequence[Group], title: str) -> Figure:
    """The team's energy an episode, split by kind, for every policy and scenario."""
    figure = Figure(figsize=(9.0, 1.2 + 0.34 * sum(len(group.rows) + 1 for group in groups)), layout="constrained")
    axis = figure.subplots()
    names: list[str] = []
    height = 0
    ticks = []
    for group in groups:
        for row in group.rows:
            start = 0.0
            for k, (kind, label) in enumerate(_ENERGY):
                kilojoule = row.estimates[kind].value * 1e-3
                axis.barh(
                    height, kilojoule, left=start, color=PALETTE[k], label=label if height == 0 else None, height=0.7
                )
                start += kilojoule
            names.append(f"{row.label}, {group.scenario}" if len(groups) > 1 else row.label)
            ticks.append(height)
            height += 1
        height += 1
    axis.set_yticks(ticks, names)
    axis.invert_yaxis()
    axis.set_xlabel("energy of the team an episode, kJ")
    axis.grid(axis="x", alpha=0.3)
    axis.set_axisbelow(True)
    figure.legend(loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    figure.suptitle(title, fontsize=11)
    return figure
