"""The sortable tables of a report page: a cell is what is read and the number that it is sorted by."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from training.comparison import Against, Group, Row
from training.overall import Overall
from training.report import number, p_text
from training.report_page.markup import Markup, element, joined
from training.statistics import Estimate

_PER_CENT, _MINUTES, _KILO, _MILLI = 100.0, 1 / 60, 1e-3, 1e3


class Cell(NamedTuple):
    """One cell of a table. `key` sorts it; None: by its text; NaN: last."""

    text: str
    key: float | None = None
    wraps: bool = False  # long text


class Line(NamedTuple):
    """One row of a table; the first cell is its heading."""

    cells: Sequence[Cell]
    best: bool = False


def table(name: str, caption: str, headers: Sequence[str], lines: Iterable[Line]) -> Markup:
    """A table with the id `name`, which scrolls sideways where the page is narrow."""
    head = element("tr", *(element("th", header, scope="col") for header in headers))
    body = (_line(line) for line in lines)
    inner = element(
        "table",
        element("caption", caption),
        element("thead", head),
        element("tbody", *body),
        id=name,
        class_="sortable",
    )
    return element("div", inner, class_="scroll", tabindex="0", role="region", aria_label=caption)


def _line(line: Line) -> Markup:
    first, *others = line.cells
    cells = [element("th", first.text, scope="row", data_key=_key(first))]
    cells += [element("td", cell.text, data_key=_key(cell), class_="wraps" if cell.wraps else None) for cell in others]
    return element("tr", *cells, class_="best" if line.best else None)


def _key(cell: Cell) -> str | None:
    if cell.key is None:
        return None
    return "" if math.isnan(cell.key) else f"{cell.key:.9g}"


def plain(value: float, digits: int = 1) -> Cell:
    """A number."""
    return Cell(number(value, digits), value)


def ranged(estimate: Estimate, scale: float = 1.0, digits: int = 1, sign: str = "") -> Cell:
    """A value with its interval in smaller type; `sign` "+" shows a plus."""

    def shown(value: float) -> str:
        return number(value, digits) if math.isnan(value) else f"{value:{sign}.{digits}f}"

    value, low, high = (part * scale for part in estimate)
    if math.isnan(low):
        return Cell(shown(value), value)
    return Cell(joined(shown(value), " ", element("small", f"[{shown(low)}, {shown(high)}]")), value)


Columns = Sequence[tuple[str, Callable[[Row], Cell]]]

_OUTCOME: Columns = (
    ("episodes", lambda row: plain(len(row.result.records), 0)),
    ("success rate, % [95\N{NO-BREAK SPACE}%]", lambda row: ranged(row.estimates["success_rate"], _PER_CENT, 0)),
    ("false declarations, %", lambda row: plain(row.estimates["false_declaration_rate"].value * _PER_CENT, 0)),
    ("capped MST, min [95\N{NO-BREAK SPACE}%]", lambda row: ranged(row.estimates["capped_search_time"], _MINUTES)),
    ("MST found, min [95\N{NO-BREAK SPACE}%]", lambda row: ranged(row.estimates["search_time_of_successes"], _MINUTES)),
)
_COST: Columns = (
    ("mission, min [95\N{NO-BREAK SPACE}%]", lambda row: ranged(row.estimates["mission_time"], _MINUTES)),
    ("energy, kJ [95\N{NO-BREAK SPACE}%]", lambda row: ranged(row.estimates["energy"], _KILO, 0)),
    ("sent, kB", lambda row: plain(row.estimates["bytes"].value * _KILO, 2)),
    ("declaration error, m", lambda row: plain(row.estimates["declaration_error"].value)),
    ("flown, m", lambda row: plain(row.estimates["team_path"].value, 0)),
    ("decisions", lambda row: plain(row.estimates["decisions"].value, 0)),
    ("decision, ms", lambda row: plain(row.estimates["decision_seconds"].value * _MILLI, 2)),
)


def outcome_table(name: str, groups: Sequence[Group], swept: str = "") -> Markup:
    """Who finds the source, and the difference from each reference; `swept` names the varied parameter."""
    columns = [*_OUTCOME]
    if len(groups[0].rows) > 1:
        for reference in references(groups):
            columns += [
                (f"vs {reference or 'best'}, min", _of(reference, lambda one: _signed(one.search_time.difference))),
                ("p (Holm)", _of(reference, lambda one: _p(one.search_time.p_value))),
            ]
    return _of_groups(name, "Outcome", groups, swept, columns)


def references(groups: Sequence[Group]) -> Sequence[str | None]:
    """The labels of the named references; None stands for each group's best policy."""
    return (None,) if groups[0].picked else groups[0].references


