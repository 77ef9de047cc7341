"""Search times of settings as tables of an 80-column terminal, as Markdown, and as plain rows for files."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Group as Lines
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from training.report import number, with_interval
from training.reproduce.swarm.averages import Pool
from training.reproduce.swarm.runs import Flown, Setting

Titled = tuple[str, Sequence[Setting]]  # a table's title and its rows
Column = tuple[str, Callable[[Pool, Flown], str]]

FOOTNOTES = (
    "Search time: from the start until a robot is within {radius:g} m of the source; a failed run counts as the limit, "
    "{limits} s. Layouts are pooled, each with the same weight.\n"
    "[ ]: 95 % intervals; of success rates Wilson's, of times by bootstrap: worlds (a layout with a seed) are drawn "
    "anew within each layout, and each brings its runs of all settings. They are for these layouts. "
    "In the figure: bars are these intervals, numbers the share of failed runs."
)

_KEYS: dict[str, Column] = {
    "policy": ("policy", lambda _, one: one.setting.policy),
    "obstacles": ("obstacles", lambda _, one: str(one.setting.obstacles)),
    "emission": ("emission\ng/s", lambda _, one: f"{one.setting.emission:g}"),
    "n_robots": ("N", lambda _, one: str(one.setting.n_robots)),
}
_FIGURES: tuple[Column, ...] = (
    ("success\n% [95 %]", lambda _, one: with_interval(one.success, 100, 0)),
    ("runs", lambda _, one: str(len(one.records))),
    ("median\ns", lambda _, one: number(one.median)),
    ("mean search time\ns [95 %]", lambda pool, one: with_interval(pool.mean([one.setting]).estimate)),
)


def footnotes(flown: Sequence[Flown]) -> str:
    """The rules by which the figures came about."""
    limits = " or ".join(f"{limit:g}" for limit in sorted({one.limit for one in flown}))
    radius = flown[0].layouts[0].case.cell.scenario.ending.success_radius
    return FOOTNOTES.format(radius=radius, limits=limits)


def lined(pool: Pool, settings: Sequence[Setting]) -> list[list[str]]:
    """The header and a line a setting; of the keys, those that differ between the lines, and always N."""
    keys = [
        column
        for name, column in _KEYS.items()
        if name == "n_robots" or len({getattr(setting, name) for setting in settings}) > 1
    ]
    columns = [*keys, *_FIGURES]
    lines = [[text(pool, pool.flown[setting]) for _, text in columns] for setting in settings]
    return [[header for header, _ in columns], *lines]


def on_screen(pool: Pool, titled: Sequence[Titled]) -> RenderableType:
    """For the terminal."""
    parts: list[RenderableType] = []
    for title, settings in titled:
        header, *lines = lined(pool, settings)
        table = Table(padding=(0, 1, 0, 0), box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
        for name in header:
            table.add_column(name, justify="left" if name == "policy" else "right", no_wrap=True)
        for line in lines:
            table.add_row(*line)
        parts += [Text(title, style="bold"), table, Text()]
    return Lines(*parts)


def as_markdown(pool: Pool, settings: Sequence[Setting]) -> list[str]:
    """For the notes."""
    header, *lines = lined(pool, settings)
    named = " | ".join(name.replace("\n", ", ") for name in header)
    return [f"| {named} |", f"| {' | '.join(['---'] * len(header))} |", *(f"| {' | '.join(line)} |" for line in lines)]


def plain_rows(pool: Pool) -> list[dict[str, Any]]:
    """One row a setting, SI units but for the emission in g/s; None where there is no value."""
    return [{key: _value(value) for key, value in _row(pool, one).items()} for one in pool.flown.values()]


def _row(pool: Pool, one: Flown) -> dict[str, Any]:
    mean, success = pool.mean([one.setting]).estimate, one.success
    return {
        **one.setting._asdict(),
        "layouts": len(one.layouts),
        "episodes": len(one.records),
        "successes": one.n_successes,
        "success_rate": success.value,
        "success_rate_low": success.low,
        "success_rate_high": success.high,
        "median_time": one.median,
        "mean_time": mean.value,
        "mean_time_low": mean.low,
        "mean_time_high": mean.high,
        "time_limit": one.limit,
    }


def _value(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
