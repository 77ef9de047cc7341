"""The environment of kind `search`: worlds of several scenarios, in which the levers of a scoring rule are moved.

    environment:
      kind: search
      groups:
        - {scenario: rate-100x60x30-random, worlds: 64}
        - {scenario: rate-100x60x30-random, overrides: {team.n_uavs: 5}, worlds: 8}

In training a team shares one belief, so its radio must reach all without latency or loss.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field

from baselines.search_agent.crew import SearchView
from baselines.search_agent.policy import SearchAction, observation_definition
from osl_env.errors import InputError
from osl_env.parameters import Parameters, quantity
from osl_env.scenario import Scenario
from osl_env.scenario_files import load_scenario
from training.training_blocks import Environment, Task

if TYPE_CHECKING:
    from training.search_vec_env import SearchVecEnv

MAX_UAVS = 8


class GroupEntry(Parameters):
    """Some worlds of a scenario with overrides."""

    scenario: str
    overrides: dict[str, Any] = Field(default_factory=dict)
    worlds: int = quantity(16, "", ge=1, le=100_000)

    def made(self) -> Scenario:
        """Raises InputError for an unknown name, a bad override, or a radio that does not reach all at once."""
        scenario = load_scenario(self.scenario, **self.overrides)
        if not scenario.hears_all:
            raise InputError(
                f"scenario {self.scenario}: radio: must reach all at once (no radius, latency, loss or lost radio)"
            )
        if scenario.clock != "barrier":
            raise InputError(f"scenario {self.scenario}: clock = {scenario.clock!r}: must be 'barrier'")
        return scenario


class SearchEnvironment(Environment):
    """Worlds of several scenarios, a slot for each world."""

    kind: Literal["search"] = "search"
    groups: tuple[GroupEntry, ...] = Field(min_length=1)
    view: SearchView = SearchView()
    action: SearchAction = SearchAction()

    def make(self, seed: int) -> SearchVecEnv:
        """The environment. Raises InputError for a scenario that cannot be trained in."""
        from training.search_vec_env import SearchVecEnv

        groups = [(entry.made(), entry.worlds) for entry in self.groups]
        return SearchVecEnv(groups, view=self.view, certainty=self.action.certainty, seed=seed)

    def task(self) -> Task:
        """That of the first group; the network takes any number of UAVs up to `MAX_UAVS`."""
        scenarios = [entry.made() for entry in self.groups]
        return Task(
            agent="search",
            scenario=scenarios[0],
            max_uavs=max(MAX_UAVS, *(scenario.team.n_uavs for scenario in scenarios)),
            observation=observation_definition(self.view),
            action=self.action.model_dump(mode="json"),
        )
