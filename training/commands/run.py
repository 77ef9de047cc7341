"""`osl run`: one policy in one scenario."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import tyro

from training.commands.options import (
    DEFAULT_STORE,
    Count,
    File,
    Folder,
    OptionalCount,
    Pairs,
    check_count,
    parse_pairs,
    print_json,
)

if TYPE_CHECKING:
    from training.benchmark import Result


@dataclass(frozen=True)
class Run:
    """Fly a policy through episodes of a scenario, and print its table."""

    policy: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="POLICY")]
    """a name from `osl list policies`"""
    scenario: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="SCENARIO")]
    """a name from `osl list scenarios`, or a YAML file"""
    episodes: Count = 20
    """how many"""
    seed: Count = 0
    """of the first episode; the next ones follow"""
    set: Pairs = ()
    """change the scenario: team.n_uavs=4, radio.radius='20 m'"""
    policy_set: Pairs = ()
    """change the policy: particles=160"""
    jobs: OptionalCount = None
    """processes; all cores by default"""
    out: File = None
    """write the episodes to this .csv, .json or .parquet"""
    render: File = None
    """write a picture (.png) of the last episode's end"""
    store: Folder = DEFAULT_STORE
    """keeps finished episodes; the same command takes them from there"""
    json: bool = False
    """print JSON only"""

    def execute(self) -> None:
        """Run, print and write. Raises InputError for any bad argument before the first episode."""
        check_count("episodes", self.episodes)
        scenario_changes, policy_changes = parse_pairs(self.set, "--set"), parse_pairs(self.policy_set, "--policy-set")
        from baselines import make_policy
        from osl_env.scenario_files import load_scenario
        from osl_env.streams import check_seed
        from training.benchmark import Case, Result
        from training.records import check_output, write_table
        from training.store import Store
        from training.sweep import Cell, run_cells

        seeds = tuple(range(check_seed(self.seed), check_seed(self.seed + self.episodes - 1) + 1))
        scenario = load_scenario(self.scenario, **scenario_changes)
        cell = Cell(make_policy(self.policy, **policy_changes), scenario, seeds)
        for path, suffixes in ((self.out, (".csv", ".json", ".parquet")), (self.render, (".png",))):
            if path is not None:
                check_output(path, suffixes)
        records = run_cells([cell], n_jobs=self.jobs, store=Store(self.store))[0]
        result = Result(Case(scenario.name, self.policy, None, cell), records)
        if self.out is not None:
            write_table(self.out, records.to_frame())
        if self.render is not None:
            from training.figures import last_moment, save

            save(last_moment(cell.policy, scenario, seeds[-1]), self.render)
        self._show(result)

    def _show(self, result: Result) -> None:
        from training.comparison import grouped, wide
        from training.report import console, group_tables, rules

        groups = grouped([result])
        if self.json:
            print_json({"summary": wide(groups)[0], "episodes": [record.to_dict() for record in result.records]})
            return
        screen = console()
        screen.print(group_tables(groups))
        screen.print(rules(groups, with_best=False), style="dim")
