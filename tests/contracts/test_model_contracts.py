"""What every plume, wind and vehicle must do."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from discovery import PLUMES, SENSORS, VEHICLES, WINDS, example, kind
from pydantic import ValidationError
from worlds import NOISY, advance, begun, differences, random_commands, small

from osl_env import Scenario
from osl_env.air import local_winds, uniform_air
from osl_env.arena import Arena
from osl_env.parameters import FloatArray, Parameters
from osl_env.plumes.base import PlumeModel, Scene
from osl_env.state import MOTION
from osl_env.vehicles.base import Vehicle
from osl_env.winds.base import Wind

MODELS: list[type[Parameters]] = [*PLUMES, *WINDS, *VEHICLES, *SENSORS]


def test_the_models_are_found() -> None:
    assert {"hit_rate", "gaussian_puff", "filament", "pseudo_gaussian", "playback"} <= {kind(cls) for cls in PLUMES}
    assert {"uniform", "meander", "turbulent", "series", "field"} <= {kind(cls) for cls in WINDS}
    assert {"grid_hop", "point_mass", "quadrotor"} <= {kind(cls) for cls in VEHICLES}
    assert {"poisson_counter", "ideal", "pid", "mox"} <= {kind(cls) for cls in SENSORS}
    assert len({kind(cls) for cls in MODELS}) == len(MODELS)


@pytest.mark.parametrize("cls", MODELS)
def test_parameters_are_frozen_documented_and_have_units(cls: type[Parameters]) -> None:
    model = example(cls)
    given = model.model_dump(exclude_defaults=True)
    assert cls.__doc__
    with pytest.raises(ValidationError, match="unknown key no_such_parameter"):
        cls(**given, **{"no_such_parameter": 1})
    for name, field in cls.model_fields.items():
        with pytest.raises(ValidationError, match="frozen"):
            setattr(model, name, getattr(model, name))
        if isinstance(field.default, float):
            extra: Any = field.json_schema_extra
            assert extra is not None, f"{name}: a number without a unit"
            assert "unit" in extra
            for bad in (math.nan, -math.inf, True, "five", [1.0, 2.0]):
                with pytest.raises(ValidationError):
                    cls(**given | {name: bad})
    assert cls.model_validate(model.model_dump()) == model


WIND = np.array([1.2, 0.4, 0.0])  # m/s
ARENA = Arena(size=(30.0, 30.0, 30.0))
TICKS = 40


def scene(n_envs: int, n_uavs: int, seed: int = 0) -> Scene:
    """Random places, two sources each, a wind of its own in each world."""
    rng = np.random.default_rng(seed)
    air = uniform_air(n_envs)
    air.mean[:] = WIND * rng.uniform(0.5, 1.0, (n_envs, 1))
    return Scene(
        sources=rng.uniform(10, 20, (n_envs, 2, 3)),
        strengths=rng.uniform(0.5, 2, (n_envs, 2)),
        air=air,
        geometry=ARENA.geometry,
        area=np.array(ARENA.size),
        positions=rng.uniform(1, 29, (n_envs, n_uavs, 3)),
    )


def row_of(whole: Scene, env: int) -> Scene:
    """The world `env` of a scene, alone."""
    one = slice(env, env + 1)
    air = uniform_air(1)
    air.mean[:] = whole.air.mean[one]
    return Scene(
        whole.sources[one].copy(), whole.strengths[one].copy(), air, whole.geometry, whole.area,
        whole.positions[one].copy(),
    )  # fmt: skip


def developed(plume: PlumeModel, where: Scene, seeds: list[int], ticks: int = TICKS) -> tuple[Any, FloatArray]:
    """The plume's state after `ticks`, and its readings at the scene's positions."""
    n_envs, everywhere = len(where.sources), np.ones(len(where.sources), np.bool_)
    plume.check(ARENA, where.sources.shape[1])
    state = plume.allocate(n_envs, where.sources.shape[1], ARENA)
    plume.begin(state, where, np.arange(n_envs), np.array(seeds))
    for _ in range(ticks if plume.tick is not None else 0):
        plume.advance(state, where, everywhere)
    out = np.full(where.positions.shape[:2], np.nan)
    plume.read(state, where, where.positions, everywhere, out)
    return state, out


@pytest.mark.parametrize("cls", PLUMES)
def test_plumes_are_the_same_in_a_batch_and_alone_and_leave_the_scene_as_it_is(cls: type[PlumeModel]) -> None:
    plume, whole, seeds = example(cls), scene(5, 3), [3, 1, 4, 1, 2**61]
    before = [a.tobytes() for a in (whole.sources, whole.strengths, whole.air.mean, whole.positions)]
    _, together = developed(plume, whole, seeds)
    assert before == [a.tobytes() for a in (whole.sources, whole.strengths, whole.air.mean, whole.positions)]
    assert np.all(np.isfinite(together))
    assert np.all(together >= 0)
    for env in range(5):
        _, alone = developed(plume, row_of(whole, env), seeds[env : env + 1])
        assert np.array_equal(alone[0], together[env])


@pytest.mark.parametrize("cls", PLUMES)
def test_plumes_read_strided_places_and_single_points_alike(cls: type[PlumeModel]) -> None:
    plume, whole = example(cls), scene(2, 4)
    state, plain = developed(plume, whole, [1, 2])
    places = np.zeros((2, 4), MOTION)
    places["position"] = whole.positions
    out = np.full((2, 4), np.nan)
    plume.read(state, whole, places["position"], np.ones(2, np.bool_), out)
    assert np.array_equal(out, plain)
    for env in range(2):
        np.testing.assert_allclose(plume.at(state, whole, env, whole.positions[env]), plain[env], rtol=1e-6, atol=1e-12)
    assert plume.unit


@pytest.mark.parametrize("cls", PLUMES)
def test_plumes_move_only_in_the_worlds_that_are_due_and_begin_anew(cls: type[PlumeModel]) -> None:
    plume, whole = example(cls), scene(2, 3)
    state, early = developed(plume, whole, [1, 2])
    out = np.full((2, 3), np.nan)
    if plume.tick is None:
        return
    for _ in range(5):
        plume.advance(state, whole, np.array([False, True]))
    plume.read(state, whole, whole.positions, np.array([True, True]), out)
    assert np.array_equal(out[0], early[0])
    plume.begin(state, whole, np.array([1]), np.array([2]))
    for _ in range(TICKS):
        plume.advance(state, whole, np.array([False, True]))
    plume.read(state, whole, whole.positions, np.array([True, True]), out)
    assert np.array_equal(out, early)


@pytest.mark.parametrize("cls", PLUMES)
def test_plumes_say_what_they_measure_and_hold_on_the_source_and_without_wind(cls: type[PlumeModel]) -> None:
    assert cls.measures in ("hit_rate", "concentration")
    whole = scene(2, 2)
    whole.air.mean[0] = 0.0
    whole.positions[:, 0] = whole.sources[:, 0]
    _, out = developed(example(cls), whole, [1, 2])
    assert np.all(np.isfinite(out))
    assert np.all(out[:, 0] > 0)


@pytest.mark.parametrize("cls", [cls for cls in PLUMES if example(cls).tick is None])
def test_steady_plumes_turn_with_the_world(cls: type[PlumeModel]) -> None:
    whole = scene(3, 2)
    _, out = developed(example(cls), whole, [1, 2, 3])
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    for array in (whole.positions, whole.sources, whole.air.mean):
        array[:] = array @ quarter.T
    _, turned = developed(example(cls), whole, [1, 2, 3])
    np.testing.assert_allclose(turned, out, rtol=1e-9)


@pytest.mark.parametrize("cls", WINDS)
def test_winds_depend_on_the_seed_alone(cls: type[Wind]) -> None:
    options = {"random_direction": True} if "random_direction" in cls.model_fields else {}
    for wind in (example(cls), example(cls).model_copy(update=options)):
        seeds = np.array([5, 2**62, 0, 5])
        drawn = wind.draw(seeds)
        assert drawn.shape == (4, 3)
        assert np.all(np.isfinite(drawn))
        assert np.array_equal(drawn[0], drawn[3])
        assert np.array_equal(drawn[::-1], wind.draw(seeds[::-1].copy()))
        assert np.array_equal(drawn[1:2], wind.draw(seeds[1:2].copy()))
    if options:
        many = example(cls).model_copy(update=options).draw(np.arange(2000))
        speeds = np.linalg.norm(many, axis=1)
        np.testing.assert_allclose(speeds, speeds[0])
        # the mean of uniform directions: each component has variance 1/2; 5 standard errors
        assert np.all(np.abs(many[:, :2].mean(axis=0)) < 5 * speeds[0] * np.sqrt(0.5 / 2000))


def blown(wind: Wind, seeds: list[int], due: list[bool], ticks: int = 30) -> FloatArray:
    """The air at three places of each world after `ticks` in the worlds of `due`: (n_envs, 3, 3) m/s."""
    n_envs, tick = len(seeds), wind.tick if wind.changes else 0.1
    state = wind.allocate(n_envs, ARENA)
    wind.check(ARENA)
    wind.begin(state, np.arange(n_envs), np.array(seeds), 0.0)
    for k in range(ticks if wind.changes else 0):
        wind.advance(state, np.array(due), np.full(n_envs, (k + 1) * tick), tick)
    places = np.tile(np.array([[3.0, 3, 3], [15, 15, 15], [27, 27, 27]]), (n_envs, 1, 1))
    out = np.empty_like(places)
    local_winds(state.air, places, out)
    return out


@pytest.mark.parametrize("cls", WINDS)
def test_winds_are_the_same_in_a_batch_and_alone_and_where_they_are_uniform(cls: type[Wind]) -> None:
    wind = example(cls)
    together = blown(wind, [7, 8, 9], [True] * 3)
    assert np.all(np.isfinite(together))
    for env in range(3):
        assert np.array_equal(blown(wind, [7 + env], [True])[0], together[env])
    if wind.uniform:
        assert np.all(together == together[:, :1])
    still = blown(wind, [7, 8, 9], [False, True, False])
    assert np.array_equal(still[1], together[1])
    assert np.array_equal(still[[0, 2]], blown(wind, [7, 8, 9], [True] * 3, ticks=0)[[0, 2]])


FLIGHTS = [(cls, command, clock) for cls in VEHICLES for command in cls.commands for clock in ("barrier", "event")]


def scenario(cls: type[Vehicle], command: str, clock: str, **changes: Any) -> Scenario:
    period = {"decision_period": 1.0} if "decision_period" in cls.model_fields else {}
    return small(vehicle={"kind": kind(cls)} | period, action=command, clock=clock, **NOISY | changes)


@pytest.mark.parametrize(("cls", "command", "clock"), FLIGHTS)
def test_vehicles_obey_the_laws_of_flight(cls: type[Vehicle], command: str, clock: str) -> None:
    overshoot = 1.2 if "airframe" in cls.model_fields else 1.0  # a body's controller is no limit of its speed
    for capacity in (2e6, 8e3):
        world = begun(scenario(cls, command, clock, **{"energy.capacity": capacity}), [1, 2, 3])
        rng, area, steps = np.random.default_rng(0), np.array(world.scenario.arena.size), 0
        while world.running.any():
            before = world.ledger.copy()
            position, now = world.motion["position"].copy(), world.episode["clock"].copy()
            advance(world, random_commands(world, rng))
            moved = np.linalg.norm(world.motion["position"] - position, axis=-1)
            flown = world.ledger["path"] - before["path"]
            assert np.all(moved <= flown + 1e-9)
            airborne = world.ledger["search_time"] - before["search_time"]
            assert np.all(flown <= world.scenario.vehicle.speed * overshoot * airborne + 1e-9)
            assert np.all((world.motion["position"] >= 0) & (world.motion["position"] <= area))
            assert np.all(world.episode["clock"] >= now)
            assert np.all(world.ledger["energy"] >= before["energy"])
            assert np.all(world.ledger["spent"] <= capacity * (1 + 1e-12))
            steps += 1
            assert steps < 500
        np.testing.assert_allclose(world.ledger["energy"].sum(axis=-1), world.ledger["spent"], rtol=1e-9)
        ledger = world.ledger
        parts = ledger["flying_time"] + ledger["hovering_time"] + ledger["turning_time"]
        np.testing.assert_allclose(parts, ledger["search_time"], rtol=1e-9)


@pytest.mark.parametrize(("cls", "command", "clock"), FLIGHTS)
def test_vehicles_fly_the_same_in_a_batch_and_alone(cls: type[Vehicle], command: str, clock: str) -> None:
    many, alone = begun(scenario(cls, command, clock), [4, 5]), begun(scenario(cls, command, clock), 5)
    rng = np.random.default_rng(1)
    while many.running.any():
        commands = random_commands(many, rng)
        advance(many, commands)
        advance(alone, tuple(np.ascontiguousarray(array[1:]) for array in commands))
        assert differences(many, 1, alone, 0) == []
