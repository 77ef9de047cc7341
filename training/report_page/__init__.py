"""`report.html` of a benchmark: one file with its tables, figures and history, which opens without a network.

Tables are sorted by their headers; `report.html#sort=results-1,3` (or `..,3,descending`) opens sorted by column 3.
The page's policy (CSP) forbids every connection and every script but the one that it carries.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterator, Sequence
from importlib.resources import files

from training.benchmark import Benchmark
from training.comparison import Group
from training.figures import curves, last_moment, profile_lines, side_by_side
from training.overall import over_all, profiles
from training.provenance import Provenance
from training.report import conditions, rules
from training.report_page.charts import chart, picture
from training.report_page.history import history
from training.report_page.markup import Markup, element
from training.report_page.tables import cost_table, outcome_table, overall_table, paired_table, references
from training.statistics import STRATIFIED_RESAMPLES


def report_page(benchmark: Benchmark, groups: Sequence[Group], provenance: Provenance) -> str:
    """The page as text."""
    style, script = (files(__package__).joinpath(name).read_text("utf-8") for name in ("style.css", "table.js"))
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    allowed = f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{digest}'"
    policy = f"{allowed}; base-uri 'none'; form-action 'none'"
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=policy),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("title", benchmark.title),
        element("style", Markup(style)),
    )
    body = element("body", *_body(benchmark, groups, provenance), element("script", Markup(script)))
    return "<!doctype html>\n" + element("html", head, body, lang="en") + "\n"


def _body(benchmark: Benchmark, groups: Sequence[Group], provenance: Provenance) -> Iterator[Markup]:
    by_scenario: dict[str, list[Group]] = {}
    for group in groups:
        by_scenario.setdefault(group.scenario, []).append(group)
    together = len(groups) > 1 and benchmark.sweep is None
    yield element(
        "header",
        element("h1", benchmark.title),
        element("button", "Dark page", type="button", id="theme", hidden=True),
    )
    if benchmark.note:
        yield element("p", benchmark.note)
    contents = [("all", "All scenarios")] if together else []
    contents += [(f"scenario-{k}", label) for k, label in enumerate(by_scenario, start=1)]
    contents += [("search", "One search"), ("history", "How it was run"), ("notes", "Notes")]
    yield _navigation(contents)
    yield element("p", id="status", class_="unseen", role="status")
    if together:
        yield _all_scenarios(groups)
    elif benchmark.sweep is not None:
        swept = benchmark.sweep.label or benchmark.sweep.key
        yield chart("curves", curves(groups, "", benchmark.sweep), f"Success rate and capped MST over {swept}")
    for k, members in enumerate(by_scenario.values(), start=1):
        yield _scenario(k, members, benchmark)
    yield _search(groups[0])
    yield element("section", element("h2", "How it was run"), *history(benchmark, groups, provenance), id="history")
    yield element("section", element("h2", "Notes"), _notes(groups, together), id="notes")


def _navigation(contents: Sequence[tuple[str, str]]) -> Markup:
    links = (element("li", element("a", label, href=f"#{name}")) for name, label in contents)
    return element("nav", element("ul", *links), aria_label="Sections")


def _all_scenarios(groups: Sequence[Group]) -> Markup:
    overall = over_all(groups)
    if not overall:
        return element("section", element("p", "No policy flew the same number of episodes in every scenario."))
    return element(
        "section",
        element("h2", f"All {len(groups)} scenarios together"),
        overall_table("overall", overall),
        chart(
            "profile",
            profile_lines(profiles(groups)),
            "Performance profile: the share of episodes, of all scenarios alike, in which the source was found within"
            " the search time. Higher is better; bands are pointwise 95 % intervals.",
        ),
        id="all",
    )


def _scenario(k: int, groups: Sequence[Group], benchmark: Benchmark) -> Markup:
    sweep = benchmark.sweep
    swept = "" if sweep is None else sweep.label or sweep.key
    longest = max((row.result.case.cell for row in groups[0].rows), key=lambda cell: len(cell.seeds))
    parts = [
        element("h2", groups[0].scenario),
        element("p", conditions(longest.scenario, longest.seeds, swept=sweep is not None), class_="muted"),
        outcome_table(f"results-{k}", groups, swept),
    ]
    if sweep is None:
        caption = "Success rate and capped MST with 95 % intervals; the best policy in orange"
        parts.append(chart(f"chart-{k}", side_by_side(groups, ""), caption))
        if len(benchmark.scenarios) == 1:
            parts.append(chart(f"profile-{k}", profile_lines(profiles(groups)), "Performance profile: see the notes"))
    if len(groups[0].rows) > 1:
        tables = (
            paired_table(f"paired-{k}-{j}", groups, reference, swept)
            for j, reference in enumerate(references(groups), start=1)
        )
        parts.append(element("details", element("summary", "Paired differences, with intervals"), *tables))
    parts.append(element("details", element("summary", "Cost"), cost_table(f"cost-{k}", groups, swept)))
    return element("section", *parts, id=f"scenario-{k}")


def _search(group: Group) -> Markup:
    """One episode, flown again for its picture."""
    label = next((row.label for row in group.rows if row.label in group.references), group.rows[0].label)
    case = next(row.result.case for row in group.rows if row.label == label)
    seed = case.cell.seeds[0]
    caption = (
        f"{label} in {group.scenario}, seed {seed}, as it ended: tracks, samples, plume, source, and the belief of the"
        " UAV that declared"
    )
    figure = last_moment(case.cell.policy, case.cell.scenario, seed)
    return element("section", element("h2", "One search"), picture(figure, caption), id="search")


def _notes(groups: Sequence[Group], together: bool) -> Markup:
    compared = len(groups[0].rows) > 1
    lines = rules(groups, with_best=compared).splitlines()
    if compared:
        lines += [
            "Paired differences are policy minus reference: a positive time is longer than the reference's. p of"
            " success rates: McNemar's exact test. Each of the two has its own Holm correction.",
            "Faster: on so many of the common seeds the reference's capped time is the shorter one; ties, such as both"
            " failing, count half (the probability of improvement, paired).",
        ]
        if groups[0].picked:
            lines.append(
                "The best policy is picked from these episodes, by luck in part: p tells how far the others are from"
                " it, not that it would win again."
            )
    if together:
        lines.append(
            "All scenarios: mean and success rate weigh the scenarios alike; median: of the scenarios' means."
            f" Intervals there and bands are percentiles of {STRATIFIED_RESAMPLES:,} resamples of the episodes within"
            " each scenario (too narrow for a success rate next to 0 or 100 %)."
        )
    return element("ul", *(element("li", line) for line in lines))
