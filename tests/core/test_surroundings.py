"""Wind, plume and sensors go on by the clock alone, and sensors give what is where the UAVs are."""

from __future__ import annotations

import itertools
import math
from collections.abc import Set
from typing import Any

import numpy as np
import pytest
from worlds import advance, begun, differences, fly, random_commands

from osl_env import Scenario, World, load_scenario
from osl_env.parameters import FloatArray
from osl_env.plumes.filament import FilamentPlume

FAST = {"kind": "filament", "development": 6.0, "filament_rate": 10.0, "max_age": 30.0}
MEANDER = {"kind": "meander", "velocity": [1.0, 0.3, 0.0]}
IDEAL = {"kind": "ideal", "period": 0.1, "threshold": 0.01}
FLYER = {"kind": "point_mass", "speed": 3.0, "acceleration": 3.0}
MODES: dict[str, dict[str, Any]] = {
    "hop": {"action": "hop"},
    "hop event": {"action": "hop", "clock": "event"},
    "waypoint": {"action": "waypoint"},
    "waypoint event": {"action": "waypoint", "clock": "event"},
    "velocity": {"action": "velocity"},
}
PRESETS = ("gaden-60x60x30", "puff-source1", "tunnel-a", "arena-4x6-5", "arena-30x40")
EPISODE_SEEDS = [3, 2**61, 11]


def gassy(mode: str = "hop", **changes: Any) -> Scenario:
    """Three UAVs in 20 x 20 x 10 m, in the filaments that a meandering wind brings them."""
    settings: dict[str, Any] = {
        "name": "gassy",
        "arena": {"size": [20.0, 20.0, 10.0]},
        "sources.positions": [[5.0, 9.0, 5.0]],
        "team": {"n_uavs": 3, "starts": [[8.0, 9.0, 5.0], [10.0, 11.0, 5.0], [12.0, 8.0, 6.0]]},
        "plume": FAST,
        "wind": MEANDER,
        "gas_sensor": IDEAL,
        "vehicle": FLYER | {"step_length": 1.5, "hop_lengths": 2, "hover_time": 2.0},
        "ending.time_limit": 60.0,
    }
    return load_scenario("rate-60x60x30", **(settings | MODES[mode] | changes))


def around(world: World, env: int) -> list[bytes]:
    """Air and plume of world `env`, bit for bit: the filaments, or else readings at many places, and the wind there."""
    points = np.random.default_rng(9).uniform(0.0, world.scenario.arena.size, (60, 3))
    seen = [world.concentration(env, points), world.wind_at(env, points)]
    if isinstance(world.scenario.plume, FilamentPlume):
        seen += world.scenario.plume.filaments(world.surroundings.plume_state, env)
    return [np.ascontiguousarray(array).tobytes() for array in seen]


def undisturbed(scenario: Scenario, seed: int, clock: float) -> World:
    """A world in which nobody flies, with its air at `clock`, s."""
    world = begun(scenario, seed)
    world.run_air(clock - float(world.episode["clock"][0]))
    return world


def clock_of(world: World, env: int = 0) -> float:
    return float(world.episode["clock"][env])


# --- what air and plume depend on -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mode", "changes"),
    [
        *((mode, {}) for mode in MODES),
        ("velocity", {"plume": {"kind": "gaussian_puff", "step": 0.1, "max_age": 12.0}}),
        ("hop event", {"plume": {"kind": "gaussian_puff", "step": 0.1, "max_age": 12.0, "development": 4.0}}),
        ("waypoint", {"wind": {"kind": "turbulent", "velocity": [1.0, 0.0, 0.0], "nodes": 8}}),
        ("velocity", {"plume.when_full": "oldest", "plume.capacity": 100}),
        ("velocity", {"plume.when_full": "merge", "plume.capacity": 100}),
    ],
)
@pytest.mark.filterwarnings("ignore:plume.capacity:RuntimeWarning")
def test_air_and_plume_do_not_depend_on_what_uavs_do(mode: str, changes: dict[str, Any]) -> None:
    scenario = gassy(mode, **changes)
    world = begun(scenario, EPISODE_SEEDS)  # clocks differ between worlds, where legs do
    fly(world, seed=1, steps=6)
    for env, seed in enumerate(EPISODE_SEEDS):
        assert around(world, env) == around(undisturbed(scenario, seed, clock_of(world, env)), 0)


