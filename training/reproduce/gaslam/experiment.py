"""Table II, the ablations and the same with meander and lag as experiments: runs, averages, claims, boxes and notes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import RenderableType

from training.figures import save
from training.records import write_table, write_text
from training.report import conditions
from training.reproduce.claims import Finding
from training.reproduce.gaslam import tables
from training.reproduce.gaslam.averages import by_setting
from training.reproduce.gaslam.claims import POLICY, GasClaim
from training.reproduce.gaslam.figures import error_boxes
from training.reproduce.gaslam.readings import REMARKS
from training.reproduce.gaslam.runs import Flown, fly_cases, planned_cases
from training.reproduce.report import ExperimentReport, verdict_lines
from training.store import Store

QUICK_EPISODES = 3
_FILES = ("figure.png", "notes.md", "table.csv", "episodes.csv")


@dataclass(frozen=True)
class GasExperiment:
    """Cases flown in several settings. `compares_settings`: against the first setting, instead of the paper."""

    name: str
    title: str
    summary: str
    benchmark: str
    claims: tuple[GasClaim, ...]
    remarks: str = REMARKS
    compares_settings: bool = False

    def run(
        self,
        *,
        episodes: int | None = None,
        quick: bool = False,
        first_seed: int | None = None,
        n_jobs: int | None = None,
        store: Store | None = None,
        progress: bool | None = None,
    ) -> GasReport:
        """Fly all cases with at most `episodes` seeds; `store` is not used, the others as for `training.evaluate`."""
        cases = planned_cases(self.benchmark, episodes or (QUICK_EPISODES if quick else None), first_seed)
        flown = fly_cases(cases, n_jobs=n_jobs, progress=progress)
        return GasReport(self, flown, [claim.check(flown) for claim in self.claims])


@dataclass(frozen=True)
class GasReport(ExperimentReport):
    """An experiment, its runs and the verdicts on its claims."""

    experiment: GasExperiment
    flown: Sequence[Flown]
    findings: Sequence[Finding]

    @property
    def footnotes(self) -> str:
        """The rules by which the figures came about."""
        return tables.FOOTNOTES

    def _tables(self) -> list[tuple[str, tables.Lined]]:
        """Titled tables."""
        if self.experiment.compares_settings:
            return [
                ("all cases together", tables.compared_settings(self.flown)),
                ("position errors by axis, all cases", tables.axis_errors(self.flown, "setting")),
                ("each case", tables.beside_each_other(self.flown, "setting")),
            ]
        own = by_setting(self.flown)[POLICY]
        return [
            ("ours and the paper's", tables.against_paper(own)),
            ("beside others and the trivial map", tables.beside_each_other(self.flown)),
            ("position errors by axis, all cases", tables.axis_errors(self.flown)),
        ]

    def tables(self) -> RenderableType:
        """For the terminal."""
        return tables.on_screen(*self._tables())

    def rows(self) -> list[dict[str, Any]]:
        """One row a case and setting."""
        return tables.plain_rows(self.flown)

    def notes(self) -> str:
        """Markdown: claims, tables, and what cannot be compared."""
        lines = [f"# {self.title}", "", self.summary, "", *verdict_lines(self.findings), ""]
        for title, lined in self._tables():
            lines += [f"## {title[0].upper()}{title[1:]}", "", *tables.as_markdown(lined), ""]
        lines += ["## Remarks", "", self.remarks, "", *(f"- {line}" for line in self.footnotes.splitlines()), ""]
        return "\n".join([*lines, "## Conditions", "", *_condition_lines(self.flown), ""])

    def write(self, folder: Path) -> list[str]:
        """Table, episodes, figure and notes into `folder`."""
        write_table(folder / "table.csv", pd.DataFrame(self.rows()))
        write_table(folder / "episodes.csv", episodes_frame(self.flown))
        write_text(folder / "notes.md", self.notes())
        save(error_boxes(self.flown, self.title), folder / "figure.png")
        return list(_FILES)


def episodes_frame(flown: Sequence[Flown]) -> pd.DataFrame:
    """Every run, under its case and setting; places and errors in m, NaN where there is none."""
    rows = []
    for one in flown:
        for run in one.runs:
            declared = [None] * 3 if run.landed.declared is None else run.landed.declared.tolist()
            rows.append(
                {
                    "case": one.name,
                    "setting": one.setting,
                    "seed": run.seed,
                    "failed": run.failed,
                    "ended": run.landed.record.ended,
                    **{f"source_{axis}": value for axis, value in zip("xyz", run.landed.source, strict=True)},
                    **{f"declared_{axis}": value for axis, value in zip("xyz", declared, strict=True)},
                    **{f"pe_{axis}": abs(value) for axis, value in zip("xyz", run.offset, strict=True)},
                    **{name: getattr(run, name) for name in ("pe", "rmse", "rmse_ste", "sc", "empty_rmse", "empty_sc")},
                    "mission_time": run.landed.record.mission_time,
                    "path": run.landed.record.path,
                }
            )
    return pd.DataFrame(rows)


def _condition_lines(flown: Sequence[Flown]) -> list[str]:
    """A line for each case, and one for each setting."""
    first = next(iter(by_setting(flown).values()))
    lines = [f"- Case {one.name}, {one.case.cell.scenario.name}: {_world(one)}" for one in first]
    for setting, cases in by_setting(flown).items():
        policy = cases[0].case.cell.policy
        changed = policy.model_dump(exclude_defaults=True)
        parameters = ", ".join(f"{key} = {value}" for key, value in changed.items()) or "its defaults"
        lines.append(f"- {setting}: {policy.name} with {parameters}")
    return lines


def _world(one: Flown) -> str:
    scenario: Any = one.case.cell.scenario
    air = f"wind {scenario.wind.speed:g} m/s ({scenario.wind.kind}), sensor's lag {scenario.gas_sensor.rise_time:g} s"
    return f"{conditions(scenario, one.case.cell.seeds)}; {air}"
