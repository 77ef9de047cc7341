"""How the tables of a page came about: command and machine, and the exact scenarios and policies."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence

from osl_env.scenario import Scenario
from training.benchmark import Benchmark
from training.comparison import Group, Row
from training.provenance import Provenance
from training.report_page.markup import Markup, element
from training.report_page.tables import Cell, Line, plain, table
from training.store import parameters_of


def history(benchmark: Benchmark, groups: Sequence[Group], provenance: Provenance) -> Iterator[Markup]:
    """The description list, then a table of scenarios and one of policies."""
    entries = []
    for name, value in provenance.lines().items():
        shown = element("code", value) if name == "command" else value
        entries += [element("dt", name), element("dd", shown)]
    yield element("dl", *entries)
    swept = "" if benchmark.sweep is None else benchmark.sweep.label or benchmark.sweep.key
    yield _scenarios(groups, swept)
    yield _policies(groups, swept)


def _scenarios(groups: Sequence[Group], swept: str) -> Markup:
    headers = [
        "scenario",
        *([swept] if swept else []),
        "hash",
        "UAVs",
        "area, m",
        "clock",
        "success rule",
        "time limit, min",
    ]
    headers += ["plume", "radio radius, m", "seeds"]
    lines = []
    for group in groups:
        scenario = group.rows[0].result.case.cell.scenario
        seeds = [seed for row in group.rows for seed in row.result.case.cell.seeds]
        value = [Cell(f"{group.value:g}", group.value)] if swept and group.value is not None else []
        lines.append(
            Line(
                [
                    Cell(group.scenario),
                    *value,
                    Cell(element("code", scenario.hash)),
                    plain(scenario.team.n_uavs, 0),
                    Cell(" x ".join(f"{side:g}" for side in scenario.arena.size)),
                    Cell(scenario.clock),
                    Cell(f"{scenario.ending.success} within {scenario.ending.success_radius:g} m"),
                    plain(scenario.ending.time_limit / 60, 0),
                    Cell(_plume(scenario), wraps=True),
                    Cell(_radius(scenario), scenario.radio.radius),
                    Cell(f"{min(seeds)} to {max(seeds)}"),
                ]
            )
        )
    return table("scenarios", "Scenarios", headers, lines)


def _radius(scenario: Scenario) -> str:
    return "unlimited" if math.isinf(scenario.radio.radius) else f"{scenario.radio.radius:g}"


def _plume(scenario: Scenario) -> str:
    true, told = scenario.plume, scenario.advertised_plume
    text = true.summary
    return text if told is None or told == true else f"{text}; policies are told {told.summary}"


def _policies(groups: Sequence[Group], swept: str) -> Markup:
    headers = ["policy", *([swept] if swept else []), "name", "parameters", "episodes"]
    lines: dict[str, Line] = {}
    for group in groups:
        for row in group.rows:
            parameters = json.dumps(parameters_of(row.result.case.cell.policy))
            key = f"{row.label} {parameters}"
            value = [Cell(f"{group.value:g}", group.value)] if swept and group.value is not None else []
            lines.setdefault(key, Line([Cell(row.label), *value, *_described(row, parameters)]))
    return table("policies", "Policies", headers, lines.values())


def _described(row: Row, parameters: str) -> list[Cell]:
    return [
        Cell(row.result.case.cell.policy.name),
        Cell(element("code", parameters), wraps=True),
        plain(len(row.result.case.cell.seeds), 0),
    ]
