"""The averages as tables of an 80-column terminal and of Markdown, and as plain rows for files."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Group as Lines
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from training.report import MISSING, number, with_interval
from training.reproduce.gaslam.averages import (
    MEASURES,
    by_case,
    by_setting,
    difference,
    empty_estimate,
    estimate,
    mean_of_means,
    over_cases,
    ratio,
    succeeded,
)
from training.reproduce.gaslam.published import CASES, published
from training.reproduce.gaslam.runs import Flown
from training.statistics import NOTHING, Estimate, bootstrap_mean

NO_GAS = "no gas anywhere"
NAMES = {"rmse": "RMSE", "rmse_ste": "RMSE STE", "sc": "SC", "pe": "PE, m", "m": "M"}
_DIGITS = {"rmse": 4, "rmse_ste": 4, "sc": 3, "pe": 2, "m": 2}
Lined = tuple[list[str], list[list[str]]]  # header and rows

FOOTNOTES = (
    "[ ]: 95 % intervals, bootstrapped over the runs. Failed: an error along x over 5 m, or nothing declared; such "
    "runs are left out of all averages, as in the paper, but not of differences between settings.\n"
    "RMSE: of the final map (RMSE STE: of the source term's map) against the true plume averaged over the flight's "
    "time, over the truth's largest value. SC: share of cells that map and truth both call gas or both not. PE: "
    "distance of the declared place from the source. M = SC |1 - RMSE| / PE, of the averages.\n"
    f"{NO_GAS}: the map of zeros; it places no source."
)


def against_paper(flown: Sequence[Flown]) -> Lined:
    """A row a case and measure: ours with its interval, the paper's, and ours / paper with its interval."""
    header = ["case", "measure", "runs", "ours [95 %]", "paper", "ours / paper [95 %]"]
    rows = []
    for one in flown:
        for measure in MEASURES:
            digits, paper = _DIGITS[measure], published(one.name, measure)
            kept = f"{len(one.kept)} of {len(one.runs)}" if measure == MEASURES[0] else ""
            row = [one.name if kept else "", NAMES[measure], kept, with_interval(estimate(one, measure), 1.0, digits)]
            rows.append([*row, number(paper, 4), with_interval(ratio(one, measure), 1.0, 2)])
    return header, rows


def beside_each_other(flown: Sequence[Flown], called: str = "policy") -> Lined:
    """A row a case and setting, with the map "no gas anywhere" beside them; the means over the cases last.

    `called`: what settings are in the header.
    """
    header = ["case", called, "failed", "RMSE", "RMSE STE", "SC", "PE, m [95 %]", "M"]
    rows = []
    for name, settings in by_case(flown).items():
        rows += [_policy_row("" if k else name, one) for k, one in enumerate(settings)]
        empty = [number(empty_estimate(settings[0], measure).value, _DIGITS[measure]) for measure in ("rmse", "sc")]
        rows.append(["", NO_GAS, MISSING, empty[0], MISSING, empty[1], MISSING, MISSING])
    for k, (setting, cases) in enumerate(by_setting(flown).items()):
        if len(cases) > 1:
            rows.append(["" if k else "all", setting, *_overall(cases)])
    return header, rows


def _policy_row(case: str, one: Flown) -> list[str]:
    values = {measure: estimate(one, measure) for measure in MEASURES}
    figures = [number(values[measure].value, _DIGITS[measure]) for measure in ("rmse", "rmse_ste", "sc")]
    failed = f"{len(one.runs) - len(one.kept)}/{len(one.runs)}"
    return [case, one.setting, failed, *figures, with_interval(values["pe"], 1.0, 2), number(values["m"].value, 2)]


def _overall(cases: Sequence[Flown]) -> list[str]:
    values = {measure: over_cases(cases, measure) for measure in MEASURES if measure != "m"}
    figures = [number(values[measure].value, _DIGITS[measure]) for measure in ("rmse", "rmse_ste", "sc")]
    trials = sum(len(one.runs) for one in cases)
    failed = f"{trials - sum(len(one.kept) for one in cases)}/{trials}"
    return [failed, *figures, with_interval(values["pe"], 1.0, 2), MISSING]


