"""The chemotaxis policy: its modes, targets, window and declarations, decision by decision."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from baselines import make_policy
from baselines.chemotaxis.policy import Chemotaxis
from baselines.policy import Briefing, Policy
from osl_env import InputError, load_scenario
from osl_env.actions import Action, Hover, Setpoint, Waypoint
from osl_env.observation import Observation
from osl_env.parameters import FloatArray

PERIOD = 0.05  # s
START = (25.0, 3.0, 3.0)
SLOPE = np.array([0.02, -0.03, 0.06])  # of a linear field, 1/m


def briefed(
    uav: int = 0, start: Sequence[float] = START, scenario: dict[str, Any] | None = None, **told: Any
) -> Briefing:
    """A briefing of puff-source1, with some of it told differently."""
    briefing = Briefing.of(load_scenario("puff-source1", **(scenario or {})), uav, 1, np.array(start))
    return dataclasses.replace(briefing, **told)


def pilot(briefing: Briefing | None = None, **parameters: Any) -> Policy:
    policy = make_policy("chemotaxis", **parameters)
    policy.reset(briefing or briefed())
    return policy


def seen(
    position: Sequence[float],
    time: float,
    reading: float = 0.0,
    velocity: Sequence[float] = (0.0, 0.0, 0.0),
    sampling_time: float = PERIOD,
    others: Sequence[tuple[Sequence[float], float, float]] = (),
) -> Observation:
    """An observation; `others` are heard: where each was, what it read, and how long ago."""
    place, n = np.array(position, dtype=np.float64), len(others)
    return Observation(
        time=time, decision=0, ready=True, position=place, velocity=np.array(velocity, dtype=np.float64),
        wind=np.array([2.0, 0.0, 0.0]), reading=reading, sampling_time=sampling_time, energy_left=1e5, time_left=600.0,
        detection_mask=np.zeros(3, np.bool_), detection_age=np.zeros(3), detection_offset=np.zeros((3, 3)),
        detection_reading=np.zeros(3), neighbour_mask=np.ones(n, np.bool_), neighbour_id=np.arange(1, n + 1),
        neighbour_offset=np.array([where for where, _, _ in others]).reshape(-1, 3) - place,
        neighbour_reading=np.array([c for _, c, _ in others]), neighbour_sampling_time=np.full(n, PERIOD),
        neighbour_age=np.array([age for _, _, age in others]), ranges=np.zeros(0),
    )  # fmt: skip


def target(action: Action) -> FloatArray:
    assert isinstance(action, Setpoint)
    return action.position


def linear(place: FloatArray) -> float:
    return float(1.0 + SLOPE @ (place - [15.0, 15.0, 5.0]))


def detect(policy: Policy, place: FloatArray, time: float, velocity: Sequence[float] = (0.0, 3.0, 0.0)) -> FloatArray:
    """The target after a reading of the linear field at `place`."""
    return target(policy.act(seen(place, time, linear(place), velocity), ()))


def wander(count: int, seed: int = 0) -> FloatArray:
    """Places of a flight that is nowhere straight, (count, 3) m."""
    return np.array([15.0, 15.0, 5.0]) + np.cumsum(np.random.default_rng(seed).normal(0.0, 0.05, (count, 3)), axis=0)


def test_it_scans_way_point_after_way_point_a_carrot_ahead() -> None:
    """A vehicle that goes where it is told flies the paper's first layer."""
    policy, place, corners = pilot(), np.array(START), []
    for step in range(400):
        aim = target(policy.act(seen(place, step * PERIOD), ()))
        assert policy.mode == "scan"
        assert np.linalg.norm(aim - place) <= 2.5 + 1e-9
        if np.linalg.norm(aim - place) < 2.5 - 1e-9:
            corners.append(aim)
        place = place + 0.3 * (aim - place)
    turns = np.array(
        [corner for k, corner in enumerate(corners) if k == 0 or not np.array_equal(corner, corners[k - 1])]
    )
    np.testing.assert_allclose(turns[:4], [[25, 1.5, 3], [21, 1.5, 3], [21, 28.5, 3], [17, 28.5, 3]], atol=1e-12)


