"""GaSLAM's rivals: the boustrophedon flight, the choice by information, and whole flights."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any

import numpy as np
import pytest
from worlds import begun, flying, small

from baselines import Briefing, Policy, make_policy
from baselines.gaslam.cells import Cells
from baselines.gaslam.information import (
    InformationParameters,
    around,
    choose,
    expected_divergence,
    most_informative,
    predictions,
)
from baselines.gaslam.kernel_map import KernelMap
from baselines.gaslam.rivals import BoustrophedonSTE, KernelPeak, RahbarSTE
from baselines.gaslam.source_term import SourceTerm
from baselines.gaslam.survey import Survey, SurveyParameters, goals, share_of
from osl_env import InputError, Scenario, load_scenario
from osl_env.parameters import FloatArray
from training.flight import Flight, fly

QUICK: dict[str, Any] = {"source_term": {"iterations": 200, "burn_in": 50, "first_burn_in": 200}}
RIVALS: dict[str, Policy] = {
    "kernel-peak": KernelPeak(),
    "boustrophedon-ste": BoustrophedonSTE(**QUICK),
    "rahbar-ste": RahbarSTE(**QUICK),
}
BOX = np.array([7.0, 2.0, 0.5])
LEVEL = np.array([0.6, 0.0, 0.0])
OBSTACLE = {"kind": "box", "low": [8, 8, 0], "high": [14, 12, 8]}


def tunnel(**changes: Any) -> Scenario:
    return load_scenario("tunnel-a", **changes)


def told(task: Scenario, uav: int = 0) -> Briefing:
    return Briefing.of(task, uav, 1, begun(task).motion["position"][0, uav])


def surveyed(task: Scenario, uav: int = 0, **parameters: Any) -> Survey:
    return Survey(SurveyParameters(**parameters), told(task, uav), np.array([0.5, 0.2, 0.1]), 1.0, 1)


def flown_over(places: FloatArray, every: float) -> FloatArray:
    """Points (n, 3) on the straight ways from one of `places` to the next, at most `every` m apart."""
    lines = []
    for a, b in itertools.pairwise(places):
        lines.append(np.linspace(a, b, math.ceil(float(np.linalg.norm(b - a)) / every) + 1))
    return np.concatenate(lines) if lines else places


def path_of(flight: Flight, uav: int = 0) -> list[Any]:
    mapping: Any = flight.team[0][uav].mapping  # type: ignore[attr-defined]
    return [row.tolist() for row in mapping.kernel.positions]


# --- the boustrophedon flight


@pytest.mark.parametrize("speed", [0.2, 0.7])
def test_the_flight_measures_every_column_of_cells_of_the_tunnel(speed: float) -> None:
    survey = surveyed(tunnel())
    kernel = KernelMap(Cells(np.zeros(3), BOX))
    for place in flown_over(survey.goals, 0.05):  # 10 Hz at 0.5 m/s
        kernel.add(place, 1.0, (speed, 0.0, 0.0))
    assert kernel.measured.all()


def test_no_place_is_farther_from_the_flight_than_half_the_diagonal_of_a_spacing() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        low = rng.uniform(-5.0, 5.0, 3)
        high = low + rng.uniform(0.5, 6.0, 3)
        start, spacing, stop = rng.uniform(low, high), rng.uniform(0.3, 3.0), rng.uniform(0.2, 2.0)
        places = goals(low, high, start, spacing, stop)
        assert ((places >= low) & (places <= high)).all()
        track = flown_over(places, 0.05)
        anywhere = rng.uniform(low, high, (200, 3))
        nearest = np.linalg.norm(anywhere[:, None] - track[None], axis=2).min(axis=1)
        assert nearest.max() <= 0.5 * math.sqrt(3.0) * spacing + 0.025
        # a lane is cut into goals `stop` apart, and the next lane is as near as the spacing
        assert np.linalg.norm(np.diff(places, axis=0), axis=1).max(initial=0.0) <= max(stop, spacing) + 1e-9
        corner = np.where(start > 0.5 * (low + high), high, low)
        assert np.linalg.norm(places - corner, axis=1).argmin() == 0


def test_the_flight_fits_the_time_and_is_finer_with_more_of_it() -> None:
    spacings = []
    for seconds in (60.0, 270.0, 1000.0, 1e6):
        survey = surveyed(tunnel(**{"ending.time_limit": seconds, "ending.max_decisions": 10**8}))
        length = np.linalg.norm(np.diff(survey.goals, axis=0), axis=1).sum()
        assert length / 0.5 <= 0.9 * seconds
        spacings.append(survey.spacing)
    assert spacings == sorted(spacings, reverse=True)
    assert spacings[-1] == pytest.approx(0.1)  # a cell: no finer
    assert surveyed(tunnel(), lane_spacing=0.4).spacing == 0.4


def test_there_is_always_a_flight_and_it_goes_back_the_same_way() -> None:
    assert len(surveyed(tunnel(**{"ending.time_limit": 0.5})).goals) >= 1
    survey = surveyed(tunnel())
    there = [survey.next_goal() for _ in range(len(survey.goals))]
    back = [survey.next_goal() for _ in range(len(survey.goals) - 1)]
    assert np.array_equal(there, survey.goals)
    assert np.array_equal(back, survey.goals[-2::-1])
    assert np.array_equal(survey.next_goal(), survey.goals[1])
    with pytest.raises(InputError, match=r"^survey: lane_spacing = 1e-06 m.*at most 1000000 goals$"):
        surveyed(tunnel(), lane_spacing=1e-6)
    single = surveyed(tunnel(), lane_spacing=100.0)
    assert len(single.goals) == 1
    assert np.array_equal([single.next_goal() for _ in range(3)], np.repeat(single.goals, 3, axis=0))


def test_uavs_divide_the_volume() -> None:
    task = small()
    parts = [share_of(told(task, uav)) for uav in range(3)]
    assert sum(float(np.prod(high - low)) for low, high in parts) == pytest.approx(20.0 * 20.0 * 10.0)
    for uav, (low, high) in enumerate(parts):
        places = surveyed(task, uav).goals
        assert ((places > low) & (places < high)).all()
    assert np.array_equal(parts[0][1][[0]], parts[1][0][[0]])
    assert np.array_equal(parts[1][1][[0]], parts[2][0][[0]])


def test_no_goal_is_in_an_obstacle() -> None:
    task = small(**{"arena.obstacles": [OBSTACLE]})
    for uav in range(3):
        places = surveyed(task, uav, lane_spacing=2.0).goals
        assert task.arena.free(places).all()
    free, every = surveyed(task, 1, lane_spacing=2.0).goals, surveyed(small(), 1, lane_spacing=2.0).goals
    assert len(free) < len(every)


# --- the choice by information


@pytest.mark.parametrize("candidates", ["four", "eight"])
def test_candidates_are_a_step_away_and_inside(candidates: Any) -> None:
    p = InformationParameters(candidates=candidates)
    rng = np.random.default_rng(1)
    for here in (*rng.uniform(0.0, BOX, (50, 3)), np.zeros(3), BOX):
        places = around(p, here, np.zeros(3), BOX, 1.0)
        assert ((places >= 0.0) & (places <= BOX)).all()
        steps = np.abs(places - here)
        assert np.isclose(steps, 0.0).sum() + np.isclose(steps, [0.5, 0.5, 0.1]).sum() == steps.size
        assert (steps > 0.0).any(axis=1).all()
    middle = 0.5 * BOX
    assert len(around(p, middle, np.zeros(3), BOX, 1.0)) == {"four": 6, "eight": 10}[candidates]
    flat = InformationParameters(candidates=candidates, vertical=False)
    assert len(around(flat, middle, np.zeros(3), BOX, 1.0)) == {"four": 4, "eight": 8}[candidates]
    assert len(around(p, middle, np.zeros(3), BOX, 100.0)) == 0


@pytest.mark.parametrize("wind", [(0.6, 0.0, 0.0), (-0.3, 0.8, 0.1), (0.0, 0.0, 0.0), (0.01, 0.0, 0.0)])
def test_predictions_are_those_of_the_source_term(wind: tuple[float, float, float]) -> None:
    cells = Cells(np.zeros(3), BOX, (5, 4, 3))
    term, rng = SourceTerm(cells), np.random.default_rng(2)
    prior = term.prior(wind)
    sources = prior.low + prior.side * rng.random((6, 8))
    order = rng.permutation(cells.n)
    readings = predictions(sources, cells.centres[order], np.array(wind), term.parameters.minimum_speed)
    maps = np.array([term.plume_map(source, wind)[order] for source in sources])
    np.testing.assert_allclose(readings, maps, rtol=1e-12, atol=1e-300)


def divergence_by_hand(predicted: list[float], outcomes: list[float], sigma: float) -> float:
    """The mean over the outcomes of sum p' log(p' / p), by Bayes' theorem."""
    prior = 1.0 / len(predicted)
    total = 0.0
    for outcome in outcomes:
        joint = [prior * math.exp(-((outcome - c) ** 2) / (2.0 * sigma**2)) for c in predicted]
        posterior = [j / math.fsum(joint) for j in joint]
        total += math.fsum(p * math.log(p / prior) for p in posterior if p > 0.0)
    return total / len(outcomes)


