"""Large teams: who is in range, whom the table keeps, where teams start, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit
from worlds import begun, observed

from osl_env import InputError, Scenario, World, load_scenario
from osl_env.cells import MOST_RUNS, make_cells, runs_near, sort_into_cells
from osl_env.parameters import FloatArray
from osl_env.radio import Message

ARENA = "arena-30x40"
BLOB = [(20.0 + 0.25 * (i % 8), 15.0 + 0.25 * (i // 8), 0.1) for i in range(60)]


def arena(**changes: Any) -> Scenario:
    return load_scenario(ARENA, **{"plume.development": 0.0, "team.n_uavs": 60} | changes)


@njit(cache=True)
def found_near(points: FloatArray, radius: float, near: FloatArray) -> None:
    """`near` (n, n): 1 where the runs of cells offer a point to another."""
    n = len(points)
    cells, runs = make_cells(n), np.empty((MOST_RUNS, 2), np.int64)
    cells.points[:] = points
    for k in range(n):
        cells.names[k] = k
    sort_into_cells(cells, n, radius)
    for i in range(n):
        for r in range(runs_near(cells, points[i, 0], points[i, 1], points[i, 2], runs)):
            for k in range(runs[r, 0], runs[r, 1]):
                near[i, cells.sorted_names[k]] += 1.0


def layouts() -> dict[str, FloatArray]:
    rng = np.random.default_rng(0)
    lattice = np.stack(np.meshgrid(np.arange(12.0), np.arange(12.0), [0.0]), axis=-1).reshape(-1, 3)
    return {
        "spread": rng.uniform(0, (100, 60, 30), (300, 3)),
        "flat": rng.uniform(0, (40, 30, 0), (200, 3)),
        "a line": np.outer(np.arange(100) * 0.3, (0.0, 1.0, 0.0)),
        "a lattice of the radius": lattice,
        "a lattice of a radius that has no exact double": 0.1 * lattice + 0.7,
        "pairs at one place": np.repeat(rng.uniform(0, 20, (40, 3)), 2, axis=0),
        "all at one place": np.full((50, 3), 3.3),
        "few": rng.uniform(0, 20, (5, 3)),
        "one": np.array([[1.0, 2.0, 3.0]]),
        "far apart": rng.uniform(-1e6, 1e6, (64, 3)),
    }


@pytest.mark.parametrize("name", layouts())
@pytest.mark.parametrize("radius", [1e-12, 0.1, 1.0, 6.0, 200.0, float("inf")])
def test_cells_offer_every_point_within_the_radius_and_each_at_most_once(name: str, radius: float) -> None:
    points = layouts()[name]
    near = np.zeros((len(points), len(points)))
    found_near(points, radius, near)
    dx, dy, dz = np.moveaxis(points[:, None] - points[None], -1, 0)
    within = dx * dx + dy * dy + dz * dz <= radius * radius
    assert (near <= 1).all()
    assert (near[within] == 1).all()


@pytest.mark.parametrize("radius", [0.5, 2.8, 6.0, 100.0])
def test_links_are_those_of_all_pairs(radius: float) -> None:
    world = begun(arena(**{"radio.radius": radius}))
    rng = np.random.default_rng(1)
    for _ in range(5):
        x = world.motion["position"][0]
        dx, dy, dz = np.moveaxis(x[:, None] - x[None], -1, 0)
        pairs = (dx * dx + dy * dy + dz * dz <= radius * radius) & ~np.eye(60, dtype=bool)
        assert (world.links[0] == pairs).all()
        world.step_velocities(rng.uniform(-0.3, 0.3, (1, 60, 3)))


def test_neighbours_exactly_as_far_as_the_radio_reaches_are_heard() -> None:
    starts = [(2.0 + 0.5 * (i % 32), 5.0 + 0.5 * (i // 32), 0.1) for i in range(64)]
    world = begun(arena(**{"team.n_uavs": 64, "team.starts": starts, "radio.radius": 0.5}))
    x = np.array(starts)
    square = ((x[:, None] - x[None]) ** 2).sum(axis=-1)
    assert (world.links[0] == ((square <= 0.25) & ~np.eye(64, dtype=bool))).all()
    assert world.links[0].sum() == 2 * (2 * 31 + 32)


@pytest.mark.parametrize("radius", [2.0, 6.0])
def test_a_robot_loses_the_same_frames_whoever_else_is_there(radius: float) -> None:
    lossy = {"radio.loss": 0.5, "radio.radius": radius, "team.starts": BLOB}
    whole, part = begun(arena(**lossy), [4]), begun(arena(**lossy, **{"team.n_uavs": 20}), [4])
    lost = 0
    for _ in range(10):
        assert (whole.links[0, :20, :20] == part.links[0]).all()
        lost += int((~part.links[0]).sum()) - 20
        whole.step_velocities(np.zeros((1, 60, 3)))
        part.step_velocities(np.zeros((1, 20, 3)))
    assert lost > 0


def test_each_receiver_loses_frames_on_its_own() -> None:
    loss, steps = 0.3, 200
    world = begun(arena(**{"radio.loss": loss, "radio.radius": 50.0, "team.starts": BLOB, "team.n_uavs": 10}))
    got = []
    for _ in range(steps):
        got.append(world.links[0][~np.eye(10, dtype=bool)])
        world.step_velocities(np.zeros((1, 10, 3)))
    arrived = np.array(got, dtype=float)  # (steps, 90 pairs)
    assert abs(arrived.mean() - (1 - loss)) < 5 * np.sqrt(loss * (1 - loss) / arrived.size)  # 5 standard errors
    pairs = np.corrcoef(arrived.T)[np.triu_indices(90, 1)]
    assert np.abs(pairs).max() < 6 / np.sqrt(steps)  # 4005 pairs of series: 6 standard errors
    later = np.corrcoef(arrived[1:].T, arrived[:-1].T)[:90, 90:]  # nor does a loss tell of any at the next step
    assert np.abs(later).max() < 6 / np.sqrt(steps)


@pytest.mark.parametrize("changes", [{}, {"radio.radius": float("inf")}, {"radio.latency": 0.25}])
@pytest.mark.parametrize("most", [0, 7, 59])
def test_the_table_keeps_the_nearest_heard_of_sixty(changes: dict[str, Any], most: int) -> None:
    world = begun(arena(**{"max_neighbours": most, "radio.radius": 2.8} | changes))
    rng = np.random.default_rng(2)
    newest: list[dict[int, Message]] = [{} for _ in range(60)]
    for _ in range(8):
        for uav, inbox in enumerate(world.exchange([[None] * 60])[0]):
            newest[uav] |= {message.sender: message for message in inbox}
            observation = world.observation(0, uav)
            heard = newest[uav]
            count = min(len(heard), most)
            assert observation.neighbour_mask.tolist() == [True] * count + [False] * (most - count)
            offsets = {j: message.position - observation.position for j, message in heard.items()}
            square = {j: float((v.astype(np.float32) ** 2).sum(dtype=np.float32)) for j, v in offsets.items()}
            expected = sorted(heard, key=lambda j: (square[j], j))[:count]
            told = observation.neighbour_id[:count].tolist()
            assert [square[j] for j in told] == pytest.approx([square[j] for j in expected], rel=1e-5, abs=1e-12)
            for k, j in enumerate(told):
                np.testing.assert_array_equal(observation.neighbour_offset[k], offsets[j])
                assert observation.neighbour_age[k] == observation.time - heard[j].time
        world.step_velocities(rng.uniform(-0.3, 0.3, (1, 60, 3)))


def test_equally_near_neighbours_are_in_the_order_of_their_numbers() -> None:
    starts = [(20.0, 15.0, 0.1)] * 30 + [(21.0, 15.0, 0.1)] * 30
    world = begun(arena(**{"team.starts": starts, "max_neighbours": 40}))
    seen = world.observation(0, 40)
    assert np.isfinite(world.physical).all()
    assert seen.neighbour_id.tolist() == [j for j in range(30, 60) if j != 40] + list(range(11))


def test_an_observation_is_the_same_alone_and_among_all() -> None:
    world = begun(arena(**{"radio.radius": 3.0}))
    for uav in (0, 31, 59):
        alone = world.layout.observation(world.physical[0, uav])
        assert observed(alone) == observed(world.observation(0, uav))


def test_frames_are_made_once_and_come_in_the_order_sent() -> None:
    for n in (60, 80):  # few and many, for the mailbox
        starts = [(20.0 + 0.1 * i, 15.0, 0.1) for i in range(n)]
        world = begun(arena(**{"team.n_uavs": n, "team.starts": starts, "radio.radius": 1.0}), [1, 2])
        inboxes = world.exchange([[bytes([i]) for i in range(n)]] * 2)
        for env in range(2):
            frames = {id(message) for inbox in inboxes[env] for message in inbox}
            assert len(frames) == n
            for uav, inbox in enumerate(inboxes[env]):
                assert [message.sender for message in inbox] == np.flatnonzero(world.links[env, :, uav]).tolist()
                assert [message.payload for message in inbox] == [bytes([message.sender]) for message in inbox]


REGION = {"team.region": [(30.0, 2.0, 0.1), (38.0, 28.0, 0.1)], "team.spacing": 0.8, "team.n_uavs": 60}


def nearest(starts: FloatArray) -> float:
    distances = np.linalg.norm(starts[:, None] - starts[None], axis=-1)
    return float(distances[~np.eye(len(starts), dtype=bool)].min())


@pytest.mark.parametrize("n_uavs", [60, 181])  # 181: as many as the region holds
def test_teams_start_apart(n_uavs: int) -> None:
    world = begun(arena(**REGION | {"team.n_uavs": n_uavs}), list(range(10)))
    starts = world.motion["position"].copy()
    assert all(nearest(team) >= 0.8 for team in starts)
    assert (starts >= (30.0, 2.0, 0.1)).all()
    assert (starts <= (38.0, 28.0, 0.1)).all()
    again = begun(arena(**REGION | {"team.n_uavs": n_uavs}), [7])
    assert (again.motion["position"][0] == starts[7]).all()


def test_teams_start_apart_on_a_line_and_between_obstacles() -> None:
    line = load_scenario("arena-4x6-10", **{"team.region": [(5.8, 0, 0.1), (5.8, 4, 0.1)], "team.spacing": 0.25,
                                            "team.n_uavs": 8})  # fmt: skip
    assert all(nearest(team) >= 0.25 for team in begun(line, [1, 2, 3]).motion["position"])
    among = line.override(**{"team.region": [(1.0, 0, 0.1), (5.0, 4, 0.1)], "team.n_uavs": 30})
    starts = begun(among, [1, 2, 3]).motion["position"]
    assert all(nearest(team) >= 0.25 for team in starts)
    assert among.arena.free(starts.reshape(-1, 3)).all()


def test_no_spacing_draws_as_without_the_key() -> None:
    scenario = arena(**REGION | {"team.spacing": 0.0})
    assert scenario.hash == arena(**{k: v for k, v in REGION.items() if k != "team.spacing"}).hash
    assert scenario.hash != arena(**REGION).hash


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (REGION | {"team.spacing": 3.0}, ("team.n_uavs = 60: team.region [[30.0, 2.0, 0.1]", "holds about 13", "3 m")),
        (REGION | {"team.spacing": 1e3}, ("team.n_uavs = 60", "holds about 1 ")),
        ({"team.spacing": 2.0}, ("team.spacing = 2: team.starts", "1.4 m apart")),
        ({"team.spacing": -1.0}, ("team.spacing", "-1")),
        ({"team.n_uavs": 61}, ("team", "n_uavs = 61", "only 60 starts")),
        ({"arena.bounds": "end"}, ("range_sensors.count = 8", "arena.bounds = 'end'", "arena.obstacles")),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(changes: dict[str, Any], words: tuple[str, ...]) -> None:
    with pytest.raises(InputError) as error:
        arena(**changes)
    assert "\n" not in str(error.value)
    assert all(word in str(error.value) for word in words), str(error.value)


def test_bounds_that_are_no_walls_are_not_seen() -> None:
    box = {"kind": "box", "low": (20.0, 10.0, 0.0), "high": (21.0, 20.0, 5.0)}
    changes = {"arena.obstacles": [box], "team.n_uavs": 2, "team.starts": [(39.95, 15.0, 0.1), (19.9, 15.0, 0.1)],
               "range_sensors.range": 0.25, "wind": {"kind": "uniform"}}  # fmt: skip
    held, open_ = begun(arena(**changes)), begun(arena(**changes, **{"arena.bounds": "end"}))
    assert held.ranges[0, 0, 0] == pytest.approx(0.05)
    assert open_.ranges[0, 0].tolist() == [0.25] * 8
    assert open_.ranges[0, 1].tolist() == held.ranges[0, 1].tolist()
    assert open_.ranges[0, 1, 0] == pytest.approx(0.1)


def test_teams_whose_frames_do_not_fit_into_memory_are_refused_by_what_is_too_large() -> None:
    large = {"team.n_uavs": 1024, "team.region": [(1, 1, 0.1), (39, 29, 0.1)]}
    World(arena(**large))
    with pytest.raises(InputError, match=r"radio\.latency = 60: a world of 1024 UAVs"):
        World(arena(**large, **{"radio.latency": 60.0, "clock": "event"}))
    with pytest.raises(InputError, match=r"n_envs = 100000: this many worlds of 60 UAVs need over 16 GiB"):
        World(arena(), 100_000)