def test_a_way_point_that_cannot_be_reached_is_left() -> None:
    """Held back by the wind, say: after 5 s without progress the next one is tried."""
    policy = pilot()
    aims = [target(policy.act(seen((25.0, 2.0, 3.0), step * PERIOD), ())) for step in range(130)]
    np.testing.assert_allclose(aims[95], [25.0, 1.5, 3.0])
    assert not np.array_equal(aims[-1], aims[95])


def test_a_reading_above_the_threshold_begins_the_search() -> None:
    for parameters, reading, mode in [({}, 0.05, "scan"), ({}, 0.0501, "search"), ({"threshold": 0.2}, 0.1, "scan"),
                                      ({"threshold": 0.08}, 0.081, "search"), ({}, math.nan, "scan")]:  # fmt: skip
        policy = pilot(**parameters)
        policy.act(seen(START, 0.0, reading), ())
        assert policy.mode == mode
    policy = pilot()
    policy.act(seen(START, 0.0, 1.0, sampling_time=0.0), ())  # nothing has been sampled yet
    assert policy.mode == "scan"


def test_a_counter_s_hits_are_compared_as_hits_a_second() -> None:
    told = load_scenario("rate-60x60x30")
    for counts, mode in ((0.0, "scan"), (1.0, "search")):
        policy = pilot(Briefing.of(told, 0, 1, np.array([3.0, 3.0, 3.0])))
        policy.act(seen((3.0, 3.0, 3.0), 0.0, counts, sampling_time=2.0), ())
        assert policy.mode == mode
    for threshold, mode in ((0.4, "search"), (0.6, "scan")):
        policy = pilot(Briefing.of(told, 0, 1, np.array([3.0, 3.0, 3.0])), threshold=threshold)
        policy.act(seen((3.0, 3.0, 3.0), 0.0, 1.0, sampling_time=2.0), ())  # half a hit a second
        assert policy.mode == mode


def test_until_the_window_is_full_it_flies_on_and_then_up_the_gradient() -> None:
    """(5) with v cut to the scan's carrot, and as printed; then (8), exact in a linear field but for the jitter."""
    places, uphill = wander(25), SLOPE / np.linalg.norm(SLOPE)
    for drift, ahead in (("clipped", [0.0, 2.5, 0.0]), ("printed", [0.0, 3.0, 0.0])):
        policy = pilot(drift=drift)
        for k, place in enumerate(places):
            expected = ahead if k < 19 else uphill
            np.testing.assert_allclose(detect(policy, place, k * PERIOD) - place, expected, atol=1e-6)
        slow = detect(pilot(drift=drift), places[0], 0.0, (0.0, 0.0, -1.5))
        np.testing.assert_allclose(slow - places[0], [0.0, 0.0, -1.5])


@pytest.mark.parametrize(("fill", "window", "needed"), [("search", 20, 20), ("search", 4, 4), ("scan", 20, 1)])
def test_the_window_fills_from_where_it_is_told_to(fill: str, window: int, needed: int) -> None:
    """Readings needed after the switch: with `scan`, thirty of before are there."""
    policy, places, needs = pilot(fill=fill, window=window, threshold=0.5), wander(60), 0
    for k, place in enumerate(places[:30]):
        policy.act(seen(place, k * PERIOD, linear(place) - 10.0), ())
    assert policy.mode == "scan"
    for k, place in enumerate(places[30:]):
        aim = target(policy.act(seen(place, (30 + k) * PERIOD, linear(place), (0.0, 3.0, 0.0)), ()))
        needs += 1
        if not np.allclose(aim - place, [0.0, 2.5, 0.0]):
            break
    assert needs == needed


def test_a_second_search_begins_with_an_empty_window() -> None:
    policy, places = pilot(lost_time=1.0), wander(60)
    for k, place in enumerate(places[:30]):
        detect(policy, place, k * PERIOD)
    policy.act(seen(places[30], 10.0), ())
    assert policy.mode == "scan"
    np.testing.assert_allclose(detect(policy, places[31], 10.0 + PERIOD) - places[31], [0.0, 2.5, 0.0])


