"""The environments of kinds `uav` and `course`: every UAV's decision is learned, by one shared policy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field, field_validator, model_validator

from baselines.features import DEFAULT_FEATURES, FeatureSpec
from baselines.learned.course import Course
from baselines.learned.pilot import ActionDefinition, observation_of
from osl_env.parameters import Parameters, quantity
from osl_env.scenario import Scenario
from osl_env.scenario_files import load_scenario
from training.randomisation import Randomisation
from training.training_blocks import Environment, Task

if TYPE_CHECKING:
    from training.sb3_vec_env import UavVecEnv


class TrainingScenario(Parameters):
    """A scenario with overrides; here a reward may be shaped."""

    scenario: str
    overrides: dict[str, Any] = Field(default_factory=dict)

    def made(self) -> Scenario:
        """Raises InputError for an unknown name or a bad override."""
        return load_scenario(self.scenario, **self.overrides)


class TeamEnvironment(Environment):
    """Worlds of one or several scenarios, a slot for each UAV."""

    scenarios: tuple[TrainingScenario, ...] = Field(min_length=1)
    overrides: dict[str, Any] = Field(default_factory=dict)  # of all scenarios, under their own
    n_worlds: int = quantity(64, "", ge=1, le=1_000_000)  # in all
    features: FeatureSpec = Field(DEFAULT_FEATURES, min_length=1)

    @field_validator("scenarios", mode="before")
    @classmethod
    def _bare_names(cls, entries: Any) -> Any:
        if isinstance(entries, list | tuple):
            return [{"scenario": entry} if isinstance(entry, str) else entry for entry in entries]
        return entries

    def made(self) -> list[Scenario]:
        """The scenarios. Raises InputError for an unknown name or a bad override."""
        return [load_scenario(entry.scenario, **(self.overrides | entry.overrides)) for entry in self.scenarios]


class UavEnvironment(TeamEnvironment):
    """The actions are those of the scenarios, which are either named or drawn."""

    kind: Literal["uav"] = "uav"
    scenarios: tuple[TrainingScenario, ...] = ()
    randomisation: Randomisation | None = None

    @model_validator(mode="after")
    def _named_or_drawn(self) -> UavEnvironment:
        if bool(self.scenarios) == (self.randomisation is not None):
            raise ValueError("must have either scenarios (at least one) or randomisation")
        return self

    def drawn(self) -> Randomisation | None:
        """What the scenarios are drawn from, if they are: `overrides` are of its base too, under its own."""
        if self.randomisation is None:
            return None
        return self.randomisation.model_copy(update={"overrides": self.overrides | self.randomisation.overrides})

    def make(self, seed: int) -> UavVecEnv:
        """The environment. Raises InputError for scenarios that do not go together."""
        from training.sb3_vec_env import UavVecEnv

        return UavVecEnv(self.drawn() or self.made(), self.n_worlds, self.features, seed)

    def task(self) -> Task:
        """That of the first scenario, or of the base of those that are drawn; for the largest team."""
        drawn = self.drawn()
        scenarios = [drawn.base()] if drawn else self.made()
        return Task(
            agent=scenarios[0].action,
            scenario=scenarios[0],
            max_uavs=drawn.max_uavs if drawn else max(scenario.team.n_uavs for scenario in scenarios),
            observation=observation_of(self.features),
            action=ActionDefinition.of(scenarios[0].action, scenarios[0].vehicle).as_mapping(),
            features=self.features,
        )


class CourseEnvironment(TeamEnvironment):
    """Actions and observations are relative to the wind, whatever the scenarios' actions."""

    kind: Literal["course"] = "course"
    course: Course = Course()

    def make(self, seed: int) -> UavVecEnv:
        """The environment. Raises InputError for scenarios that do not go together, or without the feature raw."""
        from training.course_vec_env import CourseVecEnv

        return CourseVecEnv(self.made(), self.n_worlds, self.features, seed, self.course)

    def task(self) -> Task:
        """That of the first scenario, for as many UAVs as the largest team."""
        scenarios = self.made()
        return Task(
            agent="course",
            scenario=scenarios[0],
            max_uavs=max(scenario.team.n_uavs for scenario in scenarios),
            observation=observation_of(self.features),
            action=ActionDefinition(course=self.course).as_mapping(),
            features=self.features,
        )