def test_the_expected_divergence_is_that_of_bayes_theorem() -> None:
    rng = np.random.default_rng(3)
    predicted, outcomes = rng.gamma(1.0, 40.0, (7, 4)), rng.gamma(1.0, 40.0, (5, 4))
    nats = expected_divergence(predicted, outcomes, 30.0)
    by_hand = [divergence_by_hand(predicted[:, m].tolist(), outcomes[:, m].tolist(), 30.0) for m in range(4)]
    np.testing.assert_allclose(nats, by_hand, rtol=1e-10)
    # the unit of the reading does not matter
    np.testing.assert_allclose(expected_divergence(8.0 * predicted, 8.0 * outcomes, 240.0), nats, rtol=1e-12)


def test_the_expected_divergence_lies_between_nothing_and_everything() -> None:
    same, apart = np.full((9, 1), 5.0), np.arange(9.0)[:, None] * 1e6
    assert expected_divergence(same, same, 1.0)[0] == pytest.approx(0.0, abs=1e-12)
    assert expected_divergence(apart, apart, 1.0)[0] == pytest.approx(math.log(9.0), rel=1e-12)
    assert np.isfinite(expected_divergence(apart, np.array([[-1e12]]), 1.0)).all()  # a reading that nobody predicts


def test_the_expected_divergence_of_a_normal_prediction_is_known() -> None:
    # Prior N(0, s^2), outcomes drawn from it without error. With f = sigma^2 / (s^2 + sigma^2) the posterior of outcome
    # y is N((1 - f) y, f s^2), and the mean KLD 1/2 (f + (1 - f)^2 - 1 - log f). The mean of y^2 / s^2 over 2000 draws
    # has a standard error of 3 %, which makes 2 % of the KLD: four of them are allowed.
    s, sigma = 3.0, 1.5
    draws = np.random.default_rng(4).normal(0.0, s, (2000, 1))
    share = sigma**2 / (s**2 + sigma**2)
    known = 0.5 * (share + (1.0 - share) ** 2 - 1.0 - math.log(share))
    assert expected_divergence(draws, draws, sigma)[0] == pytest.approx(known, rel=0.08)