def test_air_and_plume_are_the_same_in_every_mode() -> None:
    """Hops, way points and velocities, on both clocks: at the same time, the same air."""
    expected = around(undisturbed(gassy("velocity"), 5, 20.0), 0)
    for mode in MODES:
        world = begun(gassy(mode), 5)
        fly(world, seed=2, steps=2)
        assert clock_of(world) < 20.0
        world.run_air(20.0 - math.floor(clock_of(world) / 0.5) * 0.5)
        assert around(world, 0) == expected


def test_a_downwash_stirs_the_plume_and_only_that_of_its_own_world() -> None:
    scenario = gassy("velocity", **{"plume.downwash": {}})
    world = begun(scenario, [5, 5, 5])
    still, moving = np.zeros((3, 3)), np.full((3, 3), 1.0)
    for _ in range(8):
        world.step_velocities(np.stack([still, still, moving]))
    assert around(world, 0) == around(world, 1)
    assert around(world, 0) != around(world, 2)
    assert around(world, 0) != around(undisturbed(scenario, 5, clock_of(world)), 0)
    alone = begun(scenario, 5)
    for _ in range(8):
        alone.step_velocities(moving[None])
    assert around(alone, 0) == around(world, 2)


def ended_first(scenario: Scenario) -> World:
    """A world in which UAV 0 has flown until its battery was empty, while the others still hover."""
    world = begun(scenario, 4)
    velocities = np.zeros((1, 3, 3))
    while world.motion["active"][0, 0]:
        velocities[0, 0, 0] = 2.0 * (-1.0) ** world.ledger["decisions"][0, 0]
        world.step_velocities(velocities)
    assert world.motion["active"][0].tolist() == [False, True, True]
    return world


def test_who_has_ended_neither_stirs_nor_smells() -> None:
    energy = {"flying_power": 500.0, "hovering_power": 10.0, "capacity": 2000.0}
    scenario = gassy("velocity", **{"plume.downwash": {}, "energy": energy})
    first, second = ended_first(scenario), ended_first(scenario)
    assert differences(first, 0, second, 0) == []
    for name in ("position", "origin", "target"):  # wherever what is left of it may lie
        second.motion[name][0, 0] = scenario.sources.positions[0]
    reading = first.senses["reading"][0, 0]
    for world in (first, second):
        for _ in range(5):
            world.step_velocities(np.zeros((1, 3, 3)))
    assert around(first, 0) == around(second, 0)
    for world in (first, second):
        assert world.surroundings.sniffers is not None
        assert world.surroundings.sniffers["level"][0, 0] == 0.0
    assert first.senses["reading"][0, 0] == second.senses["reading"][0, 0] == reading


# --- episodes -------------------------------------------------------------------------------------------------------


LAST_STEP = {"rewards", "team.reward", "team.terminated", "team.truncated"}  # a reset leaves what the last step gave


def same(world: World, env: int, other: World, row: int = 0, *, but: Set[str] = frozenset()) -> None:
    assert set(differences(world, env, other, row)) <= but
    assert around(world, env) == around(other, row)
    assert world.ranges[env].tobytes() == other.ranges[row].tobytes()
    sniffers = world.surroundings.sniffers, other.surroundings.sniffers
    if sniffers[0] is not None and sniffers[1] is not None:
        assert sniffers[0][env].tobytes() == sniffers[1][row].tobytes()


def row_of(commands: tuple[Any, ...], env: int) -> tuple[Any, ...]:
    return tuple(np.ascontiguousarray(array[env : env + 1]) for array in commands)


