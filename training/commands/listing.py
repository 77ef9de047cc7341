"""`osl list`: what there is to run, one line each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import tyro

from osl_env.errors import InputError
from training.commands.options import print_json

if TYPE_CHECKING:
    from osl_env.fields import Field

KINDS = ("policies", "scenarios", "fields", "benchmarks", "trainings")


@dataclass(frozen=True)
class Listing:
    """List policies, scenarios, fields, benchmarks and trainings, one line each."""

    what: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="KIND")] = "all"
    """policies, scenarios, fields, benchmarks, trainings or all"""
    json: bool = False
    """print JSON only"""

    def execute(self) -> None:
        """Print the cards. Raises InputError for an unknown kind."""
        if self.what not in (*KINDS, "all"):
            raise InputError(f"cannot list {self.what!r}: allowed are {', '.join(KINDS)}, all")
        chosen = KINDS if self.what == "all" else (self.what,)
        cards = {kind: _cards(kind) for kind in chosen}
        if self.json:
            print_json(cards)
            return
        from rich.table import Table

        from training.report import console

        screen = console()
        for kind, lines in cards.items():
            table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, title=kind, title_justify="left")
            table.add_column(no_wrap=True)
            table.add_column()
            for name, card in lines.items():
                table.add_row(name, card)
            screen.print(table)
            screen.print()


def _cards(kind: str) -> dict[str, str]:
    if kind == "policies":
        from baselines import policy_class, policy_names

        return {name: policy_class(name).summary for name in policy_names()}
    if kind == "scenarios":
        from osl_env.scenario_files import load_scenario, scenario_names

        return {name: load_scenario(name).description for name in scenario_names()}
    if kind == "fields":
        from osl_env.fields import field_names, load_field

        return {name: _field_card(name, load_field(name)) for name in field_names()}
    if kind == "benchmarks":
        from training.benchmark import benchmark_names, load_benchmark

        return {name: load_benchmark(name).title for name in benchmark_names()}
    from training.training_config import load_training, training_names

    return {name: load_training(name).summary for name in training_names()}


def _field_card(name: str, field: Field) -> str:
    """Title of the card, what the field holds, and its size."""
    title = str(field.card.get("title", name))
    held = " and ".join(kind for kind in ("wind", "concentration") if getattr(field, kind) is not None)
    sides, cells = " x ".join(f"{side:.3g}" for side in field.high - field.low), " x ".join(map(str, field.shape))
    size = f"{held}, {sides} m, {cells} cells, {max(field.period, field.duration):g} s"
    return size if title == name else f"{title}: {size}"