def axis_errors(flown: Sequence[Flown], called: str = "policy") -> Lined:
    """A row a setting, `called` so in the header: mean position errors along each axis, over all cases."""
    header = [called, *(f"{axis}, m [95 %]" for axis in "xyz")]
    rows = []
    for setting, cases in by_setting(flown).items():
        errors = [one.axis_errors() for one in cases]
        means = [mean_of_means([of_case[:, axis] for of_case in errors]) for axis in range(3)]
        rows.append([setting, *(with_interval(mean, 1.0, 2) for mean in means)])
    return header, rows


def compared_settings(flown: Sequence[Flown]) -> Lined:
    """A row a setting, over all cases: PE, and its difference from the first setting on the same seeds."""
    header = ["setting", "failed", "PE, m [95 %]", "PE less base, m [95 %]", "RMSE", "SC"]
    settings = by_setting(flown)
    base = next(iter(settings))
    rows = []
    for setting, cases in settings.items():
        change = NOTHING if setting == base else difference(cases, settings[base], "pe")
        failed, rmse, _, sc, pe, _ = _overall(cases)
        rows.append([setting, failed, pe, with_interval(change, 1.0, 2), rmse, sc])
    return header, rows


def on_screen(*titled: tuple[str, Lined]) -> RenderableType:
    """Titled tables, one below the other."""
    parts: list[RenderableType] = []
    for title, (header, rows) in titled:
        table = Table(padding=(0, 1, 0, 0), box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
        for column, name in enumerate(header):
            words = column == 0 or name in ("measure", "policy", "setting")
            folded = name.replace(" [", "\n[").replace(" STE", "\nSTE")
            table.add_column(folded, justify="left" if words else "right", no_wrap=True)
        for row in rows:
            table.add_row(*row)
        parts += [Text(title, style="bold"), table, Text()]
    return Lines(*parts)


def as_markdown(lined: Lined) -> list[str]:
    """The lines of a Markdown table."""
    header, rows = lined
    return [_line(header), _line(["---"] * len(header)), *(_line(row) for row in rows)]


def _line(entries: Iterable[str]) -> str:
    return f"| {' | '.join(entries)} |"


def plain_rows(flown: Sequence[Flown]) -> list[dict[str, Any]]:
    """One row a case and setting, SI units, None where there is no value: the lines of the CSV and JSON tables."""
    rows = []
    for settings in by_case(flown).values():
        rows += [_row(one) for one in settings]
        rows.append(_empty_row(settings[0]))
    return [{key: _value(value) for key, value in row.items()} for row in rows]


def _row(one: Flown) -> dict[str, Any]:
    errors = one.axis_errors()
    row = {
        **_described(one),
        "setting": one.setting,
        "policy": one.case.cell.policy.name,
        "failed": len(one.runs) - len(one.kept),
        **_with_interval("success_rate", succeeded([one])),
        "pe_with_failed": bootstrap_mean([run.pe for run in one.runs]).value,
    }
    for measure in MEASURES:
        row |= _with_interval(measure, estimate(one, measure)) | {f"paper_{measure}": published(one.name, measure)}
        row |= _with_interval(f"ratio_{measure}", ratio(one, measure))
    for axis, name in enumerate("xyz"):
        row |= _with_interval(f"pe_{name}", bootstrap_mean(errors[:, axis]))
    return row


def _empty_row(one: Flown) -> dict[str, Any]:
    row: dict[str, Any] = {**_described(one), "setting": NO_GAS, "policy": ""}
    for measure in MEASURES:
        row |= _with_interval(measure, empty_estimate(one, measure))
    return row


def _described(one: Flown) -> dict[str, Any]:
    scenario = one.case.cell.scenario
    return {
        "case": one.name,
        "conditions": CASES.get(one.name, ""),
        "scenario": scenario.name,
        "scenario_hash": scenario.hash,
        "first_seed": one.case.cell.seeds[0],
        "runs": len(one.runs),
    }


def _with_interval(name: str, figures: Estimate) -> dict[str, float]:
    return {name: figures.value, f"{name}_low": figures.low, f"{name}_high": figures.high}


def _value(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