NOISY_SENSOR = {"kind": "mox", "noise": 0.5, "relative_noise": 0.1, "drift": 0.1, "rise_time": 0.3, "recovery_time": 1}
NOISY = {
    "gas_sensor": NOISY_SENSOR,
    "anemometer.noise": 0.2,
    "range_sensors": {"count": 5, "noise": 0.1},
    "sensor_faults": [{"uav": 1, "kind": "noise", "start": 6, "end": 12, "magnitude": 1.0}],
}


@pytest.mark.parametrize("mode", MODES)
def test_a_world_does_not_depend_on_its_batch_its_row_or_resets_of_the_others(mode: str) -> None:
    scenario = gassy(mode, **NOISY)
    batch = begun(scenario, [8, 3, 8, 1])
    alone = begun(scenario, 3)
    rng = np.random.default_rng(6)
    for step in range(9):
        commands = random_commands(batch, rng)
        for array in commands:
            array[2] = array[0]
        advance(batch, commands)
        advance(alone, row_of(commands, 1))
        same(batch, 1, alone)
        if step == 3:
            same(batch, 0, batch, 2)  # the same episode in another row
            batch.reset(np.array([5, 0, 6, 9]), np.array([True, False, False, True]))
            same(batch, 1, alone)
            for env, seed in ((0, 5), (3, 9)):
                same(batch, env, begun(scenario, seed), but=LAST_STEP)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", PRESETS)
def test_a_reset_after_flights_is_a_fresh_world(name: str, mode: str) -> None:
    changes: dict[str, Any] = {"plume.development": 3.0} if name.startswith(("gaden", "tunnel", "arena")) else {}
    if name.startswith("gaden"):
        changes["vehicle"] = {"kind": "point_mass" if mode == "velocity" else "grid_hop"}
    elif name.startswith("puff") and mode.startswith("hop"):  # its quadrotor does not hop
        changes |= {"vehicle": {"kind": "point_mass", "hover_time": 0.5}, "energy": {"kind": "measured"}}
    elif mode != "velocity":
        changes |= {"vehicle.step_length": 0.1, "vehicle.hover_time": 0.5, "vehicle.speed": 1.0}
    scenario = load_scenario(name, **(changes | MODES[mode] | {"team.n_uavs": min(3, load_scenario(name).team.n_uavs)}))
    world, fresh = begun(scenario, [1, 2]), begun(scenario, [7])
    fly(world, seed=1, steps=4)
    world.reset(np.array([7, 7]), np.array([True, False]))
    same(world, 0, fresh, but=LAST_STEP)
    rng = np.random.default_rng(2)
    for _ in range(3):
        commands = random_commands(world, rng)
        advance(world, commands)
        advance(fresh, row_of(commands, 0))
    same(world, 0, fresh)


# --- before an episode ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("wind", [{"kind": "uniform", "velocity": [1.0, 0.3, 0.0]}, MEANDER])
@pytest.mark.parametrize("development", [0.5, 6.0, 7.3])
def test_a_plume_that_develops_is_one_that_has_gone_on(wind: dict[str, Any], development: float) -> None:
    """A stationary wind draws the same numbers whenever it begins; 7.3 s are begun ticks of 0.5 s."""
    ahead = begun(gassy("velocity", wind=wind, **{"plume.development": development}), 5)
    late = begun(gassy("velocity", wind=wind, **{"plume.development": 0.0}), 5)
    assert clock_of(ahead) == clock_of(late) == 0.0
    assert around(ahead, 0) != around(late, 0)
    late.run_air(math.ceil(development / 0.5) * 0.5)
    assert around(ahead, 0) == around(late, 0)


