"""Tables for an 80-column terminal: who finds the source, and what it costs."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console, RenderableType
from rich.console import Group as Lines
from rich.table import Table
from rich.text import Text

from osl_env.plumes.hit_rate import HitRatePlume
from osl_env.scenario import Scenario
from training.benchmark import Sweep
from training.comparison import Group, Row
from training.overall import over_all
from training.statistics import Estimate

MISSING = "-"


def number(value: float, digits: int = 1) -> str:
    """`value` with `digits` decimals; a dash for NaN."""
    return MISSING if math.isnan(value) else f"{value:.{digits}f}"


def with_interval(estimate: Estimate, scale: float = 1.0, digits: int = 1) -> str:
    """`12.1 [10.8, 13.2]`; the value alone where there is no interval."""
    text = number(estimate.value * scale, digits)
    if math.isnan(estimate.low):
        return text
    return f"{text} [{number(estimate.low * scale, digits)}, {number(estimate.high * scale, digits)}]"


def with_spread(estimate: Estimate, scale: float = 1.0, digits: int = 1) -> str:
    """`12.1 ±1.2`: half the width of the interval."""
    text = number(estimate.value * scale, digits)
    return text if math.isnan(estimate.low) else f"{text} ±{(estimate.high - estimate.low) / 2 * scale:.{digits}f}"


def p_text(p_value: float) -> str:
    """`.023`, or `<.001`."""
    if math.isnan(p_value):
        return MISSING
    return "<.001" if p_value < 0.001 else f"{p_value:.3f}".removeprefix("0")


_PER_CENT, _MINUTES, _KILO, _MILLI = 100.0, 1 / 60, 1e-3, 1e3
_POLICIES_A_LINE = 6  # of a sweep: 80 columns hold no more

Columns = Sequence[tuple[str, Callable[[Row], str]]]

SEARCH: Columns = (
    ("SR %\n[95 %]", lambda row: with_interval(row.estimates["success_rate"], _PER_CENT, 0)),
    ("false\n%", lambda row: number(row.estimates["false_declaration_rate"].value * _PER_CENT, 0)),
    ("capped MST min\n[95 %]", lambda row: with_interval(row.estimates["capped_search_time"], _MINUTES)),
)
COST: Columns = (
    ("MST found min\n[95 %]", lambda row: with_interval(row.estimates["search_time_of_successes"], _MINUTES)),
    ("mission\nmin", lambda row: number(row.estimates["mission_time"].value * _MINUTES)),
    ("energy\nkJ", lambda row: number(row.estimates["energy"].value * _KILO, 0)),
    ("sent\nkB", lambda row: _three_figures(row.estimates["bytes"].value * _KILO)),
    ("error\nm", lambda row: number(row.estimates["declaration_error"].value)),
    ("decision\nms", lambda row: _three_figures(row.estimates["decision_seconds"].value * _MILLI)),
)


def _three_figures(value: float) -> str:
    return number(value, 2 if value < 10 else 1 if value < 100 else 0)


def _against(reference: str, name: str) -> Columns:
    """The columns of the differences from the policy labelled `reference`, called `name`."""

    def difference(row: Row) -> str:
        if reference not in row.against:
            return "best" if name == "best" else "ref."
        return f"{row.against[reference].search_time.difference.value * _MINUTES:+.1f}"

    def p_value(row: Row) -> str:
        return p_text(row.against[reference].search_time.p_value) if reference in row.against else ""

    return ((f"vs {folded(name)}\nmin", difference), ("p\n(Holm)", p_value))


def reference_names(group: Group) -> dict[str, str]:
    """Label of each reference -> how a table calls it: by its label, or "best" where the benchmark names none."""
    return {label: "best" if group.picked else label for label in group.references}


def folded(label: str) -> str:
    """`label` on several lines, broken at hyphens, where it would make a column wide."""
    return re.sub(r"-(?=[^-]{6,}$)", "-\n", label)


def group_tables(groups: Sequence[Group], sweep: Sweep | None = None) -> RenderableType:
    """The tables of every group: outcome, comparison, cost; one comparison stands beside the outcome."""
    parts: list[RenderableType] = []
    for group in groups:
        parts += [Text(_title(group, sweep), style="bold"), Text(_conditions(group), style="dim")]
        against = [
            column
            for reference, name in reference_names(group).items()
            for column in _against(reference, name)
            if len(group.rows) > 1
        ]
        if len(against) > 2:
            parts += [_table(group.rows, SEARCH), Text(), _table(group.rows, against)]
        else:
            parts += [_table(group.rows, (*SEARCH, *against))]
        parts += [Text(), _table(group.rows, COST), Text()]
    return Lines(*parts)


def overall_table(groups: Sequence[Group]) -> RenderableType:
    """A line a policy over all scenarios, best first."""
    table = _plain_table()
    table.add_column("policy", overflow="fold")
    for header in ("IQM min\n[95 %]", "mean min\n[95 %]", "SR %\n[95 %]"):
        table.add_column(header, justify="right", no_wrap=True)
    for one in over_all(groups):
        times = [with_interval(one.search_time[name], _MINUTES) for name in ("interquartile_mean", "mean")]
        table.add_row(one.label, *times, with_interval(one.success_rate, _PER_CENT, 0))
    return Lines(Text(f"all {len(groups)} scenarios together, capped search times", style="bold"), table, Text())


def _plain_table() -> Table:
    return Table(padding=(0, 1, 0, 0), box=SIMPLE_HEAD, pad_edge=False, show_edge=False)


def _table(rows: Sequence[Row], columns: Columns) -> Table:
    table = _plain_table()
    table.add_column("policy", overflow="fold")
    for header, _ in columns:
        table.add_column(header, justify="right", no_wrap=True)
    for row in rows:
        style = "bold" if row.best and len(rows) > 1 else ""
        table.add_row(row.label, *(text(row) for _, text in columns), style=style)
    return table


def _title(group: Group, sweep: Sweep | None) -> str:
    if sweep is None or group.value is None:
        return group.scenario
    return f"{group.scenario}, {sweep.label or sweep.key} = {group.value:g}"


def conditions(scenario: Scenario, seeds: Sequence[int], *, swept: bool = False) -> str:
    """What a reader must know of a scenario and its seeds to compare figures: one line.

    `swept`: a parameter is varied, so that only clock and seeds are sure to hold for all rows.
    """
    if swept:
        return f"{scenario.clock} clock, seeds {seeds[0]} to {seeds[-1]}"
    plume = scenario.plume
    gas = plume.summary
    if isinstance(plume, HitRatePlume):
        gas = f"A = {plume.source_strength * scenario.vehicle.hover_time:g}"
    radius = "unlimited" if math.isinf(scenario.radio.radius) else f"{scenario.radio.radius:g} m"
    n_uavs = scenario.team.n_uavs
    team = "1 UAV" if n_uavs == 1 else f"{n_uavs} UAVs"
    return f"{team}, {gas}, radio {radius}, {scenario.clock} clock, seeds {seeds[0]} to {seeds[-1]}"


def _conditions(group: Group) -> str:
    longest = max((row.result.case.cell for row in group.rows), key=lambda cell: len(cell.seeds))
    fewer = [
        f"{row.label} {len(row.result.case.cell.seeds)}"
        for row in group.rows
        if len(row.result.case.cell.seeds) < len(longest.seeds)
    ]
    line = conditions(longest.scenario, longest.seeds)
    return f"{line}\nepisodes: {len(longest.seeds)}, but {', '.join(fewer)}" if fewer else line


def sweep_tables(groups: Sequence[Group], sweep: Sweep | None) -> RenderableType:
    """One line a swept value (or scenario), one column a policy: success rate, and capped mean search time."""
    labels = list(dict.fromkeys(row.label for group in groups for row in group.rows))
    first = "scenario" if sweep is None else sweep.label or sweep.key
    shared_scenario = len({group.scenario for group in groups}) == 1
    parts: list[RenderableType] = []
    for title, measure, scale, digits in (
        ("success rate, %", "success_rate", _PER_CENT, 0),
        ("capped mean search time, min", "capped_search_time", _MINUTES, 1),
    ):
        parts.append(Text(f"{title} (± half the 95 % interval)", style="bold"))
        for some in _side_by_side(labels):
            table = _plain_table()
            table.add_column(first, overflow="fold")
            for label in some:
                table.add_column(folded(label), justify="right", no_wrap=True)
            for group in groups:
                cells = {row.label: with_spread(row.estimates[measure], scale, digits) for row in group.rows}
                name = group.scenario if group.value is None else f"{group.value:g}"
                if group.value is not None and not shared_scenario:
                    name = f"{group.scenario} {name}"
                table.add_row(name, *(cells.get(label, MISSING) for label in some))
            parts += [table, Text()]
    return Lines(*parts)


def _side_by_side(labels: Sequence[str]) -> list[Sequence[str]]:
    """The policies in lots that fit a line of the terminal."""
    lot = math.ceil(len(labels) / math.ceil(len(labels) / _POLICIES_A_LINE))
    return [labels[k : k + lot] for k in range(0, len(labels), lot)]


def rules(groups: Sequence[Group], *, with_best: bool = True) -> str:
    """The footnotes: by which rules the figures came about."""
    scenario = groups[0].rows[0].result.case.cell.scenario
    ending = scenario.ending
    if ending.success == "declare":
        success = (
            f"declared: a position within {ending.success_radius:g} m of a source; any other declaration is false "
            "and ends the episode"
        )
    else:
        success = f"reached: a UAV within {ending.success_radius:g} m of a source, knowing it or not"
    limit = ending.time_limit * _MINUTES
    lines = [
        f"SR: successes ({success}), Wilson interval.",
        "MST: mean search time of the UAV that declared: its own flying, hovering and turning, waiting not counted; "
        f"capped: failures count as {limit:g} min; found: successes only; BCa bootstrap intervals.",
        "Energy and bytes are the team's, waiting included; mission: the mission clock at the end.",
    ]
    if with_best and len(groups) > 1:
        lines.append("IQM: mean of the middle half over scenarios and seeds, bootstrapped within each scenario.")
    if with_best:
        names = " and ".join(dict.fromkeys(name for group in groups for name in reference_names(group).values()))
        lines.append(
            f"vs {names}: difference of the capped MST from {'the best policy' if names == 'best' else names} on the "
            "same seeds; p: paired sign-flip permutation test, Holm-corrected over the comparisons of the table."
        )
    return "\n".join(lines)


def console(width: int | None = None) -> Console:
    """Where tables go: stdout, 80 columns unless the terminal is narrower."""
    plain = Console(highlight=False)
    return Console(highlight=False, width=width or min(plain.width, 80))
