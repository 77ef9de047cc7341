"""Radio: who hears whom, when, in what order, and what it costs; the neighbour table and the inbox agree."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from worlds import advance, begun, hover, random_commands, small

from osl_env import World
from osl_env.radio import HEADER_BYTES, Message
from osl_env.state import COMMUNICATING

LINE = {"team.n_uavs": 3, "team.starts": [(2.0, 5.0, 5.0), (7.0, 5.0, 5.0), (17.0, 5.0, 5.0)]}  # 5 m and 10 m apart
LONG = {"ending.time_limit": 1000.0}


def exchange(world: World, payloads: list[bytes | None] | None = None) -> list[list[list[Message]]]:
    return world.exchange([payloads or [None] * world.n_uavs] * world.n_envs)


def senders(inboxes: list[list[list[Message]]]) -> list[list[int]]:
    return [[message.sender for message in inbox] for inbox in inboxes[0]]


@pytest.mark.parametrize(
    ("radius", "heard"),
    [
        (4.9, [[], [], []]),
        (5.0, [[1], [0], []]),
        (10.0, [[1], [0, 2], [1]]),
        (15.0, [[1, 2], [0, 2], [0, 1]]),
        (float("inf"), [[1, 2], [0, 2], [0, 1]]),
    ],
)
def test_frames_reach_those_within_the_radius(radius: float, heard: list[list[int]]) -> None:
    world = begun(small(**LINE, **{"radio.radius": radius}))
    for _ in range(3):
        assert senders(exchange(world)) == heard
        for uav in range(3):
            observation = world.observation(0, uav)
            assert sorted(observation.neighbour_id[observation.neighbour_mask].tolist()) == heard[uav]
        world.step_hops(hover(world))


def test_a_frame_tells_where_the_sender_was_and_what_it_read() -> None:
    world = begun(small(**LINE))
    for _ in range(4):
        inbox = exchange(world, [b"a", None, b"ccc"])[0][1]
        for message, sender in zip(inbox, (0, 2), strict=True):
            assert message.sender == sender
            assert message.time == world.episode["clock"][0]
            assert message.position.tolist() == world.motion["position"][0, sender].tolist()
            assert message.reading == world.senses["reading"][0, sender]
            assert message.sampling_time == world.senses["sampling_time"][0, sender]
            assert message.payload == {0: b"a", 2: b"ccc"}[sender]
        advance(world, random_commands(world, np.random.default_rng(0)))


def test_messages_do_not_change_when_the_world_moves_on() -> None:
    world = begun(small(**LINE))
    inbox = exchange(world)[0][0]
    before = [(message.position.tolist(), message.reading) for message in inbox]
    advance(world, random_commands(world, np.random.default_rng(0)))
    assert [(message.position.tolist(), message.reading) for message in inbox] == before


@pytest.mark.parametrize("latency", [0.5, 1.0, 2.5, 4.0])
def test_frames_arrive_when_they_are_due_and_in_the_order_sent(latency: float) -> None:
    world = begun(small(**LINE, **{"radio.latency": latency}))
    received: list[float] = []
    for _ in range(12):
        clock = float(world.episode["clock"][0])
        for message in exchange(world)[0][0]:
            assert message.time <= clock - latency + 1e-9
            assert message.time > clock - latency - 1.0 - 1e-9  # not a whole step late: steps take 1 s
            if message.sender == 1:
                received.append(message.time)
        observation = world.observation(0, 0)
        expected = bool(received)
        assert observation.neighbour_mask.all() == expected
        if expected:
            assert observation.time - observation.neighbour_age[0] == pytest.approx(received[-1])
        world.step_hops(hover(world))
    assert received == sorted(set(received))
    assert len(received) == 12 - int(np.ceil(latency))


RADIOS: list[dict[str, Any]] = [
    {},
    {"radio.radius": 9.0},
    {"radio.latency": 3.0},
    {"radio.latency": 2.0, "radio.radius": 9.0, "radio.loss": 0.4},
    {"radio.loss": 0.4},
]


@pytest.mark.parametrize("clock", ["barrier", "event"])
@pytest.mark.parametrize("radio", RADIOS)
def test_the_neighbour_table_is_the_newest_frame_of_each_in_the_inbox(radio: dict[str, Any], clock: str) -> None:
    world = begun(small(clock=clock, **LONG, **radio, **{"team.n_uavs": 5}), [1, 2])
    rng = np.random.default_rng(0)
    newest: dict[tuple[int, int], dict[int, Message]] = {}
    for _ in range(40):
        inboxes = exchange(world)
        for env in range(2):
            for uav in range(5):
                if not world.motion["ready"][env, uav]:
                    assert inboxes[env][uav] == []
                    continue
                table = newest.setdefault((env, uav), {})
                table.update({message.sender: message for message in inboxes[env][uav]})
                check_table(world, env, uav, table)
        advance(world, random_commands(world, rng))
    assert any(newest.values())


def check_table(world: World, env: int, uav: int, table: dict[int, Message]) -> None:
    observation = world.observation(env, uav)
    count = int(observation.neighbour_mask.sum())
    assert sorted(observation.neighbour_id[:count].tolist()) == sorted(table)
    assert observation.neighbour_id[count:].tolist() == [-1] * (4 - count)
    for k in range(count):
        message = table[int(observation.neighbour_id[k])]
        np.testing.assert_allclose(observation.neighbour_position[k], message.position, atol=1e-9)
        assert observation.neighbour_reading[k] == message.reading
        assert observation.neighbour_sampling_time[k] == message.sampling_time
        assert observation.neighbour_age[k] == pytest.approx(observation.time - message.time, abs=1e-9)


def test_every_frame_is_lost_with_the_stated_probability_on_its_own() -> None:
    loss, worlds, steps = 0.3, 200, 10
    world = begun(small(**{"radio.loss": loss, **LONG}), list(range(worlds)))
    links = [world.links.copy()]
    for _ in range(steps):
        world.step_hops(hover(world))
        links.append(world.links.copy())
    arrived = np.stack(links)[:, :, ~np.eye(3, dtype=bool)]  # (steps + 1, worlds, 6 pairs)
    assert abs(arrived.mean() - (1 - loss)) < 5 * np.sqrt(loss * (1 - loss) / arrived.size)  # 5 standard errors
    pairs = np.corrcoef(arrived.reshape(-1, 6).T)[np.triu_indices(6, 1)]
    assert np.abs(pairs).max() < 5 / np.sqrt(arrived.size / 6)


def test_lost_frames_of_others_do_not_depend_on_where_a_third_uav_is() -> None:
    links = []
    for start in ((4.0, 4.0, 4.0), (20.0, 20.0, 10.0)):  # UAV 0 in range, and out of it
        starts = [start, (6.0, 4.0, 4.0), (8.0, 4.0, 4.0)]
        world = begun(small(**{"radio.loss": 0.5, "radio.radius": 8.0, "team.starts": starts}), [4])
        seen = []
        for _ in range(20):
            seen.append((bool(world.links[0, 1, 2]), bool(world.links[0, 2, 1])))
            world.step_hops(hover(world))
        links.append(seen)
    assert links[0] == links[1]


def test_bytes_and_energy_are_charged_to_the_sender_also_if_nobody_hears() -> None:
    world = begun(small(**LINE, **{"radio.radius": 1.0, "radio.power": 2.0, "radio.bit_rate": 1000.0}))
    exchange(world, [b"", b"x" * 100, None])
    world.step_hops(hover(world))
    exchange(world, [b"x", None, None])
    ledger = world.ledger[0]
    assert ledger["messages"].tolist() == [2, 2, 2]
    assert ledger["bytes"].tolist() == [2 * HEADER_BYTES + 1, 2 * HEADER_BYTES + 100, 2 * HEADER_BYTES]
    np.testing.assert_allclose(ledger["energy"][:, COMMUNICATING], ledger["bytes"] * 8 * 2.0 / 1000.0)


@pytest.mark.parametrize("changes", [{"radio.radius": 0.0}, {"team.n_uavs": 1}])
def test_a_radio_that_is_off_is_silent_and_free(changes: dict[str, Any]) -> None:
    world = begun(small(**changes))
    for _ in range(5):
        inboxes = world.exchange([[b"hello"] * world.n_uavs])
        assert not any(inboxes[0])
        advance(world, random_commands(world, np.random.default_rng(0)))
        assert not any(world.observation(0, uav).neighbour_mask.any() for uav in range(world.n_uavs))
    assert not world.ledger["messages"].any()
    assert not world.ledger["bytes"].any()
    assert not world.ledger["energy"][..., COMMUNICATING].any()


def test_who_is_in_flight_neither_sends_nor_reads_but_misses_nothing() -> None:
    world = begun(
        small(clock="event", action="waypoint", **{"team.n_uavs": 2, "team.starts": [(2.0, 5, 5), (9.0, 5, 5)]})
    )
    exchange(world)
    targets = np.array([[[18.0, 5, 5], [9.0, 5, 5]]])
    received = []
    for step in range(17):
        world.step_waypoints(targets, np.ones((1, 2), np.int64))
        inboxes = exchange(world, [b"0", bytes([step])])
        received += [message.payload[0] for message in inboxes[0][0]]
        flying = not world.motion["ready"][0, 0]
        assert flying == (step < 16)
        if flying:
            assert inboxes[0][0] == []
            assert inboxes[0][1] == []
    assert received == list(range(17))
    assert world.ledger["messages"][0].tolist() == [1 + 1, 1 + 17]


def test_a_reset_forgets_frames_on_their_way() -> None:
    world = begun(small(**LINE, **{"radio.latency": 2.0}), [1, 2])
    exchange(world)
    world.step_hops(hover(world))
    exchange(world)
    world.reset(np.array([3, 4]), np.array([True, False]))
    assert exchange(world)[0] == [[], [], []]
    assert not world.observation(0, 0).neighbour_mask.any()
    world.step_hops(hover(world))
    inboxes = exchange(world)
    assert inboxes[0] == [[], [], []]
    assert all(inboxes[1])
