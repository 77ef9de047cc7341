"""The policies `swarm` and `plume-finding`: filter, radio, batches, locality, the line, bad input."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from baselines import Briefing, make_policy
from baselines.swarm.finding import FindingParameters, Line
from baselines.swarm.law import total_force
from baselines.swarm.policy import Swarm
from baselines.swarm.steering import pack
from osl_env import InputError, Observation, Scenario, World, load_scenario
from osl_env.actions import Velocity
from osl_env.parameters import FloatArray
from osl_env.radio import Message

ARENA = load_scenario("arena-4x6-0")
SPEED = 0.1  # m/s
NOWHERE = np.zeros(0)


def briefed(uav: int = 0, task: Scenario = ARENA, start: Sequence[float] = (5.5, 2.0, 0.1), **changes: Any) -> Briefing:
    return replace(Briefing.of(task, uav, 1, np.array(start)), **changes)


def pilot(uav: int = 0, briefing: Briefing | None = None, **parameters: Any) -> Swarm:
    made = make_policy("swarm", **({"finding": False} | parameters))
    assert isinstance(made, Swarm)
    made.reset(briefing or briefed(uav))
    return made


def seen(
    place: Sequence[float],
    reading: float = 0.0,
    *,
    time: float = 0.0,
    wind: Sequence[float] = (0.5, 0.0, 0.0),
    ranges: Sequence[float] = (0.15,) * 8,
    sampling_time: float = 0.1,
) -> Observation:
    nothing, none = np.zeros((0, 3)), np.zeros(0, dtype=np.bool_)
    return Observation(
        time=time, decision=round(time / 0.05), ready=True, position=np.array(place, dtype=np.float64),
        velocity=np.zeros(3), wind=np.array(wind, dtype=np.float64), reading=reading, sampling_time=sampling_time,
        energy_left=1e6, time_left=600.0, detection_mask=none, detection_age=NOWHERE, detection_offset=nothing,
        detection_reading=NOWHERE, neighbour_mask=none, neighbour_id=np.zeros(0, dtype=np.int64),
        neighbour_offset=nothing, neighbour_reading=NOWHERE, neighbour_sampling_time=NOWHERE, neighbour_age=NOWHERE,
        ranges=np.array(ranges, dtype=np.float64),
    )  # fmt: skip


def frame(sender: int, place: Sequence[float], payload: bytes = b"", *, reading: float = 0.0) -> Message:
    return Message(sender, 0.0, np.array(place, dtype=np.float64), reading, 0.1, payload)


def flown(policy: Swarm, observation: Observation, inbox: Sequence[Message] = ()) -> FloatArray:
    action = policy.act(observation, inbox)
    assert isinstance(action, Velocity)
    return action.velocity


def test_alone_in_clean_air_it_goes_upwind_at_its_speed() -> None:
    assert np.allclose(flown(pilot(), seen((3, 2, 0.1))), [-SPEED, 0, 0])
    assert flown(pilot(), seen((3, 2, 0.1), wind=(0, 0, 0))).tolist() == [0, 0, 0]  # no wind, no gas: no force


def test_it_flies_the_law_of_what_it_heard() -> None:
    places = np.array([[3.3, 2.0, 0.1], [2.4, 2.1, 0.1], [3.02, 1.99, 0.1]])
    means = [0.5, 0.25, 0.75]  # exact in the frame's float32
    policy = pilot(filter_time=0.0, gradient_gain=1e-3, wind_gain=0.01, repulsion_gain=1e-6, attraction_gain=1e-3)
    inbox = [frame(k + 1, place, pack(mean, True)) for k, (place, mean) in enumerate(zip(places, means, strict=True))]
    velocity = flown(policy, seen((3, 2, 0.1), 0.125), inbox)
    law = policy.robot.law
    expected = total_force(places - [3, 2, 0.1], means, 0.125, 0.75, [0.5, 0, 0], (), law)
    assert np.linalg.norm(expected) < SPEED  # not cut
    assert np.allclose(velocity, expected, rtol=1e-9, atol=1e-12)


def test_the_ground_has_no_height_and_the_air_has() -> None:
    inbox = [frame(1, (3.0, 2.3, 0.4), pack(1.0, True))]
    assert flown(pilot(), seen((3, 2, 0.1), wind=(0.1, 0, 0.3)), inbox)[2] == 0.0
    flying = pilot(briefing=briefed(planar=False), wind_gain=0.0)
    velocity = flown(flying, seen((3, 2, 0.1)), inbox)
    assert velocity[2] == pytest.approx(velocity[1]) == pytest.approx(SPEED / math.sqrt(2.0))


def test_the_mean_is_exact_for_any_period() -> None:
    readings = [1.0, 0.2, 0.0, 3.0]  # g/m^3, each held for 0.1 s
    coarse, fine = pilot(), pilot()
    expected = 0.0
    for k, reading in enumerate(readings):
        coarse.broadcast(seen((3, 2, 0.1), reading, time=0.1 * k + 0.1))
        expected += (1.0 - math.exp(-0.1 / 5.0)) * (reading - expected)
        for half in (0.0, 0.05):
            fine.broadcast(seen((3, 2, 0.1), reading, time=0.1 * k + 0.05 + half, sampling_time=0.05))
    assert coarse.robot.concentration == pytest.approx(expected, rel=1e-12)
    assert fine.robot.concentration == pytest.approx(expected, rel=1e-12)
    without = pilot(filter_time=0.0)
    without.broadcast(seen((3, 2, 0.1), 0.7))
    assert without.robot.concentration == 0.7
    unsampled = pilot()
    unsampled.broadcast(seen((3, 2, 0.1), 0.7, sampling_time=0.0))
    assert unsampled.robot.concentration == 0.0


def test_an_observation_counts_once_and_broadcasting_it_first_changes_nothing() -> None:
    talking, silent = pilot(), pilot()
    for k in range(3):
        now = seen((3, 2, 0.1), 0.4, time=0.1 * k)
        payload = talking.broadcast(now)
        assert payload is not None
        assert len(payload) == 5
        assert np.array_equal(flown(talking, now), flown(silent, now))
    assert talking.robot.concentration == silent.robot.concentration


def test_the_largest_mean_is_of_its_own_and_of_those_heard() -> None:
    policy = pilot(filter_time=0.0)
    flown(policy, seen((3, 2, 0.1), 0.5))
    assert policy.robot.largest == 0.5
    flown(policy, seen((3, 2, 0.1), 0.1, time=0.1), [frame(1, (3.3, 2, 0.1), pack(2.0, False))])
    assert policy.robot.largest == 2.0
    flown(policy, seen((3, 2, 0.1), 0.1, time=0.2))
    assert policy.robot.largest == 2.0


def test_other_payloads_mean_the_reading() -> None:
    here, there = seen((3, 2, 0.1)), (3.3, 2.2, 0.1)
    velocity = flown(pilot(), here, [frame(1, there, pack(0.5, False))])
    for foreign in (b"", b"something else", b"\x00\x00\xc0\x7f\x01"):  # the last is a NaN
        assert np.array_equal(flown(pilot(), here, [frame(1, there, foreign, reading=0.5)]), velocity)
    hits = load_scenario("rate-60x60x30")
    counting = make_policy("swarm", finding=False, gradient_gain=5.0)
    counting.reset(Briefing.of(hits, 0, 1, np.array([5.0, 5.0, 5.0])))
    counting.act(seen((5, 5, 5), ranges=()), [frame(1, (6, 5, 5), reading=2.0)])
    assert counting.robot.largest == pytest.approx(2.0 / 0.1)  # hits a second


def test_only_the_newest_frame_of_a_sender_counts() -> None:
    here = seen((3, 2, 0.1))
    old, new = frame(1, (2.7, 2, 0.1), pack(0.5, False)), frame(1, (3, 2.3, 0.1), pack(0.5, False))
    assert np.array_equal(flown(pilot(), here, [old, new]), flown(pilot(), here, [new]))


def test_whoever_is_beyond_the_neighbour_distance_does_not_move_it() -> None:
    here = seen((3, 2, 0.1))
    far = [frame(1, (3, 3.01, 0.1), pack(0.0, False))]
    assert np.array_equal(flown(pilot(), here, far), flown(pilot(), here))


def test_robots_at_one_place_part() -> None:
    place = (3.0, 2.0, 0.1)
    pair = [pilot(k, filter_time=0.0, wind_gain=0.0) for k in (0, 1)]
    frames = [frame(k, place, pack(0.5, True)) for k in (0, 1)]
    velocities = [flown(pair[k], seen(place, 0.5), [frames[1 - k]]) for k in (0, 1)]
    assert np.array_equal(velocities[0], -velocities[1])
    assert np.linalg.norm(velocities[0]) == pytest.approx(SPEED)


def test_obstacles_push_it_away_whatever_it_does() -> None:
    near = (0.1, *(0.15,) * 7)  # something at 10 cm along +x
    for finding in (False, True):
        assert np.allclose(flown(pilot(finding=finding), seen((3, 2, 0.1), ranges=near)), [-SPEED, 0, 0], atol=1e-3)


def team(n: int, seed: int, **parameters: Any) -> tuple[list[Swarm], list[Observation], list[list[Message]]]:
    """`n` robots with random readings that all hear each other."""
    rng = np.random.default_rng(seed)
    pilots = [pilot(k, **parameters) for k in range(n)]
    views = [seen((*rng.uniform(2, 3, 2), 0.1), rng.exponential(0.3), wind=(*rng.normal(0, 0.3, 2), 0),
                  ranges=rng.choice([0.1, 0.15], 8, p=[0.05, 0.95])) for _ in range(n)]  # fmt: skip
    frames = [frame(k, views[k].position, pilots[k].broadcast(views[k]) or b"") for k in range(n)]
    return pilots, views, [[sent for j, sent in enumerate(frames) if j != k] for k in range(n)]


@pytest.mark.parametrize("finding", [False, True])
def test_a_batch_decides_as_each_robot_by_itself(finding: bool) -> None:
    together, alone = team(15, 4, finding=finding), team(15, 4, finding=finding)
    other_world = team(7, 5, finding=finding)
    joined = [[*first, *second] for first, second in zip(together, other_world, strict=True)]
    actions = Swarm.act_batch(*joined)  # type: ignore[arg-type]
    for action, policy, view, inbox in zip(actions[:15], *alone, strict=True):
        assert np.array_equal(action.velocity, policy.act(view, inbox).velocity)  # type: ignore[union-attr]
    for policy, twin in zip(together[0], alone[0], strict=True):
        assert (policy.robot.largest, policy.robot.found) == (twin.robot.largest, twin.robot.found)


def test_what_happens_out_of_earshot_changes_nothing() -> None:
    velocities = []
    for place, source in (((0.5, 0.5, 0.1), [1.0, 1.0, 0.1]), ((1.5, 3.5, 0.1), [0.5, 3.5, 0.1])):
        starts = [(5.5, 2.0, 0.1), (5.2, 2.4, 0.1), place]
        task = ARENA.override(**{"team.n_uavs": 3, "team.starts": starts, "sources.positions": [source],
                                 "plume.release_rate": 1e-12, "action": "velocity"})  # fmt: skip
        world = World(task, 1)
        world.reset([3])
        pilots = [pilot(k, briefed(k, task, starts[k])) for k in range(3)]
        views = [world.observation(0, k) for k in range(3)]
        inboxes = world.exchange([[p.broadcast(view) for p, view in zip(pilots, views, strict=True)]])[0]
        assert [len(inbox) for inbox in inboxes] == [1, 1, 0]
        velocities.append([flown(pilots[k], views[k], inboxes[k]).tolist() for k in (0, 1)])
    assert velocities[0] == velocities[1]


def test_news_of_the_plume_goes_from_robot_to_robot() -> None:
    searchers = [pilot(k, finding=True) for k in range(3)]
    assert [p.mode for p in searchers] == ["finding"] * 3
    places = [(5.5, 2.0 + 0.8 * k, 0.1) for k in range(3)]  # a chain: each hears the next one only
    for decision, knowing in enumerate((2, 3)):
        views = [seen(places[k], 0.02 if k == 0 else 0.0, time=0.1 * decision) for k in range(3)]
        frames = [frame(k, places[k], searchers[k].broadcast(views[k]) or b"") for k in range(3)]
        for k, policy in enumerate(searchers):
            policy.act(views[k], [frames[j] for j in (k - 1, k + 1) if 0 <= j < 3])
        assert [p.mode for p in searchers] == ["tracking"] * knowing + ["finding"] * (3 - knowing)
    sweeping = make_policy("plume-finding")
    sweeping.reset(briefed())
    sweeping.act(seen(places[0], 0.02), [frame(1, places[1], pack(1.0, True))])
    assert sweeping.mode == "finding"
    assert sweeping.broadcast(seen(places[0])) is None


LARGE = load_scenario("arena-30x40")


def line(n: int, spacing: float, wind: Sequence[float] = (0.5, 0, 0), **changes: Any) -> list[Line]:
    """The places of `n` robots that have measured `wind`."""
    parameters = FindingParameters(line_spacing=spacing, **changes)
    made = [Line(parameters, briefed(k, LARGE, (37.0, 15.0, 0.1), n_uavs=n), 6.0) for k in range(n)]
    for one in made:
        one.measure(np.array(wind), 0.0)
    return made


def places(robots: Sequence[Line], times: Sequence[float] | FloatArray) -> FloatArray:
    """(times, robots, 3) m."""
    return np.array([[robot.place(float(time)) for robot in robots] for time in times])


@pytest.mark.parametrize("wind", [(0.5, 0.0, 0.0), (-0.3, 0.3, 0.0)])
def test_a_short_line_is_a_diagonal_with_equal_distances_that_sweeps_and_climbs(wind: tuple[float, ...]) -> None:
    there = places(line(5, 2.0, wind), np.arange(0.0, 1000.0))
    inside = ((there[..., :2] > 0.0) & (there[..., :2] < [40.0, 30.0])).all(axis=(1, 2))
    gaps = np.diff(there, axis=1)[inside]
    assert np.allclose(np.linalg.norm(gaps, axis=-1), 2.0)
    upwind = -np.array(wind) / np.linalg.norm(wind)
    assert np.allclose(gaps @ upwind, 2.0 * math.sin(math.pi / 4.0))
    steps = np.linalg.norm(np.diff(there[:, 0], axis=0), axis=1)
    assert np.median(steps) == pytest.approx(0.8 * 0.3)  # m in 1 s
    assert steps.max() < 0.3 + 1e-9
    if wind[1] == 0.0:
        assert inside.all()
        assert there[..., 1].min() < 1.5  # it covers the width, to half a spacing
        assert there[..., 1].max() > 28.5
        assert np.ptp(there[:, 0, 0]) > 20.0


def test_a_line_as_long_as_the_area_is_wide_goes_upwind_abreast() -> None:
    there = places(line(20, 3.0), (0.0, 50.0))
    assert np.allclose(there[0, :, 0], there[0, 0, 0])
    assert np.allclose(np.diff(there[0, :, 1]), -27.0 / 19.0)  # closed up, half a spacing from the walls
    assert np.allclose(there[1] - there[0], [-0.8 * 0.3 * 50.0, 0.0, 0.0])


def test_the_line_turns_back_at_the_upwind_end_and_knows_a_calm() -> None:
    rows = places(line(20, 3.0)[:1], np.arange(0.0, 400.0))[:, 0, 0]
    assert rows.min() == pytest.approx(2.5)  # twelve rows of 3 m from 38.5 m
    assert rows[-1] > rows.min() + 3.0
    assert np.isfinite(places(line(5, 2.0, (0.0, 0.0, 0.0)), (0.0, 12.0))).all()
    assert np.isfinite(places(line(1, 50.0), (0.0, 12.0))).all()
    abreast = places(line(5, 2.0, line_angle=0.0), (3.0,))
    assert np.allclose(abreast[0, :, 0], abreast[0, 0, 0])


def test_distances_that_contradict_are_refused_in_one_line() -> None:
    with pytest.raises(InputError, match=r"policy swarm: repulsion_distance = 0\.5: must be below attraction_distance"):
        make_policy("swarm", repulsion_distance=0.5, attraction_distance=0.5)
    for half in ({"repulsion_distance": 0.6}, {"attraction_distance": 0.05}):
        with pytest.raises(InputError, match="must be below attraction_distance") as refused:
            pilot(**half)
        assert "\n" not in str(refused.value)
    assert pilot(repulsion_distance=0.2, attraction_distance=0.3).robot.law.attraction_distance == 0.3
    with pytest.raises(InputError, match="sign"):
        make_policy("swarm", sign="wrong")


def test_units_other_than_the_papers_are_scaled_by_the_sensor() -> None:
    assert pilot().robot.law.gradient_gain == 50.0
    assert pilot(concentration_scale=0.5).robot.law.gradient_gain == 100.0
    hits = load_scenario("rate-60x60x30")
    assert pilot(briefing=briefed(task=hits)).robot.law.gradient_gain == 50.0 / hits.gas_sensor.scale