def concentration(source: FloatArray, place: FloatArray, speed: float) -> float:
    """(2) in a wind along x."""
    q, xs, ys, zs, ay, by, az, bz = source.tolist()
    x, y, z = (place - [xs, ys, zs]).tolist()
    if x < 0.0:
        return 0.0
    sy, sz = ay * x + by, az * x + bz
    exponent = -(y**2) / (2.0 * sy**2) - z**2 / (2.0 * sz**2)
    return float(q / (2.0 * math.pi * speed * sy * sz) * math.exp(exponent))


def test_the_choice_is_that_of_brute_force() -> None:
    cells, rng = Cells(np.zeros(3), BOX), np.random.default_rng(5)
    prior = SourceTerm(cells).prior(LEVEL)
    p, winners = InformationParameters(), set()
    for _ in range(30):
        chain = prior.low + prior.side * rng.random((12, 8))
        here, speed = rng.uniform(0.0, BOX), float(LEVEL[0])
        places = around(p, here, np.zeros(3), BOX, 1.0)
        readings = [[concentration(source, place, speed) for source in chain] for place in places]
        by_hand = [divergence_by_hand(r, r, 30.0) for r in readings]
        nats = most_informative(p, chain, places, LEVEL, 0.05, 30.0)
        np.testing.assert_allclose(nats, by_hand, rtol=1e-9, atol=1e-12)
        chosen = choose(nats, rng)
        assert by_hand[chosen] >= max(by_hand) - 1e-8
        winners.add(chosen)
    assert len(winners) > 2


