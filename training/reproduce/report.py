"""What `osl reproduce` needs of a paper's experiments, and how their verdicts are shown: the same for every paper."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from training.reproduce.claims import Finding
from training.store import Store

_COLOURS = {"holds": "green", "contradicted": "red", "open": "yellow"}


class Report(Protocol):
    """An experiment that has been flown: what is printed and written of it."""

    @property
    def name(self) -> str:
        """Of the experiment."""

    @property
    def title(self) -> str:
        """One line."""

    @property
    def summary(self) -> str:
        """What was flown."""

    @property
    def findings(self) -> Sequence[Finding]:
        """The paper's claims with verdicts."""

    @property
    def remarks(self) -> str:
        """Frank: what is not the paper's, and what cannot be compared."""

    @property
    def footnotes(self) -> str:
        """The rules by which the figures came about, one a line."""

    def tables(self) -> RenderableType:
        """For the terminal."""

    def rows(self) -> list[dict[str, Any]]:
        """The table as plain values, SI units."""

    def write(self, folder: Path) -> list[str]:
        """Tables, notes and figures into `folder`; the names of the files."""


class ExperimentReport:
    """Base of the reports: what the experiment itself says."""

    experiment: Any

    @property
    def name(self) -> str:
        """Of the experiment."""
        return str(self.experiment.name)

    @property
    def title(self) -> str:
        """One line."""
        return str(self.experiment.title)

    @property
    def summary(self) -> str:
        """What was flown."""
        return str(self.experiment.summary)

    @property
    def remarks(self) -> str:
        """What is read differently, and what cannot be compared."""
        return str(self.experiment.remarks)


class Reproducible(Protocol):
    """A published experiment that can be flown."""

    @property
    def name(self) -> str:
        """As on the command line."""

    def run(
        self,
        *,
        episodes: int | None = None,
        quick: bool = False,
        first_seed: int | None = None,
        n_jobs: int | None = None,
        store: Store | None = None,
        progress: bool | None = None,
    ) -> Report:
        """Fly it with at most `episodes` episodes a setting, or few if `quick`; others as for `training.evaluate`."""


def verdicts(findings: Sequence[Finding]) -> Table:
    """Claims and verdicts, for the terminal."""
    table = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False, show_header=False)
    table.add_column(no_wrap=True)
    table.add_column()
    for finding in findings:
        table.add_row(Text(finding.verdict, style=_COLOURS[finding.verdict]), f"{finding.claim}\n  {finding.ours}")
    return table


def verdict_lines(findings: Sequence[Finding]) -> list[str]:
    """Claims and verdicts, as a Markdown table."""
    lines = ["| paper | ours | verdict |", "| --- | --- | --- |"]
    return lines + [f"| {finding.claim} | {finding.ours} | {finding.verdict} |" for finding in findings]