def test_a_lost_search_scans_on_where_it_was() -> None:
    for lost_time in (2.0, 30.0, math.inf):
        policy, place = pilot(lost_time=lost_time), np.array([25.0, 2.5, 3.0])
        bound_for = target(policy.act(seen(place, 0.0), ()))
        detect(policy, place, PERIOD)
        modes = []
        for step in range(2, 1000):
            aim = target(policy.act(seen(place, step * PERIOD), ()))
            modes.append(policy.mode)
            if policy.mode == "scan":
                break
        if lost_time == math.inf:
            assert set(modes) == {"search"}
        else:
            assert modes.count("search") == pytest.approx(lost_time / PERIOD, abs=2)
            np.testing.assert_array_equal(aim, bound_for)


def test_a_detection_that_is_heard_recruits() -> None:
    """It flies to where the other was, and searches from there on, also without gas, until that is lost."""
    policy, place, there = pilot(briefed(1), lost_time=5.0), np.array(START), (20.0, 10.0, 5.0)
    policy.act(seen(place, 0.0, others=[(there, 0.05, 0.0)]), ())
    assert policy.mode == "scan"  # not above the threshold
    aim = target(policy.act(seen(place, 0.1, others=[(there, 0.06, 0.02)]), ()))
    assert policy.mode == "recruited"
    towards = np.array(there) - place
    np.testing.assert_allclose(aim - place, 2.5 * towards / np.linalg.norm(towards))
    time = 0.1
    while policy.mode == "recruited":
        time += PERIOD
        aim = target(policy.act(seen(place, time, others=[(there, 0.0, 0.0)]), ()))
        place = place + 0.2 * (aim - place)
        assert time < 20.0
    assert policy.mode == "search"
    assert np.linalg.norm(place - there) < 0.5
    for step in range(110):
        policy.act(seen(place, time + step * PERIOD), ())
    assert policy.mode == "scan"
    policy.act(seen(place, time + 6.0, others=[(there, 1.0, 3.0)]), ())
    assert policy.mode == "scan"  # what was sent before it gave up does not recruit it again
    policy.act(seen(place, time + 6.05, others=[(there, 1.0, 0.1)]), ())
    assert policy.mode == "recruited"


def test_the_recruited_search_where_they_smell_gas_themselves() -> None:
    policy = pilot(briefed(1))
    policy.act(seen(START, 0.0, others=[((5.0, 5.0, 5.0), 1.0, 0.0)]), ())
    policy.act(seen(START, 0.1, 0.2, others=[((5.0, 5.0, 5.0), 1.0, 0.0)]), ())
    assert policy.mode == "search"
    alone = pilot(briefed(1), sharing=False)
    alone.act(seen(START, 0.0, others=[((5.0, 5.0, 5.0), 1.0, 0.0)]), ())
    assert alone.mode == "scan"


@pytest.mark.parametrize("rule", ["jitter", "probe", "minimum_norm", "printed"])
def test_whatever_it_reads_it_stays_inside_and_clear(rule: str) -> None:
    """Random places, readings and velocities, near the bounds and two obstacles: targets are inside, ways are clear."""
    solid = {"arena.obstacles": [{"kind": "box", "low": (12, 10, 0), "high": (16, 20, 6)},
                                 {"kind": "cylinder", "center": (22.0, 22.0), "radius": 3.0}]}  # fmt: skip
    briefing = briefed(scenario=solid)
    policy, rng = pilot(briefing, rank_rule=rule, drift="printed", lost_time=2.0), np.random.default_rng(3)
    place, time = np.array(START), 0.0
    for _ in range(1500):
        reading = float(rng.choice([0.0, 0.01, 0.3, 40.0])) * rng.uniform()
        aim = target(policy.act(seen(place, time, reading, rng.normal(0.0, 3.0, 3)), ()))
        assert ((aim >= 0.0) & (aim <= [30.0, 30.0, 10.0])).all()
        assert briefing.arena.clear(place, aim)
        place = place + rng.uniform(0.0, 1.0) * (aim - place)
        time += PERIOD
    assert np.ptp(np.array([place, START]), axis=0).max() > 0.5