def test_a_given_wind_has_blown_before_the_episode_as_its_times_say() -> None:
    turn = {"times": [-3.0, 0.0, 4.0], "velocities": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]}
    late = {"times": [0.0, 3.0, 7.0], "velocities": turn["velocities"]}
    ahead = begun(gassy("velocity", wind={"kind": "series"} | turn, **{"plume.development": 3.0}), 5)
    assert ahead.wind_at(0, np.zeros(3)).tolist() == ahead.episode["wind"][0].tolist() == [0.0, 1.0, 0.0]
    gone_on = begun(gassy("velocity", wind={"kind": "series"} | late, **{"plume.development": 0.0}), 5)
    gone_on.run_air(3.0)
    assert around(ahead, 0) == around(gone_on, 0)


def test_the_first_reading_is_that_of_the_first_hover_and_none_in_flight() -> None:
    world = begun(gassy("hop"), 5)
    assert clock_of(world) == 2.0
    assert world.senses["reading"][0] == pytest.approx(by_hand(world, 5, [[]] * 3), rel=1e-9)
    assert world.senses["reading"][0].any()
    flying = begun(gassy("velocity"), 5)
    assert clock_of(flying) == 0.0
    assert not flying.senses["reading"].any()
    assert not flying.senses["sampling_time"].any()


# --- readings -------------------------------------------------------------------------------------------------------


class Leg:
    """One leg of a UAV as its state tells."""

    def __init__(self, motion: Any) -> None:
        self.origin, self.target = motion["origin"].copy(), motion["target"].copy()
        self.end = float(motion["leg_end"])
        self.hover = self.end - float(motion["leg_hover"])
        self.takeoff = self.hover - float(motion["leg_flight"])
        self.begin = self.takeoff - float(motion["leg_turn"])

    def place(self, time: float) -> FloatArray:
        """Where the UAV is: before and after the flight, at its ends."""
        share = (time - self.takeoff) / (self.hover - self.takeoff) if self.hover > self.takeoff else 1.0
        place: FloatArray = self.origin + min(max(share, 0.0), 1.0) * (self.target - self.origin)
        return place


def by_hand(world: World, seed: int, legs: list[list[Leg]], rise: float = 0.0, fall: float = 0.0) -> list[float]:
    """The readings of UAVs that have flown `legs` and then their present one, from a plume that nobody is in."""
    scenario = world.scenario
    clean = begun(load_scenario(scenario, **MODES["velocity"]), seed)  # its clock is 0
    flown = [[*legs[i], Leg(world.motion[0, i])] for i in range(world.n_uavs)]
    levels, counted = np.zeros(world.n_uavs), [list[float]() for _ in range(world.n_uavs)]
    tick = scenario.tick
    for k in range(1, math.floor(clock_of(world) / tick + 1e-6) + 1):
        clean.run_air(tick)
        for i, own in enumerate(flown):
            leg = next((leg for leg in reversed(own) if leg.begin < k * tick - 1e-6), own[0])
            c = float(clean.concentration(0, leg.place(k * tick)))
            lag = rise if c > levels[i] else fall
            levels[i] += (c - levels[i]) * (1.0 - math.exp(-tick / lag) if lag > 0.0 else 1.0)
            if own[-1].hover + 1e-6 < k * tick < own[-1].end + 1e-6:
                counted[i].append(levels[i])
    return [float(np.mean(outputs)) if outputs else math.nan for outputs in counted]


@pytest.mark.parametrize("mode", ["hop", "hop event", "waypoint", "waypoint event"])
@pytest.mark.parametrize("lags", [(0.0, 0.0), (0.4, 3.0)])
def test_a_reading_is_the_mean_of_what_is_smelt_while_hovering(mode: str, lags: tuple[float, float]) -> None:
    """On the barrier clock also after a wait, on the event clock also while others fly on; a lag acts in flight."""
    scenario = gassy(mode, gas_sensor=IDEAL | {"rise_time": lags[0], "recovery_time": lags[1]})
    world, rng = begun(scenario, 5), np.random.default_rng(3)
    some_fly_on = False
    legs: list[list[Leg]] = [[Leg(world.motion[0, i])] for i in range(3)]
    compared = 0
    for _ in range(7):
        before = world.senses["reading"][0].copy()
        commands = random_commands(world, rng)
        if "waypoint" in mode:  # near the plume, of very different lengths
            commands[0][:] = world.motion["position"] + rng.uniform(-4.0, 4.0, (1, 3, 3)) * [[[0.1], [0.5], [1.0]]]
        advance(world, commands)
        ready = world.motion["ready"][0]
        some_fly_on = some_fly_on or not ready.all()
        expected = by_hand(world, 5, legs, *lags)
        for i in range(3):
            if ready[i]:
                assert world.senses["reading"][0, i] == pytest.approx(expected[i], rel=1e-9)
                legs[i].append(Leg(world.motion[0, i]))
                compared += expected[i] > 0.0
            else:
                assert world.senses["reading"][0, i] == before[i]
    assert compared > 5
    assert some_fly_on == mode.endswith("event")


