"""The swarm rivals' laws: luciferin, lattice, flux, links, particles; what they do alone, crowded and in a calm."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from worlds import small

from baselines import Briefing, make_policy
from baselines.biasing_expansion import BiasingExpansion, allowed, gravity, linked
from baselines.fluxotaxis import Fluxotaxis, Tracer, divergence, lattice_force, slopes
from baselines.glowworm import Glow, Glowworm, decision_range, luciferin
from baselines.hearing import (
    DiagonalCast,
    Fence,
    HearingPilot,
    HearingPolicy,
    Senses,
    heard,
    pack,
    repulsion,
    unpack,
)
from baselines.particle_swarm import ParticleSwarm, wind_factor
from osl_env import Scenario, World
from osl_env.actions import Velocity
from osl_env.observation import Observation
from osl_env.parameters import FloatArray
from osl_env.radio import Message
from training.flight import fly

NAMES = ["biasing-expansion", "particle-swarm", "glowworm", "fluxotaxis"]
POLICIES: dict[str, type[HearingPolicy]] = {
    "biasing-expansion": BiasingExpansion,
    "particle-swarm": ParticleSwarm,
    "glowworm": Glowworm,
    "fluxotaxis": Fluxotaxis,
}
WIND = np.array([0.5, 0.0, 0.0])
PERIOD = 0.1  # s


def arena(n_uavs: int = 3, radius: float = 3.0, **changes: Any) -> Scenario:
    """12 x 8 m for planar robots at 0.1 m/s with a concentration sensor, as the small arenas; the source is far."""
    settings: dict[str, Any] = {
        "arena.size": (12.0, 8.0, 0.5),
        "sources.positions": [(1.0, 4.0, 0.1)],
        "team.n_uavs": n_uavs,
        "team.starts": [(11.0, 0.5 + 0.4 * k, 0.1) for k in range(n_uavs)],
        "plume": {"kind": "gaussian_puff", "release_rate": 1.0, "dispersion": {"kind": "briggs_open_country"}},
        "wind": {"velocity": (0.5, 0.0, 0.0)},
        "gas_sensor": {"kind": "ideal", "threshold": 0.01, "typical_reading": 1.0},
        "radio.radius": radius,
        "vehicle": {
            "kind": "point_mass",
            "speed": 0.1,
            "acceleration": 1,
            "decision_period": PERIOD,
            "physics_step": PERIOD,
            "planar": True,
        },
        "action": "velocity",
        "ending": {"success": "reach", "success_radius": 0.2, "time_limit": 600},
    }
    return small(**settings | changes)


def briefing(uav: int = 0, **changes: Any) -> Briefing:
    return Briefing.of(arena(**changes), uav, 7, np.array([6.0, 4.0, 0.1]))


@functools.cache
def template() -> Observation:
    """What a UAV knows that hears nobody."""
    world = World(arena(1), 1)
    world.reset(np.array([1]))
    return world.observation(0, 0)


def observation(
    position: Sequence[float] | FloatArray, reading: float = 0.0, time: float = 0.0, wind: FloatArray = WIND
) -> Observation:
    """What a UAV at `position` knows at `time`; the team is heard by the inbox alone."""
    place, air = np.array(position, dtype=np.float64), np.array(wind, dtype=np.float64)
    return replace(template(), position=place, wind=air, reading=reading, time=time, sampling_time=PERIOD)


def message(
    sender: int, position: Sequence[float], reading: float = 0.0, payload: bytes = b"", time: float = 0.0
) -> Message:
    return Message(sender, time, np.array(position, dtype=np.float64), reading, PERIOD, payload)


def begun(name: str, uav: int = 0, parameters: dict[str, Any] | None = None, **changes: Any) -> HearingPolicy:
    policy = POLICIES[name](**parameters or {})
    policy.reset(briefing(uav, **changes))
    return policy


def velocity(policy: HearingPolicy, seen: Observation, inbox: Sequence[Message] = ()) -> FloatArray:
    policy.broadcast(seen)
    action = policy.act(seen, inbox)
    assert isinstance(action, Velocity)
    assert np.all(np.isfinite(action.velocity))
    return np.asarray(action.velocity)


class Team:
    """Robots that move exactly as they wish over a field, every `period` s; the radio reaches `radius`."""

    def __init__(self, name: str, places: FloatArray, radius: float, period: float = PERIOD, **parameters: Any) -> None:
        self.places, self.radius, self.period, self.time = places.copy(), radius, period, 0.0
        scenario = arena(len(places), radius)
        self.pilots = []
        for uav, place in enumerate(places):
            policy = POLICIES[name](**parameters)
            policy.reset(Briefing.of(scenario, uav, 3, place))
            self.pilots.append(policy)

    def step(self, field: Callable[[FloatArray], float]) -> None:
        views = [observation(place, field(place), self.time) for place in self.places]
        frames = [
            message(uav, self.places[uav], views[uav].reading, pilot.broadcast(views[uav]) or b"", self.time)
            for uav, pilot in enumerate(self.pilots)
        ]
        apart = np.linalg.norm(self.places[:, None] - self.places[None], axis=2)
        moves = []
        for uav, pilot in enumerate(self.pilots):
            inbox = [frame for frame in frames if frame.sender != uav and apart[uav, frame.sender] <= self.radius]
            action = pilot.act(views[uav], inbox)
            assert isinstance(action, Velocity)
            moves.append(np.asarray(action.velocity) * self.period)
        self.places += np.array(moves)
        self.time += self.period


def hexagon(spacing: float, centre: Sequence[float] = (6.0, 4.0, 0.1)) -> FloatArray:
    """(7, 3): a robot and its six neighbours."""
    angles = np.arange(6) * math.pi / 3
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(6)], axis=1) * spacing
    return np.array(centre) + np.vstack([np.zeros(3), ring])


# ----- what is shared


def test_payloads_come_back_and_foreign_ones_are_none() -> None:
    assert unpack(pack(1.5, -2.0, 0.25), 3) == (1.5, -2.0, 0.25)
    assert unpack(b"", 3) is None
    assert unpack(b"12345", 1) is None
    assert unpack(np.array([np.nan], dtype="<f4").tobytes(), 1) is None
    assert unpack(pack(1e300), 1) is not None


def test_the_newest_frame_of_each_sender_counts() -> None:
    position = np.array([1.0, 1.0, 0.1])
    inbox = [message(2, (1, 2, 0.1), time=1.0), message(2, (1, 3, 0.1), time=2.0), message(1, (2, 1, 0.4))]
    found = heard(inbox, position, 0, False, True)
    assert [other.sender for other in found] == [1, 2]
    assert [other.distance for other in found] == pytest.approx([1.0, 2.0])
    assert found[0].direction == pytest.approx([1.0, 0.0, 0.0])  # planar: heights do not count


def test_two_robots_at_one_place_push_each_other_apart() -> None:
    place = np.array([1.0, 1.0, 0.1])
    pushes = [
        repulsion(heard([message(other, place)], place, uav, False, True), 0.5) for uav, other in ((3, 8), (8, 3))
    ]
    assert pushes[0] == pytest.approx(-pushes[1])
    assert np.linalg.norm(pushes[0]) == pytest.approx(1.0)


def test_the_filter_has_its_time_constant_and_is_taken_once_a_decision() -> None:
    senses = Senses(briefing(), 5.0)
    senses.take(observation((6, 4, 0.1), 1.0, 0.0))
    seen = observation((6, 4, 0.1))
    for k in range(1, 51):  # 5 s of clean air
        seen.time = k * PERIOD
        senses.take(seen)
        senses.take(seen)
    assert senses.concentration == pytest.approx(math.exp(-1.0), rel=1e-9)
    assert senses.smelt(5.0, 5.0)
    assert not senses.smelt(5.1, 5.0)


def test_nothing_is_upwind_in_a_calm() -> None:
    senses = Senses(briefing(), 5.0)
    senses.take(observation((6, 4, 0.1), wind=np.zeros(3)))
    assert senses.upwind is None


def test_the_cast_crosses_the_area_and_stays_inside() -> None:
    told = briefing()
    fence = Fence(told)
    cast = DiagonalCast(told, fence, math.radians(20), 0.3)
    place, period, track = np.array([11.0, 4.0, 0.1]), 0.2, []
    for _ in range(6000):
        place = place + period * fence.keep(place, told.speed * cast.direction(place, np.array([-1.0, 0.0, 0.0])))
        track.append(place.copy())
    seen = np.array(track)
    assert seen[:, :2].min() > 0.0
    assert (seen[:, :2].max(axis=0) < [12.0, 8.0]).all()
    assert np.ptp(seen[:, 1]) > 7.0  # wall to wall
    assert np.ptp(seen[:, 0]) > 10.0  # and up to the inlet


# ----- glowworm


def test_luciferin_settles_at_gain_over_decay() -> None:
    level = 5.0
    for _ in range(60):
        level = luciferin(level, 2.0, 0.4, 0.6)
    assert level == pytest.approx(3.0, rel=1e-9)  # gamma J / rho; 0.6^60 = 5e-14 is left of the start
    assert luciferin(level, 0.0, 0.4, 0.6) == pytest.approx(0.6 * level)


def test_the_decision_range_keeps_within_its_bounds_and_wants_its_neighbours() -> None:
    assert decision_range(0.5, 1.0, 0.08, 5, 5) == 0.5
    assert decision_range(0.5, 1.0, 0.08, 5, 0) == pytest.approx(0.9)
    assert decision_range(0.9, 1.0, 0.08, 5, 0) == 1.0
    assert decision_range(0.1, 1.0, 0.08, 5, 50) == 0.0


def test_a_glowworm_goes_to_brighter_ones_in_proportion_to_their_excess() -> None:
    """Of 400 choices between an excess of 1 and one of 3 a quarter, within 4 standard errors of 0.022, is the first."""
    inbox = [message(1, (7, 4, 0.1), payload=pack(1.0)), message(2, (5, 4, 0.1), payload=pack(3.0))]
    seen, chosen = observation((6, 4, 0.1)), 0
    scenario = arena()
    for seed in range(400):
        pilot = Glow(Glowworm(), Briefing.of(scenario, 0, seed, seen.position))
        pilot.senses.take(seen)
        chosen += pilot.wish(seen, heard(inbox, seen.position, 0, False, True))[0] > 0.0
    assert chosen / 400 == pytest.approx(0.25, abs=4 * 0.022)


@pytest.mark.parametrize(("leader", "way"), [("upwind", [-0.1, 0.0, 0.0]), ("stay", [0.0, 0.0, 0.0])])
def test_the_brightest_glowworm_leads(leader: str, way: list[float]) -> None:
    policy = begun("glowworm", parameters={"leader": leader})
    inbox = [message(1, (7, 4, 0.1), payload=pack(0.1)), message(2, (6, 5, 0.1))]
    assert velocity(policy, observation((6, 4, 0.1), 2.0), inbox) == pytest.approx(way)
    assert velocity(begun("glowworm"), observation((6, 4, 0.1), 2.0, wind=np.zeros(3))) == pytest.approx([0, 0, 0])


# ----- particle swarm


def test_particles_converge_in_a_static_field() -> None:
    """A quadratic hill, all-to-all radio: after 300 s the swarm's middle is within a step (1 m) of the top.

    Without wind terms, chance and forgetting; at 0.1 m/s a particle could cross the arena three times.
    """
    top = np.array([4.0, 5.0, 0.1])
    places = np.array([[1.0 + 1.2 * k, 1.0 + 2.0 * (k % 3), 0.1] for k in range(8)])
    quiet = {"wind_weight": 0.0, "wind_use": 0.0, "randomness": 0.0, "forgetting": math.inf, "separation": 0.1}
    team = Team("particle-swarm", places, math.inf, 0.5, **quiet)
    for _ in range(600):
        team.step(lambda place: 200.0 - float((place - top) @ (place - top)))
    apart = np.linalg.norm(team.places - top, axis=1)
    assert np.linalg.norm(team.places.mean(axis=0) - top) < 1.0
    assert np.median(apart) < 1.0


def test_the_best_is_passed_on_and_forgotten() -> None:
    first = begun("particle-swarm")
    told = first.broadcast(observation((6, 4, 0.1), 2.0, 1.0))
    assert told is not None
    assert len(told) == 20
    second = begun("particle-swarm", 1)
    assert second.broadcast(observation((9, 4, 0.1), 0.0, 1.0)) is None
    velocity(second, observation((9, 4, 0.1), 0.0, 1.1), [message(0, (6, 4, 0.1), 2.0, told, 1.0)])
    passed = second.broadcast(observation((9, 4, 0.1), 0.0, 1.2))
    assert passed is not None
    assert unpack(passed, 5) == pytest.approx((6.0, 4.0, 0.1, 2.0, 1.0), rel=1e-6)
    assert second.broadcast(observation((9, 4, 0.1), 0.0, 1.0 + 5.1 * 60.0)) is None


def test_the_wind_factor_is_jatmikos() -> None:
    assert wind_factor(-WIND, WIND, 1.0) == pytest.approx(1.0)
    assert wind_factor(WIND, WIND, 1.0) == pytest.approx(0.0)
    assert wind_factor(np.array([0.0, 2.0, 0.0]), WIND, 1.0) == pytest.approx(0.5)
    assert wind_factor(WIND, WIND, 0.0) == 1.0
    assert wind_factor(np.zeros(3), WIND, 1.0) == 1.0
    assert wind_factor(WIND, np.zeros(3), 1.0) == 1.0


# ----- biasing expansion


def test_gravity_goes_with_the_excess_and_the_inverse_of_the_distance() -> None:
    east, north = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    pull = gravity(1.0, np.array([2.0, 3.0]), np.array([0.5, 2.0]), np.array([east, north]), 1.0)
    assert pull == pytest.approx([1 / 3 / 0.5, 2 / 3 / 2.0, 0.0])
    for own, others in ((2.0, [1.0, 2.0]), (0.0, [0.0, 0.0])):
        assert not gravity(own, np.array(others), np.ones(2), np.array([east, north]), 1.0).any()
    assert not gravity(1.0, np.empty(0), np.empty(0), np.empty((0, 3)), 1.0).any()
    assert np.isfinite(gravity(0.0, np.ones(1), np.zeros(1), east[None], 1.0)).all()


def test_links_are_those_of_the_relative_neighbourhood_graph() -> None:
    line = np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    assert linked(line).tolist() == [True, False, True]
    assert linked(np.empty((0, 3))).shape == (0,)
    triangle = np.array([[1.0, 0.0, 0.0], [0.5, math.sqrt(0.75), 0.0]])
    assert linked(triangle).all()  # a tie breaks no link


def test_moves_neither_crowd_nor_lose_the_others() -> None:
    moves = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [-0.2, 0.0, 0.0]])
    assert allowed(moves, np.array([[0.95, 0.0, 0.0]]), 1.0, 0.3).tolist() == [True, True, False]
    assert allowed(moves, np.array([[0.4, 0.0, 0.0]]), 1.0, 0.3).tolist() == [True, False, True]
    assert allowed(moves, np.array([[0.1, 0.0, 0.0]]), 1.0, 0.3).tolist() == [True, False, True]  # too near: only away
    assert allowed(moves, np.array([[1.5, 0.0, 0.0]]), 1.0, 0.3).tolist() == [True, True, False]  # never farther


def connected(places: FloatArray, radius: float) -> bool:
    near = np.linalg.norm(places[:, None] - places[None], axis=2) <= radius
    reached = {0}
    while grown := {int(j) for i in reached for j in np.flatnonzero(near[i])} - reached:
        reached |= grown
    return len(reached) == len(places)


@pytest.mark.parametrize("smell", [False, True])
def test_the_expanding_swarm_expands_and_keeps_radio_contact(smell: bool) -> None:
    """Without obstacles and losses the network is whole at every moment; while nobody smells, it widens."""
    rng = np.random.default_rng(1)
    places = np.array([6.0, 4.0, 0.1]) + np.append(rng.uniform(-0.5, 0.5, (8, 2)), np.zeros((8, 1)), axis=1)
    team = Team("biasing-expansion", places, 1.0)
    for _ in range(500):
        team.step(lambda place: math.exp(-place[0] / 2.0) if smell else 0.0)
        assert connected(team.places, 1.0)
    width = [np.linalg.norm(x - x.mean(axis=0), axis=1).mean() for x in (places, team.places)]
    if smell:
        assert team.places[:, 0].mean() < places[:, 0].mean() - 0.5  # it went where it smells more
    else:
        assert width[1] > 1.5 * width[0]


# ----- fluxotaxis


@pytest.mark.parametrize("law", ["lennard-jones", "split-newton"])
def test_the_lattice_pushes_below_its_spacing_and_pulls_above(law: str) -> None:
    assert lattice_force(0.5, 0.5, law) == 0.0
    assert lattice_force(0.4, 0.5, law) < 0.0 < lattice_force(0.6, 0.5, law)
    assert np.isfinite(lattice_force(0.0, 0.5, law))


def test_a_lattice_at_rest_has_its_spacing() -> None:
    """Three robots settle in an equilateral triangle: there every force is zero. The way takes a few of the 60 s."""
    places = np.array([[6.0, 4.0, 0.1], [6.35, 4.05, 0.1], [6.1, 4.6, 0.1]])
    team = Team("fluxotaxis", places, 1.0, goal_gain=0.0)
    for _ in range(600):
        team.step(lambda place: 0.0)
    apart = np.linalg.norm(team.places[:, None] - team.places[None], axis=2)
    assert apart[np.triu_indices(3, 1)] == pytest.approx(0.5, abs=0.005)


def test_divergence_is_exact_for_linear_flux_and_tells_a_source_from_a_sink() -> None:
    places = hexagon(0.5)
    matrix = np.array([[2.0, 0.3, 0.0], [-1.0, 0.5, 0.0], [0.0, 0.0, 0.0]])
    flux = places @ matrix.T + np.array([1.0, -2.0, 0.0])
    assert divergence(places[1:] - places[0], flux[1:], flux[0]) == pytest.approx(2.5)
    from_source = places - places[0]  # rho V from a source in the middle
    assert divergence(places[1:] - places[0], from_source[1:], from_source[0]) > 0.0
    assert divergence(places[1:] - places[0], -from_source[1:], from_source[0]) < 0.0
    uniform = np.tile(WIND, (7, 1))
    assert divergence(places[1:] - places[0], uniform[1:], uniform[0]) == pytest.approx(0.0, abs=1e-12)


def test_divergence_without_enough_neighbours_is_that_along_them() -> None:
    assert divergence(np.empty((0, 3)), np.empty((0, 3)), WIND) == 0.0
    assert divergence(np.zeros((1, 3)), WIND[None], np.zeros(3)) == 0.0
    line = np.array([[0.5, 0.0, 0.0]])
    assert divergence(line, np.array([[1.0, 7.0, 0.0]]), np.zeros(3)) == pytest.approx(2.0)
    assert slopes(line, np.array([[3.0]]))[:, 0] == pytest.approx([6.0, 0.0, 0.0])


def tell(
    places: FloatArray, rho: Sequence[float], winds: Sequence[FloatArray], hears: Sequence[int] = range(1, 7)
) -> tuple[FloatArray, str]:
    """The goal of the first of 7 robots, whose neighbours `hears` tell `rho` and `winds`, and its mode."""
    tracer = Tracer(Fluxotaxis(lattice_gain=0.0), briefing(radius=1.0))
    seen = observation(places[0], rho[0], wind=winds[0])
    tracer.senses.take(seen)
    inbox = [message(k, places[k], payload=pack(rho[k], *winds[k], 0.0)) for k in hears]
    return tracer.wish(seen, heard(inbox, places[0], 0, False, True)) / tracer.speed, tracer.mode


def test_fluxotaxis_goes_to_the_inflow_and_back_to_what_flows_out() -> None:
    places = hexagon(0.5)
    way, mode = tell(places, [1.0] * 7, [WIND] * 7)  # in a plume: neighbour 4 is straight upwind
    assert mode == "inflow"
    assert way == pytest.approx([-1.0, 0.0, 0.0], abs=1e-12)
    outward = [0.5 * (place - places[0]) + 1e-3 * WIND for place in places]  # a source in the middle
    way, mode = tell(places, [1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0], outward)
    assert mode == "emitter"
    assert way[0] > 0.49  # to one of those whose flux is out
    thinning = [1.0, 0.8, 0.9, 0.0, 0.0, 0.0, 0.9]  # the foremost in a plume hears those downwind alone
    way, mode = tell(places, thinning, [WIND] * 7, hears=(1, 2, 6))
    assert mode == "front"
    assert way == pytest.approx([-1.0, 0.0, 0.0], abs=1e-12)
    way, mode = tell(places, [0.0, *thinning[1:]], [WIND] * 7)  # past the source: it smells nothing
    assert mode == "emitter"
    assert way == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)


def test_fluxotaxis_in_still_air_climbs_or_casts() -> None:
    places = hexagon(0.5)
    calm = [np.zeros(3)] * 7
    way, mode = tell(places, [0.1, 0.2, 0.9, 0.3, 0.0, 0.0, 0.0], calm)
    assert mode == "chemotaxis"
    assert way == pytest.approx((places[2] - places[0]) / 0.5)
    assert tell(places, [0.0] * 7, calm)[1] == "cast"
    assert tell(places, [0.5] * 7, calm)[1] == "upwind"  # all equal, and no wind: it stays
    assert not tell(places, [0.5] * 7, calm)[0].any()


# ----- all of them


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("wind", [WIND, np.zeros(3)])
@pytest.mark.parametrize("reading", [0.0, 1.0])
def test_alone_crowded_and_all_equal_are_defined(name: str, wind: FloatArray, reading: float) -> None:
    """Nobody heard; all at one place; all equal; payloads of others, nonsense: a velocity within the limit."""
    place = (6.0, 4.0, 0.1)
    crowds: list[list[Message]] = [
        [],
        [message(k, place, reading) for k in range(1, 4)],
        [
            message(k, (6.0 + 0.2 * k, 4.0, 0.1), reading, payload)
            for k, payload in ((1, b""), (2, b"x"), (3, b"y" * 20))
        ],
    ]
    for inbox in crowds:
        policy = begun(name)
        for k in range(30):
            seen = observation(place, reading, k * PERIOD, wind)
            assert np.linalg.norm(velocity(policy, seen, inbox)) <= 0.1 + 1e-9


@pytest.mark.parametrize("name", NAMES)
def test_only_who_is_heard_counts(name: str) -> None:
    """Locality: a team out of the radio's reach changes nothing; the inbox is all that tells of it."""
    tracks = []
    for far in (8.0, 9.0):
        scenario = arena(2, 1.0, **{"team.starts": [(11.0, 1.0, 0.1), (far, 7.0, 0.1)]})
        track: list[FloatArray] = []
        fly(
            make_policy(name),
            scenario,
            [3],
            max_decisions=60,
            watch=lambda world, track=track: track.append(world.motion["position"][0, 0].copy()),
        )
        tracks.append(np.array(track))
    np.testing.assert_array_equal(tracks[0], tracks[1])
    assert np.ptp(tracks[0], axis=0).max() > 0.1  # it moved


def test_a_pilot_says_what_it_does() -> None:
    for name in NAMES:
        policy = POLICIES[name]()
        assert policy.mode == ""
        with pytest.raises(RuntimeError, match=r"reset\(briefing\)"):
            policy.act(observation((6, 4, 0.1)), ())
        policy.reset(briefing())
        velocity(policy, observation((6, 4, 0.1)))
        assert policy.mode
        assert isinstance(policy._pilot, HearingPilot)
        assert policy.declaration() is None


def test_an_old_smell_leads_nobody() -> None:
    policy = begun("glowworm", parameters={"iteration": PERIOD, "memory": 3})
    levels = []
    for k in range(8):
        velocity(policy, observation((6, 4, 0.1), 1.0 if k == 0 else 0.0, k * PERIOD))
        numbers = unpack(policy.broadcast(observation((6, 4, 0.1), 0.0, k * PERIOD)) or b"", 1)
        assert numbers is not None
        levels.append(numbers[0])
    assert levels[:3] == pytest.approx([0.6, 0.36, 0.216])  # gamma J, then 1 - rho of it each iteration
    assert not any(levels[3:])