def test_targets_of_the_search_stay_off_the_bounds() -> None:
    """Downhill through the floor, at a place near it: by `bounds_margin`, or a quarter of a side that is too short."""
    for height, margin, lowest in ((10.0, 0.5, 0.5), (10.0, 0.0, 0.0), (1.0, 0.5, 0.25)):
        policy = pilot(briefed(area=np.array([30.0, 30.0, height])), bounds_margin=margin)
        places = np.array([15.0, 15.0, 0.4]) + 0.1 * np.random.default_rng(1).normal(size=(20, 3))
        for k, place in enumerate(places):
            aim = target(policy.act(seen(place, k * PERIOD, 5.0 - float(place[2])), ()))
        assert aim[2] == lowest


def test_legs_where_there_are_no_setpoints() -> None:
    """(5) takes the last leg for v; a held position is hovering; each leg ends with one sample."""
    told = briefed(action="leg")
    policy, places = pilot(told), wander(25)
    legs = [policy.act(seen(place, float(k), linear(place), sampling_time=1.0), ()) for k, place in enumerate(places)]
    assert all(isinstance(leg, Waypoint) and leg.samples == 1 for leg in legs)
    for k in range(1, 19):
        np.testing.assert_allclose(legs[k].position, places[k] + (places[k] - places[k - 1]), atol=1e-12)
    np.testing.assert_allclose(legs[20].position - places[20], SLOPE / np.linalg.norm(SLOPE), atol=1e-6)
    still = pilot(told, rank_rule="printed")
    for k in range(25):
        action = still.act(seen(START, float(k), 1.0, sampling_time=1.0), ())
    assert action == Hover(1)


def test_it_declares_where_it_stays_in_strong_gas() -> None:
    """Samples of 50 ms add up to the rule's 8 s; while it suspects, it holds still. Where the search goes on after a
    declaration, nobody asked for it: it climbs on."""
    policy, first = pilot(briefed(success_radius=5.0)), 0
    place = np.array([11.0, 15.0, 1.0])
    for k in range(400):
        aim = target(policy.act(seen(place + np.array([0.001 * k, 0, 0]), k * PERIOD, 100.0), ()))
        if policy.declaration() is not None:
            first = k
            break
    assert 7.9 <= first * PERIOD <= 9.1
    np.testing.assert_allclose(policy.declaration(), place, atol=0.2)
    np.testing.assert_allclose(aim, place, atol=0.05)
    aim = target(policy.act(seen(place, 20.0, 100.0), ()))
    assert policy.declaration() is None
    assert np.linalg.norm(aim - place) > 0.4
    faint = pilot(briefed(success_radius=5.0))
    for k in range(400):
        faint.act(seen(place, k * PERIOD, 0.2), ())
        assert faint.declaration() is None


def test_layers_must_fit_the_area() -> None:
    policy = make_policy("chemotaxis", layer_heights=[2.0, 10.5])
    with pytest.raises(InputError, match=r"^policy chemotaxis: layer_heights.1 = 10.5: .* area's height, 0 to 10 m$"):
        policy.reset(briefed())
    policy = pilot(layer_heights=["200 cm", 9.0])
    assert isinstance(policy, Chemotaxis)
    assert policy.layer_heights == (2.0, 9.0)
    np.testing.assert_allclose(target(policy.act(seen((25.0, 1.6, 2.1), 0.0), ()))[2], 2.0, atol=0.1)


def test_the_first_decision_needs_a_briefing() -> None:
    policy = make_policy("chemotaxis")
    assert policy.mode == ""
    assert policy.declaration() is None
    with pytest.raises(RuntimeError, match="reset"):
        policy.act(seen(START, 0.0), ())