def test_one_reading_may_stand_for_all() -> None:
    cells, rng = Cells(np.zeros(3), BOX), np.random.default_rng(6)
    prior = SourceTerm(cells).prior(LEVEL)
    chain, places = prior.low + prior.side * rng.random((12, 8)), rng.uniform(0.0, BOX, (4, 3))
    nats = most_informative(InformationParameters(predicted="estimate"), chain, places, LEVEL, 0.05, 30.0)
    for place, nat in zip(places, nats.tolist(), strict=True):
        predicted = [concentration(source, place, 0.6) for source in chain]
        expected = concentration(chain.mean(axis=0), place, 0.6)
        assert nat == pytest.approx(divergence_by_hand(predicted, [expected], 30.0), rel=1e-9, abs=1e-12)


def test_of_equal_candidates_one_is_drawn() -> None:
    rng = np.random.default_rng(7)
    drawn = [choose(np.array([0.3, 0.1, 0.3]), rng) for _ in range(400)]
    assert set(drawn) == {0, 2}
    assert abs(drawn.count(0) - 200) < 4 * 10  # binomial, four standard deviations


# --- whole flights


@pytest.mark.parametrize("name", RIVALS)
def test_a_source_in_the_tunnel_is_found_and_declared_at_the_end(name: str) -> None:
    # errors of the estimates are some 0.2 m, those of the peak 0.6 m: below 1 and 2.5 m with room to spare
    flight = fly(RIVALS[name], tunnel(), [3])
    policy: Any = flight.team[0][0]
    declared, source = policy.declaration(), flight.world.source_position[0, 0]
    assert np.linalg.norm(declared - source) < (2.5 if name == "kernel-peak" else 1.0)
    assert 270.0 - flight.world.episode["clock"][0] <= 0.2 + 1e-9
    belief = policy.belief()
    assert belief.gas_map.values.shape == (14, 10, 5)
    assert np.allclose(belief.gas_map.low + belief.gas_map.spacing * belief.gas_map.values.shape, BOX)
    assert (policy.mapping.posterior is None) == (name == "kernel-peak")
    assert policy.mode == ("survey" if name == "kernel-peak" else "record")
    if name == "kernel-peak":
        kernel = policy.mapping.kernel
        peak = policy.mapping.cells.index_of(declared)
        assert kernel.mean[peak] == kernel.mean[kernel.measured].max()
        assert np.array_equal(belief.mean, declared)


@pytest.mark.parametrize("name", RIVALS)
def test_a_flight_is_a_function_of_its_seed(name: str) -> None:
    task = tunnel(**{"ending.time_limit": 15.0})
    first, again = fly(RIVALS[name], task, [5]), fly(RIVALS[name], task, [4, 5])
    assert path_of(first) == path_of(dataclasses.replace(again, team=again.team[1:]))


def test_a_survey_does_not_depend_on_what_is_read() -> None:
    task = tunnel(**{"ending.time_limit": 20.0})
    moved = tunnel(**{"ending.time_limit": 20.0, "sources.positions": [[6.0, 0.3, 0.1]]})
    paths = [path_of(fly(RIVALS[name], t, [1])) for name in ("kernel-peak", "boustrophedon-ste") for t in (task, moved)]
    assert all(path == paths[0] for path in paths)


@pytest.mark.parametrize("name", RIVALS)
def test_what_cannot_be_smelt_changes_nothing(name: str) -> None:
    changes = {"plume.source_strength": 1e-15, "action": "waypoint", "team.n_uavs": 1}
    near = fly(RIVALS[name], small(**changes), [2])
    far = fly(RIVALS[name], small(**changes, **{"sources.positions": [(1.0, 2.0, 3.0)]}), [2])
    assert path_of(near) == path_of(far)
    assert near.team[0][0].declaration() is None


