"""The agent `search`: single-precision mathematics, expectations against brute force, legs, levers, checkpoints."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import njit

from baselines import make_policy
from baselines.belief import grid_kernels
from baselines.belief.grid import GridBelief
from baselines.belief.likelihood import hit_model
from baselines.learned.checkpoint import Checkpoint, shipped_folder
from baselines.policy import Briefing
from baselines.search_agent import expectations, sight
from baselines.search_agent.candidates import N_CANDIDATES, OFFSETS, write_candidates
from baselines.search_agent.crew import Crew, SearchView, definition_hash
from baselines.search_agent.levers import N_LEVERS, N_SITUATION, TIMES
from baselines.search_agent.single_precision import exp32, log32
from baselines.search_agent.state import SETTING
from baselines.search_agent.support import draw_support, summarise
from osl_env.errors import InputError
from osl_env.scenario_files import load_scenario
from tests.checkpoints import search_checkpoint
from training.flight import fly

SCENARIO = load_scenario("rate-60x60x30-random")
BRIEFING = Briefing.of(SCENARIO, 0, 7, np.array([10.0, 10.0, 5.0]))


@njit(error_model="numpy")
def _each(values: Any, exponential: Any, logarithm: Any) -> None:
    for i in range(values.size):
        exponential[i] = exp32(values[i])
        logarithm[i] = log32(exponential[i])


def test_single_precision_mathematics_is_right_to_a_few_units_in_the_last_place() -> None:
    values = np.linspace(-80.0, 80.0, 4001).astype(np.float32)
    exponential, logarithm = np.empty_like(values), np.empty_like(values)
    _each(values, exponential, logarithm)
    np.testing.assert_allclose(exponential, np.exp(values.astype(np.float64)), rtol=5e-7)
    np.testing.assert_allclose(logarithm, np.log(exponential.astype(np.float64)), rtol=4e-7, atol=2e-7)


def _some_belief(n: int = 2) -> GridBelief:
    belief = GridBelief(np.array([30.0, 24.0, 12.0]), cell=2.0, n_beliefs=n)
    rng = np.random.default_rng(3)
    belief.log_posterior[:] = rng.normal(size=belief.log_posterior.shape) * 2.0
    grid_kernels.normalise(belief.log_posterior, belief.probability)
    return belief


def test_support_has_the_beliefs_moments_and_does_not_depend_on_the_batch() -> None:
    belief = _some_belief()
    support = np.zeros((2, 3, 4096), np.float32)
    draw_support(belief.probability, belief.x, belief.y, belief.z, belief.size, support)
    mean, covariance = belief.moments()
    for row in range(2):
        places = support[row].astype(np.float64)
        spread = np.sqrt(np.diag(covariance[row]))
        assert np.abs(places.mean(axis=1) - mean[row]).max() < 0.05 * spread.max()
        np.testing.assert_allclose(places.std(axis=1), spread, rtol=0.05)
        alone = np.zeros((1, 3, 4096), np.float32)
        one = np.ascontiguousarray(belief.probability[row : row + 1])
        draw_support(one, belief.x, belief.y, belief.z, belief.size, alone)
        np.testing.assert_array_equal(alone[0], support[row])


def test_certainty_and_entropy_are_those_of_the_cells() -> None:
    belief = _some_belief()
    mean, _ = belief.moments()
    certainty, entropy = np.empty(2), np.empty(2)
    summarise(belief.probability, belief.log_posterior, belief.x, belief.y, belief.z, mean, 5.0, certainty, entropy)
    centres = np.array([belief.centre(cell) for cell in range(belief.n_cells)])
    for row in range(2):
        near = np.linalg.norm(centres - mean[row], axis=1) <= 5.0
        assert certainty[row] == pytest.approx(belief.probability[row][near].sum())
    np.testing.assert_allclose(entropy, belief.entropy())


def test_information_and_expected_spread_equal_brute_force_over_the_outcomes() -> None:
    rng = np.random.default_rng(1)
    places, weight = rng.normal(size=(3, 64)) * 6.0, rng.uniform(size=64)
    weight /= weight.sum()
    counts = rng.uniform(0.0, 3.0, 64)
    terms = np.empty((expectations.N_TERMS, 64), np.float32)
    hit, gain = expectations.information(counts.astype(np.float32), weight.astype(np.float32), terms)
    none, one = np.exp(-counts), counts * np.exp(-counts)
    outcomes = np.array([none, one, 1.0 - none - one])
    mixture = outcomes @ weight
    expected = -(mixture * np.log(mixture)).sum() + (weight * (outcomes * np.log(outcomes)).sum(axis=0)).sum()
    assert gain == pytest.approx(expected, rel=1e-3)
    assert hit == pytest.approx(1.0 - none @ weight, rel=1e-5)

    def spread(w: np.ndarray) -> float:
        mean = places @ w / w.sum()
        return math.sqrt((w * ((places - mean[:, None]) ** 2).sum(axis=0)).sum() / w.sum())

    brute = (weight * none).sum() * spread(weight * none) + (weight * (1 - none)).sum() * spread(weight * (1 - none))
    squared = (places**2).sum(axis=0)
    moments = np.array([1.0, *(places @ weight), squared @ weight])
    x, y, z, s = (row.astype(np.float32) for row in (*places, squared))
    assert expectations.expected_spread(x, y, z, s, moments, terms) == pytest.approx(brute, rel=1e-4)


def _setting() -> np.ndarray:
    return Crew(SearchView(), BRIEFING).settings.view(SETTING)


@pytest.mark.parametrize("distance", [0.0, 0.4, 2.0, 4.4, 5.0, 5.6, 30.0])
@pytest.mark.parametrize("heading", [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
def test_a_leg_takes_the_time_of_a_leg(distance: float, heading: tuple[float, float, float]) -> None:
    setting, place, own = _setting(), np.empty(3), np.array([10.0, 10.0, 5.0])
    goal = own + np.array([distance, 0.0, 0.0])
    samples, turns = sight.plan_leg(own, np.array(heading), goal, setting[0], place)
    seconds = np.linalg.norm(place - own) + samples + (1.0 if turns else 0.0)
    assert samples >= 1
    assert abs(seconds - 6.0) <= 0.51
    assert turns == (distance > 0.0 and heading == (0.0, 1.0, 0.0))
    assert np.linalg.norm(place - goal) <= max(0.0, distance - 3.0)


def test_candidates_turn_with_the_wind_and_stay_inside() -> None:
    own, goal, mean = np.array([20.0, 20.0, 10.0]), np.array([25.0, 20.0, 10.0]), np.array([30.0, 30.0, 15.0])
    support = np.tile(mean.astype(np.float32)[:, None], (1, 16))
    area, spreads = np.array([60.0, 60.0, 30.0]), np.array([4.0, 2.0, 1.0])
    east, north = np.empty((N_CANDIDATES, 3)), np.empty((N_CANDIDATES, 3))
    write_candidates(own, goal, np.array([1.0, 0.0]), mean, spreads, support, area, 3, east)
    turned = [np.array([60.0 - p[1], p[0], p[2]]) for p in (own, goal, mean)]
    write_candidates(
        turned[0], turned[1], np.array([0.0, 1.0]), turned[2], spreads,
        np.tile(turned[2].astype(np.float32)[:, None], (1, 16)), area, 3, north,
    )  # fmt: skip
    np.testing.assert_allclose(north, np.stack([60.0 - east[:, 1], east[:, 0], east[:, 2]], axis=1), atol=1e-5)
    assert ((east >= 0.0) & (east <= area)).all()
    assert len(OFFSETS) == N_CANDIDATES
    np.testing.assert_array_equal(east[0], own)
    np.testing.assert_array_equal(east[1], goal)


def test_crew_holds_the_posterior_of_its_readings_and_knows_when_it_is_certain() -> None:
    crew = Crew(SearchView(), BRIEFING, 2)
    crew.reset(np.array([0, 1]), np.tile(BRIEFING.start, (2, 3, 1)))
    rng = np.random.default_rng(5)
    positions = rng.uniform(0.0, 30.0, (2, 3, 3))
    hits, seconds = np.array([[0.0, 2.0, 0.0], [0.0, 0.0, 0.0]]), np.full((2, 3), 2.0)
    crew.measure_wind(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]))
    crew.take(positions, hits, seconds, np.array([2.0, 2.0]))
    for row, wind in enumerate(([0.0, -1.0, 0.0], [1.0, 0.0, 0.0])):
        belief = GridBelief(BRIEFING.area, cell=2.5)
        belief.use_model(hit_model(BRIEFING.plume, BRIEFING.gas_sensor, np.array(wind)))
        belief.update(positions[row : row + 1], hits[row : row + 1], seconds[row : row + 1])
        np.testing.assert_allclose(crew.belief.probability[row], belief.probability[0], rtol=1e-9)
    assert crew.situations["heard"].tolist() == [True, False]
    assert crew.situations["searching"].tolist() == [False, True]
    assert not crew.certain(0.98).any()
    assert crew.certain(1e-9).tolist() == [True, False]


def test_levers_at_zero_are_the_rule_and_the_ends_double_and_halve_its_times() -> None:
    crew = Crew(SearchView(), BRIEFING, 2)
    levers = np.zeros((2, N_LEVERS))
    levers[0, -len(TIMES) :], levers[1, -len(TIMES) :] = 3.0, -1.0  # clipped
    crew.set_levers(levers)
    for name in TIMES:
        base = getattr(SearchView(), name)
        np.testing.assert_allclose(crew.settings[name], [2.0 * base, 0.5 * base])
    assert (crew.weights[:, :, :-1] == 0.0).all()
    assert (crew.weights[:, :, -1] == 1.0).all()
    assert crew.describe().shape == (2, N_SITUATION)


def test_mates_out_of_radio_contact_do_not_matter() -> None:
    """Locality: where a mate that cannot be heard flies changes nothing."""
    choices = []
    for elsewhere in (0.0, 40.0):
        crew = Crew(SearchView(), BRIEFING)
        crew.reset(np.array([0]), np.tile(BRIEFING.start, (1, 3, 1)))
        crew.mates["known"][0] = [True, False, True]
        crew.mates["position"][0, 1] = crew.mates["goal"][0, 1] = elsewhere
        crew.measure_wind(np.array([[0.0, -1.0, 0.0]]))
        crew.take(np.full((1, 1, 3), 10.0), np.array([[1.0]]), np.array([[1.0]]), np.array([1.0]))
        crew.decide(0)
        choices.append((crew.describe().tobytes(), crew.mates["goal"][0, 0].tobytes()))
    assert choices[0] == choices[1]


def test_flights_share_what_is_heard_and_pay_for_it(tmp_path: Path) -> None:
    policy = make_policy("checkpoint", path=search_checkpoint(tmp_path / "agent"))
    flight = fly(policy, SCENARIO, [3], max_decisions=8)
    beliefs = [pilot.belief() for pilot in flight.team[0]]
    assert all(belief is not None for belief in beliefs)
    for belief in beliefs[1:]:  # all have heard the same readings
        np.testing.assert_array_equal(belief.mean, beliefs[0].mean)  # type: ignore[union-attr]
    assert (flight.world.ledger["bytes"] > 0).all()
    assert all(pilot.computed_bits > 0.0 for pilot in flight.team[0])


def test_a_stochastic_agent_differs_from_the_greedy_one_and_repeats_itself(tmp_path: Path) -> None:
    folder = search_checkpoint(tmp_path / "agent")
    places = [
        fly(
            make_policy("checkpoint", path=folder, stochastic=stochastic), SCENARIO, [3], max_decisions=15
        ).world.motion["position"]
        for stochastic in (False, True, True)
    ]
    assert (places[0] != places[1]).any()
    np.testing.assert_array_equal(places[1], places[2])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"observation": {"features": [{"kind": "search"}], "size": 1, "hash": "old"}}, "another definition"),
        ({"observation": {"features": [{"kind": "search", "cel": 2.0}], "size": 1}}, "cel"),
        ({"observation": {"features": [], "size": 1}}, "must be one feature of kind 'search'"),
        ({"action": {"certainty": 1.5}}, "certainty"),
        ({"agent": "search", "max_uavs": 2}, "teams of at most 2"),
    ],
)
def test_a_checkpoint_that_does_not_fit_is_refused_in_one_line(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    loaded = Checkpoint.load(search_checkpoint(tmp_path / "agent"))
    header = type(loaded.header).model_validate(loaded.header.model_dump() | change)
    replace(loaded, header=header).write(tmp_path / "changed")
    with pytest.raises(InputError, match=message) as caught:
        make_policy("checkpoint", path=tmp_path / "changed").reset(BRIEFING)
    assert "\n" not in str(caught.value)


def test_the_definition_changes_with_the_view() -> None:
    assert definition_hash(SearchView()) != definition_hash(SearchView(leg_time=5.0))


def test_the_shipped_agent_without_its_network_is_the_rule(tmp_path: Path) -> None:
    shipped = Checkpoint.load(shipped_folder("ppo-belief"))
    zeros = {name: np.zeros_like(array) for name, array in shipped.arrays.items()}
    Checkpoint(shipped.header, zeros).write(tmp_path / "rule")
    policies = [
        make_policy("checkpoint", path=tmp_path / "rule"),
        make_policy("ppo-belief", learned=False),
        make_policy("ppo-belief"),
    ]
    places = [fly(policy, SCENARIO, [3, 4], max_decisions=15).world.motion["position"] for policy in policies]
    np.testing.assert_array_equal(places[0], places[1])
    assert (places[0] != places[2]).any()
