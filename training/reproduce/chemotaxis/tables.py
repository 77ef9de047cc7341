"""The cells' statistics as tables of an 80-column terminal, and as plain rows for files."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Group as Lines
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from training.report import MISSING, number, with_interval
from training.reproduce.chemotaxis.cells import (
    BASE,
    FlownCell,
    by_setting,
    by_source,
    difference_of_means,
    mean_over_starts,
    ratio_of_means,
)
from training.statistics import NOTHING, Estimate, wilson

Column = tuple[str, Callable[[FlownCell], str]]

FOOTNOTES = (
    "Flight time: from the start to {radius:g} m from the source, of the successes; [ ]: 95 % intervals, bootstrapped "
    "over the seeds, of success rates Wilson's; 10-90 %: quantiles over the seeds.\n"
    "Paper: one flight each. Ours / paper: our mean over that one flight; the interval is of our mean alone, as a "
    "single flight has none.\n"
    "Pinned: the flight with the first seed. First detection: the first reading over the sensor's threshold, "
    "median over the seeds; never: no detection in most flights."
)


def _range(low: float, high: float) -> str:
    return MISSING if math.isnan(low) else f"{low:.1f}-{high:.1f}"


def _detection(cell: FlownCell) -> str:
    return "never" if math.isinf(cell.detection) else number(cell.detection, 2)


def _ratio(estimate: Estimate) -> str:
    return with_interval(estimate, digits=2 if estimate.high < 10 else 1)


def _success(estimate: Estimate, successes: int, trials: int) -> str:
    return f"{successes}/{trials} [{estimate.low * 100:.0f}, {estimate.high * 100:.0f}]"


_TIMES: tuple[Column, ...] = (
    ("success\nn [95 %]", lambda cell: _success(cell.success, cell.n_successes, len(cell.records))),
    ("paper\ns", lambda cell: number(cell.paper, 2)),
    ("mean\ns", lambda cell: number(cell.mean.value)),
    ("median\ns", lambda cell: number(cell.median)),
    ("10-90 %\ns", lambda cell: _range(*cell.spread)),
    ("ours / paper\n[95 %]", lambda cell: _ratio(cell.ratio)),
)
_PINNED: tuple[Column, ...] = (
    ("pinned\ns", lambda cell: number(cell.pinned_time, 2)),
    ("pinned\n/ paper", lambda cell: number(cell.pinned_time / cell.paper, 2)),
    ("first detection\nmedian, s", _detection),
    ("10-90 %\ns", lambda cell: _range(*cell.detection_spread)),
    ("failures", lambda cell: cell.failures or "none"),
)


def source_tables(cells: Sequence[FlownCell]) -> RenderableType:
    """Two tables a source: flight times beside the paper's, and the pinned flight with the first detection."""
    parts: list[RenderableType] = []
    for source, members in by_source(cells).items():
        if members:
            parts += [Text(f"Source {source}: flight time", style="bold"), _flight_times(members), Text()]
            title = f"Source {source}: pinned flight (seed {members[0].pinned.seed}), first detection, failures"
            parts += [Text(title, style="bold"), _table(members, _PINNED), Text()]
    return Lines(*parts)


def _flight_times(cells: Sequence[FlownCell]) -> Table:
    table = _table(cells, _TIMES)
    table.add_section()
    paper = sum(cell.paper for cell in cells) / len(cells)
    mean = number(mean_over_starts(cells).value)
    ratio = _ratio(ratio_of_means(cells))
    table.add_row("mean", _pooled(cells), number(paper, 2), mean, "", "", ratio, style="bold")
    return table


def _pooled(cells: Sequence[FlownCell]) -> str:
    successes, trials = sum(cell.n_successes for cell in cells), sum(len(cell.records) for cell in cells)
    return _success(wilson(successes, trials), successes, trials)


def _plain_table(first: str, columns: Sequence[str]) -> Table:
    table = Table(padding=(0, 1, 0, 0), box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
    table.add_column(first, no_wrap=True)
    for header in columns:
        table.add_column(header, justify="right", no_wrap=header != "failures")
    return table


def _table(cells: Sequence[FlownCell], columns: Sequence[Column]) -> Table:
    table = _plain_table("Initial", [header for header, _ in columns])
    for cell in cells:
        table.add_row(str(cell.start), *(text(cell) for _, text in columns))
    return table


_SETTING: tuple[Column, ...] = (
    _TIMES[0],
    *_TIMES[2:5],
    ("first\ndetection s", _detection),
)


def setting_tables(cells: Sequence[FlownCell]) -> RenderableType:
    """A table a setting, each with its difference from the base, and one with the means over the starts."""
    settings = by_setting(cells)
    base = settings[BASE]
    parts: list[RenderableType] = [Text("mean over the five starts", style="bold"), _overview(settings), Text()]
    for setting, members in settings.items():
        table = _plain_table("Initial", [*(header for header, _ in _SETTING), "mean less\nbase, s"])
        for cell, reference in zip(members, base, strict=True):
            change = math.nan if setting == BASE else cell.mean.value - reference.mean.value
            figures = (text(cell) for _, text in _SETTING)
            table.add_row(str(cell.start), *figures, MISSING if math.isnan(change) else f"{change:+.1f}")
        parts += [Text(setting, style="bold"), table, Text()]
    return Lines(*parts)


def _overview(settings: dict[str, list[FlownCell]]) -> Table:
    headers = ("success\nn [95 %]", "flight time s\n[95 %]", "less base s\n[95 %]", "pinned\ns")
    table = _plain_table("setting", headers)
    for setting, members in settings.items():
        change = NOTHING if setting == BASE else difference_of_means(members, settings[BASE])
        pinned = sum(cell.pinned_time for cell in members) / len(members)
        mean = mean_over_starts(members)
        table.add_row(setting, _pooled(members), with_interval(mean), with_interval(change), number(pinned, 2))
    return table


def plain_rows(cells: Sequence[FlownCell]) -> list[dict[str, Any]]:
    """One row a cell, SI units, None where there is no value: the lines of the CSV and JSON tables."""
    return [{key: _value(value) for key, value in _row(cell).items()} for cell in cells]


def _row(cell: FlownCell) -> dict[str, Any]:
    low, high = cell.spread
    first_low, first_high = cell.detection_spread
    return {
        "source": cell.source,
        "start": cell.start,
        "setting": cell.setting,
        "scenario": cell.cell.scenario.name,
        "scenario_hash": cell.cell.scenario.hash,
        "policy": cell.cell.policy.name,
        "first_seed": cell.cell.seeds[0],
        "episodes": len(cell.records),
        "successes": cell.n_successes,
        **_with_interval("success_rate", cell.success),
        "paper_time": cell.paper,
        **_with_interval("mean_time", cell.mean),
        "median_time": cell.median,
        "time_10": low,
        "time_90": high,
        **_with_interval("ratio", cell.ratio),
        "pinned_success": cell.pinned.success,
        "pinned_time": cell.pinned_time,
        "pinned_ratio": cell.pinned_time / cell.paper,
        "pinned_first_detection": cell.pinned.first_detection_time,
        "first_detection_median": cell.detection,
        "first_detection_10": first_low,
        "first_detection_90": first_high,
        "failures": cell.failures,
    }


def _with_interval(name: str, estimate: Estimate) -> dict[str, float]:
    return {name: estimate.value, f"{name}_low": estimate.low, f"{name}_high": estimate.high}


def _value(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
