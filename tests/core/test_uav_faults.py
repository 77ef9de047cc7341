"""Faults of UAVs: when they strike, what they do, and what they leave alone. Tolerance: 5 standard errors."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test
from worlds import NOISY, advance, begun, differences, fly, flying, hover, random_commands, small, standard_error

import osl_env
from osl_env import EpisodeRecord, InputError, Scenario, World, load_scenario
from osl_env.envs.vector import make_vec
from osl_env.faults import FAULT_KINDS
from osl_env.parameters import FloatArray
from osl_env.radio import HEADER_BYTES
from osl_env.state import COMMUNICATING, ENDED, LOST

SIGMAS = 5.0
LONG = {"ending.time_limit": 1e4}
FIVE = {"team.n_uavs": 5} | LONG
MODES: dict[str, Scenario] = {
    "hop": small(**FIVE),
    "event": small(**FIVE, clock="event", action="waypoint"),
    "velocity": flying(**FIVE),
}


def rule(kind: str, **values: Any) -> dict[str, Any]:
    return {f"uav_faults.{kind}": values}


def struck(kind: str, seeds: list[int], **values: Any) -> FloatArray:
    """When the UAVs of the episodes with `seeds` are struck: (n_envs, 5), s."""
    world = begun(small(**FIVE, **rule(kind, **values)), seeds)
    if world.faults is None:
        return np.full(world.motion.shape, np.inf)
    return world.faults.times[:, :, FAULT_KINDS.index(kind)]


def exchanged(world: World, payload: bytes = b"12345") -> list[list[int]]:
    """Exchange a payload of each UAV in world 0; the senders that each has heard."""
    inboxes = world.exchange([[payload] * world.n_uavs] * world.n_envs)[0]
    return [[message.sender for message in inbox] for inbox in inboxes]


@pytest.mark.parametrize("kind", FAULT_KINDS)
def test_times_at_a_rate_are_exponential(kind: str) -> None:
    times = struck(kind, list(range(2000)), rate=0.02).reshape(-1)
    assert abs(times.mean() - 50.0) < SIGMAS * standard_error(times)
    share = (times > 50.0).astype(float)
    assert abs(share.mean() - math.exp(-1.0)) < SIGMAS * standard_error(share)


def test_every_kind_and_uav_has_a_time_of_its_own() -> None:
    world = begun(small(**FIVE, **{f"uav_faults.{kind}.rate": 0.02 for kind in FAULT_KINDS}), list(range(500)))
    assert world.faults is not None
    ranks = np.argsort(np.argsort(world.faults.times.reshape(500, -1), axis=0), axis=0)
    correlation = np.corrcoef(ranks.T) - np.eye(15)
    assert abs(correlation).max() < SIGMAS / math.sqrt(500)


@pytest.mark.parametrize("kind", FAULT_KINDS)
def test_fewer_are_among_more_and_each_is_drawn_as_often(kind: str) -> None:
    seeds = list(range(1000))
    for n in range(5):
        fewer, more = (np.isfinite(struck(kind, seeds, number=k, time=10.0)) for k in (n, n + 1))
        assert (fewer.sum(axis=1) == n).all()
        assert (more.sum(axis=1) == n + 1).all()
        assert not (fewer & ~more).any()
        error = math.sqrt(n / 5 * (1 - n / 5) / 1000)
        assert np.abs(fewer.mean(axis=0) - n / 5).max() <= SIGMAS * error


def test_a_rule_names_a_uav_or_means_all() -> None:
    assert np.isfinite(struck("lost_uav", [1, 2], uav=3, time=9.0)).tolist() == [[False, False, False, True, False]] * 2
    assert (struck("lost_uav", [1, 2], time=9.0) == 9.0).all()
    assert (struck("dead_sensor", [1, 2], number=5) == 0.0).all()  # neither time nor rate: from the beginning
    assert (struck("lost_uav", [1], uav=2, time="2 min")[0, 2]) == 120.0
    rated, named = struck("lost_radio", [4], rate=0.1), struck("lost_radio", [4], rate=0.1, uav=3)
    assert named[0, 3] == rated[0, 3]  # whoever else is struck


ALL_KINDS = {f"uav_faults.{kind}": {"number": 2, "rate": 0.2} for kind in FAULT_KINDS}


@pytest.mark.parametrize("changes", [{}, NOISY, NOISY | {"clock": "event"}])
def test_an_episode_does_not_depend_on_the_batch_or_the_row(changes: dict[str, Any]) -> None:
    scenario = small(**FIVE, **ALL_KINDS, **changes)
    alone, among = begun(scenario, 7), begun(scenario, [1, 7, 2])
    rng = np.random.default_rng(0)
    for _ in range(40):
        (commands,) = random_commands(alone, rng)
        alone.step_hops(commands)
        among.step_hops(np.repeat(commands, 3, axis=0))
        assert differences(alone, 0, among, 1) == []
    assert (alone.motion["fate"][0] == LOST).sum() == 2


def test_a_rule_that_cannot_strike_is_no_rule() -> None:
    plain = small(**FIVE)
    for values in ({"number": 0, "time": 3.0}, {"rate": 0.0}):
        idle = small(**FIVE, **rule("lost_uav", **values))
        assert idle.hash == plain.hash
        assert World(idle).faults is None
    assert small(**FIVE, **rule("lost_uav", number=1)).hash != plain.hash
    assert plain.override(uav_faults={"lost_radio": None}).hash == plain.hash


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("kind", FAULT_KINDS)
def test_before_a_fault_the_episode_is_the_same(mode: str, kind: str) -> None:
    faulty = begun(MODES[mode].override(**rule(kind, number=2, time=1e5)), 3)
    plain, rng = begun(MODES[mode], 3), np.random.default_rng(1)
    for _ in range(15):
        commands = random_commands(plain, rng)
        advance(plain, commands)
        advance(faulty, commands)
        told = set(differences(plain, 0, faulty, 0)) - {"senses.sent_time"}  # which the shortcut to everybody keeps
        assert not told
        assert exchanged(plain) == exchanged(faulty)


@pytest.mark.parametrize("kind", FAULT_KINDS)
def test_plume_wind_and_the_others_sensors_are_the_same_with_and_without(kind: str) -> None:
    stage = load_scenario("puff-source1", **{"team.n_uavs": 3})
    plain, faulty = begun(stage, 5), begun(stage.override(**rule(kind, uav=1)), 5)
    points, rng = np.random.default_rng(0).uniform(0, 1, (40, 3)) * stage.arena.size, np.random.default_rng(2)
    for _ in range(12):
        commands = random_commands(plain, rng)
        advance(plain, commands)
        advance(faulty, commands)
        assert plain.concentration(0, points).tolist() == faulty.concentration(0, points).tolist()
        assert plain.wind_at(0, points).tolist() == faulty.wind_at(0, points).tolist()
        for uav in (0, 2):
            for name in ("reading", "wind", "detections"):
                assert (plain.senses[name][0, uav] == faulty.senses[name][0, uav]).all()
    assert plain.senses["detections"].any()


@pytest.mark.parametrize("mode", MODES)
def test_a_dead_sensor_reads_nothing_and_its_stream_goes_on(mode: str) -> None:
    plain, faulty = begun(MODES[mode], 2), begun(MODES[mode].override(**rule("dead_sensor", uav=1, time=8.0)), 2)
    rng, silent, detections = np.random.default_rng(4), 0, 0
    for _ in range(60):
        commands = random_commands(plain, rng)
        advance(plain, commands)
        advance(faulty, commands)
        for uav in range(5):
            dead = uav == 1 and bool(faulty.senses["dead"][0, 1])
            assert faulty.senses["reading"][0, uav] == (0.0 if dead else plain.senses["reading"][0, uav])
        assert (plain.senses["gas_stream"] == faulty.senses["gas_stream"]).all()
        if not faulty.senses["dead"][0, 1]:
            detections = int(faulty.senses["detections"][0, 1])
            assert faulty.episode["clock"][0] < 8.0 or not faulty.motion["ready"][0, 1]
        silent += int(plain.senses["reading"][0, 1] > 0.0 and bool(faulty.senses["dead"][0, 1]))
    assert silent  # it would have smelled something
    assert faulty.senses["detections"][0, 1] == detections
    assert faulty.senses["detections"][0, 0] == plain.senses["detections"][0, 0]


@pytest.mark.parametrize("latency", [0.0, 2.5])
def test_a_lost_radio_neither_sends_nor_hears(latency: float) -> None:
    world = begun(small(**FIVE, **rule("lost_radio", uav=1, time=5.0), **{"radio.latency": latency}))
    exchanged(world)
    for step in range(1, 12):
        world.step_hops(hover(world))  # 1 s each, after 1 s of hovering at the start
        clock, heard = world.episode["clock"][0], exchanged(world)
        assert clock == pytest.approx(step + 1.0)
        if 1.0 + latency < clock < 5.0:
            assert 0 in heard[1]
            assert 1 in heard[0]
        if clock >= 5.0:
            assert heard[1] == []
            assert (1 in heard[0]) == (clock - latency < 5.0)  # what was on its way arrives
            assert not world.links[0, 1].any()
            assert not world.links[0, :, 1].any()
    seen, own = world.observation(0, 0), world.observation(0, 1)
    others = dict(zip(seen.neighbour_id.tolist(), seen.neighbour_age.tolist(), strict=True))
    assert others[1] == pytest.approx(12.0 - 4.0)  # its last frame, sent at 4 s
    assert others[2] == pytest.approx(math.ceil(latency))
    assert own.neighbour_mask.sum() == 4  # known still, and ageing
    known = 4.0 - math.ceil(latency)  # s, when what it heard last was sent
    assert own.neighbour_age[:4] == pytest.approx([12.0 - known] * 4)


def test_a_lost_radio_costs_nothing() -> None:
    plain = begun(small(**FIVE))
    faulty = begun(small(**FIVE, **rule("lost_radio", uav=1, time=5.0)))
    for world in (plain, faulty):
        exchanged(world)
        for _ in range(9):
            world.step_hops(hover(world))
            exchanged(world)
    frames = np.array([10, 4, 10, 10, 10])  # at 1, 2, .. 10 s; UAV 1 up to 4 s
    assert (plain.ledger["messages"][0] == 10).all()
    assert faulty.ledger["messages"][0].tolist() == frames.tolist()
    assert faulty.ledger["bytes"][0].tolist() == (frames * (HEADER_BYTES + 5)).tolist()
    energy, spent = faulty.ledger["energy"][0], faulty.ledger["spent"][0]
    assert energy[:, COMMUNICATING] == pytest.approx(frames * (HEADER_BYTES + 5) * faulty.scenario.radio.joule_per_byte)
    assert spent == pytest.approx(energy.sum(axis=1))
    assert faulty.motion["active"].all()


def test_on_legs_a_fault_waits_for_the_end_of_the_leg() -> None:
    world = begun(small(**FIVE, clock="event", action="waypoint", **rule("lost_uav", uav=0, time=3.0)))
    targets = world.motion["position"].copy()
    targets[0, 0] += [12.0, 0.0, 0.0]  # a leg that ends long after 3 s
    samples = np.ones(world.motion.shape, np.int64)
    while world.motion["active"][0, 0]:
        world.step_waypoints(targets, samples)
    assert world.episode["clock"][0] == pytest.approx(world.motion["leg_end"][0, 0])
    assert world.episode["clock"][0] > 6.0
    assert world.motion["position"][0, 0].tolist() == targets[0, 0].tolist()
    assert world.ledger["decisions"][0, 0] == 1


@pytest.mark.parametrize("mode", MODES)
def test_a_lost_uav_ends_and_the_others_go_on(mode: str) -> None:
    world = begun(MODES[mode].override(**rule("lost_uav", number=2, time=4.0), **{"ending.time_limit": 15.0}), [1, 2])
    rng = np.random.default_rng(5)
    assert world.faults is not None
    due = np.isfinite(world.faults.times[:, :, FAULT_KINDS.index("lost_uav")])
    while world.running.any():
        lost, before = world.motion["fate"] == LOST, world.ledger.copy()
        advance(world, random_commands(world, rng))
        assert (world.ledger[lost] == before[lost]).all()  # its books are closed
        assert not world.rewards[lost].any()
    lost = world.motion["fate"] == LOST
    assert (lost == due).all()
    assert world.motion["terminated"][lost].all()
    assert not world.motion["truncated"][lost].any()
    assert world.motion["truncated"][~lost].all()
    assert EpisodeRecord.of(world, 0, "none").ended == "time"


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("time", [0.0, 7.0])
def test_when_all_are_lost_the_episode_is_over(mode: str, time: float) -> None:
    world = begun(MODES[mode].override(**rule("lost_uav", time=time)), [1, 2])
    assert world.motion["active"].all()  # nobody is lost before the first leg or period
    steps = fly(world, seed=1, steps=100)
    assert 0 < steps < 100
    assert (world.episode["outcome"] == ENDED).all()
    assert world.team["terminated"].all()
    assert np.isfinite(world.episode["clock"]).all()
    assert (world.episode["clock"] >= time).all()
    record = EpisodeRecord.of(world, 0, "none")
    assert (record.ended, record.success, record.search_time) == ("lost", False, record.time_limit)
    assert EpisodeRecord.from_dict(record.to_dict()).to_dict() == record.to_dict()


def test_a_lost_uav_reaches_nothing() -> None:
    place = {"sources.positions": [(4.0, 4.0, 4.0)], "ending.success": "reach"}  # where UAV 0 starts
    world = begun(small(**FIVE, **place, **rule("lost_uav", uav=0)))
    world.step_hops(hover(world))
    assert world.running.all()


@pytest.mark.parametrize("observation", ["flat", "physical"])
@pytest.mark.parametrize("mode", MODES)
def test_pettingzoo_agents_leave_as_they_are_lost(mode: str, observation: str) -> None:
    scenario = MODES[mode].override(**rule("lost_uav", number=2, time=6.0), **{"ending.time_limit": 20.0})
    env = osl_env.parallel_env(scenario, observation=observation)
    parallel_api_test(env, num_cycles=60)
    env.reset(seed=3)
    left: dict[str, tuple[bool, bool]] = {}
    while env.agents:
        _, _, terminations, truncations, _ = env.step({agent: env.action_space(agent).sample() for agent in env.agents})
        for agent in set(terminations) - set(env.agents):
            left[agent] = (terminations[agent], truncations[agent])
    ends = list(left.values())
    assert ends.count((True, False)) >= 2  # more if a sampled hop declared
    assert len(ends) == 5


def test_the_vector_view_begins_lost_teams_anew() -> None:
    worlds = make_vec(small(**FIVE, **rule("lost_uav", rate=0.1)), 4, autoreset_mode="SameStep")
    worlds.reset(seed=1)
    assert worlds.world.faults is not None
    first, ended = worlds.world.faults.times.copy(), np.zeros(4, bool)
    still = np.full((4, 5), 26 * 2)
    for _ in range(100):
        _, _, terminated, truncated, _ = worlds.step(still)
        ended |= terminated
        assert not truncated.any()
    assert ended.all()
    assert (worlds.world.faults.times[:, :, 2] != first[:, :, 2]).all()  # drawn anew


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (rule("lost_uav", uav=3), r"uav_faults\.lost_uav\.uav = 3: there are UAVs 0 to 2"),
        (rule("lost_radio", number=4), r"uav_faults\.lost_radio\.number = 4: there are 3 UAVs"),
        (rule("lost_uav", uav=1, number=1), r"uav_faults\.lost_uav\.number = 1: goes without uav = 1"),
        (rule("dead_sensor", time=1, rate=1), r"uav_faults\.dead_sensor\.rate = 1: goes without time = 1"),
        (rule("dead_sensor", time=-1), r"uav_faults\.dead_sensor\.time = -1.*greater than or equal to 0"),
        (rule("dead_sensor", rate="2 m"), r"uav_faults\.dead_sensor\.rate = '2 m': must be a number or a quantity"),
        (rule("dead_sensor", when=2), r"unknown key 'uav_faults\.dead_sensor\.when': .*uav, number, time, rate"),
        ({"uav_faults.lost_drone": {}}, r"unknown key 'uav_faults\.lost_drone': .*lost_uav"),
        ({"uav_faults.lost_uav": 3}, r"uav_faults\.lost_uav = 3: must be a mapping"),
        (rule("lost_uav", number=1.5), r"uav_faults\.lost_uav\.number = 1\.5: .*integer"),
    ],
)
def test_a_bad_rule_is_refused_in_one_line(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        small(**changes)
    assert "\n" not in str(raised.value)