def cost_table(name: str, groups: Sequence[Group], swept: str = "") -> Markup:
    """What it costs: means an episode."""
    return _of_groups(name, "Cost, means an episode", groups, swept, _COST)


def paired_table(name: str, groups: Sequence[Group], reference: str | None, swept: str = "") -> Markup:
    """Every policy against one of `references`, on the same seeds."""
    called = reference or "the best policy"
    columns: Columns = [
        ("pairs", _of(reference, lambda one: plain(one.search_time.pairs, 0))),
        (
            "capped MST difference, min [95\N{NO-BREAK SPACE}%]",
            _of(reference, lambda one: ranged(one.search_time.difference, _MINUTES, sign="+")),
        ),
        ("p (Holm)", _of(reference, lambda one: _p(one.search_time.p_value))),
        (
            "success rate difference, points [95\N{NO-BREAK SPACE}%]",
            _of(reference, lambda one: ranged(one.success_rate.difference, _PER_CENT, sign="+")),
        ),
        ("p (McNemar, Holm)", _of(reference, lambda one: _p(one.success_rate.p_value))),
        (
            f"{reference or 'best'} faster, % [95\N{NO-BREAK SPACE}%]",
            _of(reference, lambda one: ranged(one.reference_faster, _PER_CENT, 0)),
        ),
    ]
    return _of_groups(name, f"Differences from {called} on the same seeds", groups, swept, columns)


def _of(reference: str | None, cell: Callable[[Against], Cell]) -> Callable[[Row], Cell]:
    def shown(row: Row) -> Cell:
        against = next(iter(row.against.values()), None) if reference is None else row.against.get(reference)
        return cell(against) if against else Cell("best" if reference is None else "reference", math.nan)

    return shown


def _signed(estimate: Estimate) -> Cell:
    return ranged(Estimate(estimate.value, math.nan, math.nan), _MINUTES, sign="+")


def _p(value: float) -> Cell:
    return Cell(p_text(value), value)


def _of_groups(name: str, caption: str, groups: Sequence[Group], swept: str, columns: Columns) -> Markup:
    headers = ["policy", *([swept] if swept else []), *(header for header, _ in columns)]
    lines = []
    for group in groups:
        value = [] if group.value is None or not swept else [Cell(f"{group.value:g}", group.value)]
        for row in group.rows:
            cells = [Cell(row.label), *value, *(cell(row) for _, cell in columns)]
            lines.append(Line(cells, best=row.best and len(group.rows) > 1))
    return table(name, caption, headers, lines)


def overall_table(name: str, overall: Sequence[Overall]) -> Markup:
    """All scenarios together."""
    fullest = sorted(overall, key=lambda one: -len(one.reference_faster))  # no policy has itself in it
    named = list(dict.fromkeys(reference for one in fullest for reference in one.reference_faster))
    headers = [
        "policy",
        "episodes",
        "IQM, min [95\N{NO-BREAK SPACE}%]",
        "mean, min [95\N{NO-BREAK SPACE}%]",
        "median, min [95\N{NO-BREAK SPACE}%]",
    ]
    headers += [
        "success rate, % [95\N{NO-BREAK SPACE}%]",
        *(f"{label} faster, % [95\N{NO-BREAK SPACE}%]" for label in named),
    ]
    nothing = Cell("reference", math.nan)
    lines = []
    for place, one in enumerate(overall):
        times = (one.search_time[kind] for kind in ("interquartile_mean", "mean", "median_of_tasks"))
        faster = (one.reference_faster.get(label) for label in named)
        cells = [
            Cell(one.label),
            plain(one.episodes, 0),
            *(ranged(estimate, _MINUTES) for estimate in times),
            ranged(one.success_rate, _PER_CENT, 0),
            *(ranged(estimate, _PER_CENT, 0) if estimate else nothing for estimate in faster),
        ]
        lines.append(Line(cells, best=place == 0 and len(overall) > 1))
    return table(name, "Capped search times over all scenarios", headers, lines)