@pytest.mark.parametrize("plume", [FAST | {"step": 0.25}, {"kind": "gaussian_puff", "step": 0.125, "max_age": 12.0}])
def test_a_reading_in_flight_is_the_mean_along_the_way(plume: dict[str, Any]) -> None:
    scenario = gassy("velocity", plume=plume)
    world, clean, rng = begun(scenario, 5), begun(scenario, 5), np.random.default_rng(3)
    tick = scenario.tick
    for _ in range(10):
        begin, clock = world.motion["position"][0].copy(), clock_of(world)
        advance(world, random_commands(world, rng))
        period = clock_of(world) - clock
        readings = []
        for k in range(1, round(period / tick) + 1):
            clean.run_air(tick)
            places = begin + k * tick / period * (world.motion["position"][0] - begin)
            readings.append(clean.concentration(0, places))
        assert len(readings) == 1.0 / tick
        np.testing.assert_allclose(world.senses["reading"][0], np.mean(readings, axis=0), rtol=1e-9)
        assert world.senses["sampling_time"][0].tolist() == [1.0] * 3
    assert world.senses["reading"].any()


def test_a_slow_sensor_holds_its_last_output() -> None:
    """An output each 3 s, decisions each 1 s."""
    scenario = gassy("velocity", gas_sensor=IDEAL | {"period": 3.0})
    world, clean = begun(scenario, 5), begun(scenario, 5)
    held = np.zeros(3)
    for second in range(1, 14):
        world.step_velocities(np.zeros((1, 3, 3)))
        clean.run_air(1.0)
        if second % 3 == 0:
            held = clean.concentration(0, world.motion["position"][0])
            assert held.any()
        np.testing.assert_allclose(world.senses["reading"][0], held, rtol=1e-9)


def test_every_leg_has_as_many_outputs_as_its_sampling_time_holds() -> None:
    """Also where a leg begins or ends on a tick: 2 s of hovering are 4 ticks, after a flight of any length."""
    scenario = gassy("waypoint", vehicle=FLYER | {"hover_time": 2.0, "speed": 1.0, "acceleration": 1e9})
    world, twin = begun(scenario, 5), begun(scenario, 5)
    start = world.motion["position"][0].copy()
    for k, (length, n) in enumerate(itertools.product([1.0, 2.0, 3.0], [1, 2])):
        targets = start + np.array([0.0, 0.0, length if k % 2 else 0.0])
        world.step_waypoints(targets[None], np.full((1, 3), n))
        end = clock_of(world)
        readings = []
        for tick in np.arange(end - 2.0 * n + 0.5, end + 0.1, 0.5):
            twin.reset(np.array([5]))
            twin.run_air(tick - 2.0)
            readings.append(twin.concentration(0, targets))
        assert len(readings) == 4 * n
        np.testing.assert_allclose(world.senses["reading"][0], np.mean(readings, axis=0), rtol=1e-9)