@pytest.mark.parametrize("name", RIVALS)
@pytest.mark.parametrize("command", ["velocity", "setpoint", "waypoint"])
@pytest.mark.parametrize(
    "changes",
    [
        {"wind.velocity": (0.0, 0.0, 0.0)},
        {"wind.velocity": (0.6, -1.1, 0.0), "arena.obstacles": [OBSTACLE]},
        {"arena.size": (20.0, 20.0, 1.0), "sources.positions": [(0.0, 20.0, 1.0)],
         "team.starts": [(20.0, 0.0, 0.0), (0.0, 0.0, 1.0), (20.0, 20.0, 0.5)]},
    ],
    ids=["calm", "obstacle", "flat corner"],
)  # fmt: skip
def test_they_fly_in_any_area_wind_and_vehicle(name: str, command: str, changes: dict[str, Any]) -> None:
    flight = fly(RIVALS[name], flying(action=command, **{"ending.time_limit": 25.0}, **changes), [1])
    assert not flight.world.running[0]
    for uav in range(3):
        path = path_of(flight, uav)
        assert path
        assert np.isfinite(path).all()


@pytest.mark.parametrize("name", RIVALS)
def test_one_cell_and_all_cells_are_maps_too(name: str) -> None:
    for changes in ({"shape": (1, 1, 1)}, {"used_cells": "all"}):
        policy = RIVALS[name].model_copy(update=changes)
        assert fly(policy, tunnel(**{"ending.time_limit": 8.0}), [1]).team[0][0].belief() is not None


@pytest.mark.parametrize("name", RIVALS)
def test_uavs_share_readings_if_they_are_told_to(name: str) -> None:
    task = small(**{"action": "waypoint", "ending.time_limit": 40.0})
    shared, silent = fly(RIVALS[name], task, [1]), fly(RIVALS[name].model_copy(update={"sharing": False}), task, [1])
    assert min(len(path_of(shared, uav)) for uav in range(3)) > max(len(path_of(silent, uav)) for uav in range(3))


def test_the_goal_lies_between_the_candidate_and_the_source() -> None:
    """Exploration 1: every goal is a candidate; 0: the guess of the source."""
    for share in (0.0, 1.0):
        policy = RahbarSTE(**QUICK, exploration=share)
        policy.reset(told(tunnel()))
        flight: Any = policy._flight
        seen = begun(tunnel()).observation(0, 0)
        seen = dataclasses.replace(seen, position=np.array([3.0, 1.0, 0.25]), reading=50.0, sampling_time=0.1)
        for _ in range(20):
            flight.mapping.take(seen)
        goal = flight._next_goal(seen)
        if share == 0.0:
            np.testing.assert_allclose(goal, flight.mapping.guess, atol=1e-12)
        else:
            offset = np.sort(np.abs(goal - seen.position))
            assert np.allclose(offset, [0, 0, 0.5]) or np.allclose(offset, [0, 0, 0.1])
        assert flight._next_goal(seen) is None  # not before `goal_time` is over


@pytest.mark.parametrize(
    ("name", "key", "value"),
    [
        ("kernel-peak", "lane_spacing", 0),
        ("kernel-peak", "minimum_gas", -1),
        ("boustrophedon-ste", "survey_share", 1.5),
        ("boustrophedon-ste", "goal_distance", -1),
        ("boustrophedon-ste", "samples", 0),
        ("rahbar-ste", "candidates", "six"),
        ("rahbar-ste", "exploration", 2),
        ("rahbar-ste", "predictions", 1),
        ("rahbar-ste", "step", "fast"),
        ("rahbar-ste", "vertical_step", 0),
        ("rahbar-ste", "goal_time", -1),
    ],
)
def test_bad_parameters_are_refused_in_one_line(name: str, key: str, value: Any) -> None:
    with pytest.raises(InputError) as caught:
        make_policy(name, **{key: value})
    assert str(caught.value).startswith(f"policy {name}: {key}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", RIVALS)
def test_a_policy_that_was_not_briefed_says_so(name: str) -> None:
    policy: Any = type(RIVALS[name])()
    with pytest.raises(RuntimeError, match=f"{name}: reset"):
        policy.act(begun(tunnel()).observation(0, 0), ())
    assert policy.belief() is None
    assert policy.declaration() is None
    assert policy.mapping is None
