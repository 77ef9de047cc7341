"""The runner: an episode is a function of (scenario, policy, seed) alone, and a policy's mistakes are named."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import guesser
import numpy as np
import pytest

from baselines import Briefing, Policy
from osl_env.actions import Action, Hop, Hover, Velocity, Waypoint
from osl_env.errors import InputError
from osl_env.observation import Observation
from osl_env.parameters import FloatArray
from osl_env.radio import Message
from osl_env.record import EpisodeRecord
from osl_env.scenario_files import load_scenario
from training import evaluate
from training.flight import fly

SCENARIO = "rate-60x60x30"


class Stubborn(Policy):
    """Does one thing, always."""

    name = "stubborn"
    plume_quantities = ("hit_rate", "concentration")

    _action: Any = Hover()
    _declared: Any = None

    def reset(self, briefing: Briefing) -> None:
        pass

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        action: Action = self._action
        return action

    def declaration(self) -> FloatArray | None:
        declared: FloatArray | None = self._declared
        return declared


def stubborn(action: Any, declared: Any = None) -> Stubborn:
    policy = Stubborn()
    policy._action, policy._declared = action, declared
    return policy


def by_seed(records: list[EpisodeRecord]) -> list[dict[str, Any]]:
    rows = sorted((record.to_dict() for record in records), key=lambda row: row["seed"])
    for row in rows:
        del row["decision_seconds"]
    return rows


@pytest.mark.parametrize("overrides", [{}, {"clock": "event", "radio.radius": 15.0, "radio.loss": 0.3}])
def test_records_do_not_depend_on_batch_size_or_order(overrides: dict[str, Any]) -> None:
    scenario = load_scenario(SCENARIO, **overrides)
    seeds = list(range(6))
    one_by_one = evaluate("guesser", scenario, seeds, n_jobs=1, batch_size=1)
    together = evaluate("guesser", scenario, seeds, n_jobs=1, batch_size=6)
    backwards = evaluate("guesser", scenario, seeds[::-1], n_jobs=1, batch_size=4)
    assert [record.seed for record in backwards] == seeds[::-1]
    assert by_seed(one_by_one) == by_seed(together) == by_seed(backwards)
    assert len({record.mission_time for record in together}) > 1


@pytest.mark.slow
def test_records_do_not_depend_on_the_number_of_processes() -> None:
    here = evaluate("guesser", SCENARIO, range(4), n_jobs=1)
    # in the worker the class is found by the module of its instance, which this process has imported
    elsewhere = evaluate(guesser.Guesser(), SCENARIO, range(4), n_jobs=2)
    assert by_seed(here) == by_seed(elsewhere)


def test_evaluation_leaves_the_policy_given_untouched() -> None:
    policy = guesser.Guesser()
    evaluate(policy, SCENARIO, [0], n_jobs=1)
    assert policy._rng is None


def test_a_right_declaration_is_a_success_with_the_declarers_own_time() -> None:
    scenario = load_scenario(SCENARIO)
    source = np.array(scenario.sources.positions[0])
    (right,) = evaluate(stubborn(Hover(), source + np.array([3.0, 0.0, 0.0])), scenario, [1], n_jobs=1)
    assert right.success
    assert not right.false_declaration
    assert right.ended == "success"
    assert right.declaration_error == pytest.approx(3.0)
    assert right.search_time == pytest.approx(1.0)  # the sample at the start
    assert right.hovering_time == pytest.approx(3.0)


def test_a_wrong_declaration_ends_the_episode_and_counts_as_the_limit() -> None:
    scenario = load_scenario(SCENARIO)
    source = np.array(scenario.sources.positions[0])
    (wrong,) = evaluate(stubborn(Hover(), source - np.array([6.0, 0.0, 0.0])), scenario, [1], n_jobs=1)
    assert (wrong.success, wrong.false_declaration, wrong.ended) == (False, True, "false_declaration")
    assert wrong.search_time == wrong.time_limit == 1200.0
    assert wrong.mission_time < 10.0


def test_reasons_for_an_end_without_a_declaration() -> None:
    changes = {
        "time": {"ending.time_limit": 30.0},
        "decisions": {"ending.max_decisions": 5},
        "battery": {"energy.capacity": 5000.0},
    }
    for reason, change in changes.items():
        (record,) = evaluate(stubborn(Hover()), load_scenario(SCENARIO, **change), [0], n_jobs=1)
        assert record.ended == reason
        assert not record.success
        assert record.winner == -1
        assert math.isnan(record.declaration_error)


def test_energy_kinds_follow_from_the_times() -> None:
    """MUC-OSL eqs 4 to 6: 663 W flying, 470 W hovering and waiting, 3415 J a turn."""
    (record,) = evaluate("guesser", SCENARIO, [3], n_jobs=1)
    assert record.energy_flying == pytest.approx(663.0 * record.flying_time)
    assert record.energy_hovering == pytest.approx(470.0 * record.hovering_time)
    assert record.energy_waiting == pytest.approx(470.0 * record.waiting_time)
    assert record.energy_turning == pytest.approx(3415.0 * record.n_turns)
    assert record.flying_time == pytest.approx(record.team_path)
    assert record.bytes >= 16 * record.messages > 0


def test_a_waypoint_outside_is_flown_to_the_border() -> None:
    flight = fly(stubborn(Waypoint(np.array([-50.0, 30.0, 500.0]))), load_scenario(SCENARIO), [0], max_decisions=1)
    assert flight.world.motion["position"][0, 0].tolist() == [0.0, 30.0, 30.0]


@pytest.mark.parametrize(
    ("action", "complaint"),
    [
        (Hop(26), "direction must be a whole number from 0 to 25"),
        (Hop(3, 0), "length must be a whole number from 1 to 2"),
        (Hop(3, 1.5), "length must be a whole number"),  # type: ignore[arg-type]
        (Hover(0), "samples must be a whole number from 1 to 20"),
        (Waypoint(np.array([1.0, np.nan, 2.0])), "three finite numbers"),
        (Waypoint(np.array([1.0, 2.0])), "three finite numbers"),
        (Velocity(np.zeros(3)), "must be a Hop, Hover or Waypoint"),
        (None, "must be a Hop, Hover or Waypoint"),
    ],
)
def test_an_invalid_action_names_the_policy(action: Any, complaint: str) -> None:
    with pytest.raises(InputError, match=f"policy stubborn: .*{complaint}"):
        evaluate(stubborn(action), SCENARIO, [0], n_jobs=1)


def test_an_invalid_declaration_names_the_policy() -> None:
    with pytest.raises(InputError, match=r"policy stubborn: declaration\(\) gave"):
        evaluate(stubborn(Hover(), [1.0, 2.0, math.inf]), SCENARIO, [0], n_jobs=1)


def test_a_policy_that_does_not_understand_the_plume_is_refused() -> None:
    class Sniffer(Stubborn):
        name = "sniffer"
        plume_quantities = ("concentration",)

    with pytest.raises(InputError, match="sniffer cannot search in scenario rate-60x60x30: its sensor gives hits"):
        evaluate(Sniffer(), SCENARIO, [0], n_jobs=1)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"seeds": [-1]}, "seed = -1"),
        ({"seeds": [0.5]}, "seed = 0.5"),
        ({"n_jobs": 0}, "n_jobs = 0"),
        ({"batch_size": 0}, "batch_size = 0"),
        ({"policy": "gusser"}, "did you mean 'guesser'"),
        ({"scenario": "rate-60x60x3"}, "did you mean 'rate-60x60x30'"),
    ],
)
def test_bad_arguments_are_refused(changes: dict[str, Any], complaint: str) -> None:
    arguments = {"policy": "guesser", "scenario": SCENARIO, "seeds": [0], "n_jobs": 1} | changes
    with pytest.raises(InputError, match=complaint):
        evaluate(**arguments)


def test_frame_has_a_row_an_episode_and_total_energy() -> None:
    records = evaluate("guesser", SCENARIO, range(3), n_jobs=1)
    frame = records.to_frame()
    assert frame["seed"].tolist() == [0, 1, 2]
    kinds = [name for name in frame.columns if name.startswith("energy_")]
    assert len(kinds) == 6
    assert frame["energy"].to_numpy() == pytest.approx(frame[kinds].sum(axis=1).to_numpy())
    assert frame["parameters"].iloc[0] == '{"patience": 12, "payload": 8, "spread": 5.0}'
    estimate = records.summary()["capped_search_time"]
    assert estimate.value == pytest.approx(frame["search_time"].mean())


class Unequal(Policy):
    """UAV 0 hovers, the others fly far: on the event clock, UAV 0 ends while they are in the air."""

    name = "unequal"

    _uav: int = 0

    def reset(self, briefing: Briefing) -> None:
        self._uav = briefing.uav

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        if self._uav == 0:
            return Hover()
        far = np.array([59.0, 59.0, 29.0]) if observation.position[1] < 30.0 else np.array([1.0, 1.0, 1.0])
        return Waypoint(far)


def test_goes_on_when_nobody_decides() -> None:
    scenario = load_scenario(SCENARIO, clock="event", ending={"time_limit": 30.0})
    record = evaluate(Unequal(), scenario, seeds=[0], n_jobs=1, progress=False)[0]
    assert record.ended == "time"
    assert record.mission_time > 60.0  # the others have finished the legs that they had begun