# --- wind -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["waypoint", "waypoint event", "velocity"])
def test_an_anemometer_reads_the_air_where_the_uav_is(mode: str) -> None:
    scenario = load_scenario("arena-4x6-5", **MODES[mode], **{"team.n_uavs": 4, "plume.development": 0.0})
    world, rng = begun(scenario, [2, 3]), np.random.default_rng(0)
    for _ in range(6):
        advance(world, random_commands(world, rng))
        for env in range(2):
            ready = world.motion["ready"][env]
            expected = world.wind_at(env, world.motion["position"][env])
            np.testing.assert_array_equal(world.senses["wind"][env, ready], expected[ready])
            assert len(np.unique(expected, axis=0)) == 4


def test_an_anemometer_reads_the_present_wind_and_a_rate_plume_follows_it() -> None:
    scenario = gassy("velocity", plume={"kind": "hit_rate"}, gas_sensor={"kind": "poisson_counter"})
    world, winds = begun(scenario, [2, 3]), []
    assert scenario.tick == scenario.wind.tick
    for _ in range(6):
        world.step_velocities(np.zeros((2, 3, 3)))
        for env in range(2):
            wind = world.wind_at(env, np.zeros(3))
            assert world.senses["wind"][env].tolist() == [wind.tolist()] * 3
            assert world.episode["wind"][env].tolist() == wind.tolist()
            expected = scenario.plume.field(  # type: ignore[union-attr]
                world.motion["position"][env], world.source_position[env], np.ones(1), wind
            )
            np.testing.assert_allclose(world.rates[env], expected, rtol=1e-12)
            winds.append(tuple(wind))
    assert len(set(winds)) == 12


STILL = {"kind": "uniform", "velocity": [0.0, 0.0, 0.0]}
PLUMES: dict[str, dict[str, Any]] = {
    "hit_rate": {"gas_sensor": {"kind": "poisson_counter"}},
    "gaussian_puff": {"plume": {"kind": "gaussian_puff", "max_age": 10.0}},
    "filament": {},
    "pseudo_gaussian": {"plume": {"kind": "pseudo_gaussian"}},
}


@pytest.mark.parametrize("kind", PLUMES)
@pytest.mark.parametrize("wind", [STILL, MEANDER | {"velocity": [0.0, 0.0, 0.0]}])
def test_still_air(kind: str, wind: dict[str, Any]) -> None:
    scenario = gassy("hop", **({"plume": {"kind": kind} if kind != "filament" else FAST} | PLUMES[kind]), wind=wind)
    world = begun(scenario, [2, 3])
    fly(world, seed=1, steps=4)
    points = np.concatenate([world.source_position[0], np.random.default_rng(0).uniform(0, 10, (50, 3))])
    there = world.concentration(0, points)
    assert np.isfinite(there).all()
    assert there.min() >= 0.0
    assert there[0] == there.max() > 0.0 or kind == "filament"
    assert np.isfinite(world.physical).all()
    assert np.abs(world.layout.flat(world)).max() <= 1.0


def test_ticks_keep_up_with_a_clock_that_is_a_sum_of_many_periods() -> None:
    """0.7 s have no exact binary form: after 8944 periods their sum is 1e-9 s short of 8944 times 0.7 s."""
    vehicle = {"kind": "point_mass", "speed": 1.0, "decision_period": 0.7, "physics_step": 0.7}
    plume = {"plume": {"kind": "pseudo_gaussian"}, "wind": {"kind": "uniform", "velocity": [1.0, 0.0, 0.0]}}
    ending = {"time_limit": 1e5, "max_decisions": 100_000}
    scenario = gassy("velocity", vehicle=vehicle, gas_sensor=IDEAL | {"period": 0.7}, ending=ending, **plume)
    world = begun(scenario.override(**{"energy.capacity": 1e9}), 5)
    velocities = np.array([[[0.0, 0.0, 0.5], [0.0, 0.5, 0.0], [0.0, 0.5, 0.5]]])
    for step in range(9000):
        world.step_velocities(velocities if step // 8 % 2 else -velocities)
        if step > 8900:
            expected = world.concentration(0, world.motion["position"][0])
            np.testing.assert_allclose(world.senses["reading"][0], expected, rtol=1e-6)
    assert world.running.all()
