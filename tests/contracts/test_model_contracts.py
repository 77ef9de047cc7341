"""What every plume, wind and vehicle must do."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from discovery import PLUMES, VEHICLES, WINDS, kind
from pydantic import ValidationError
from worlds import NOISY, advance, begun, differences, random_commands, small

from osl_env import Scenario
from osl_env.parameters import FloatArray, Parameters
from osl_env.plumes.base import PlumeModel
from osl_env.state import EPISODE, MOTION
from osl_env.vehicles.base import Vehicle
from osl_env.winds.base import Wind

MODELS: list[type[Parameters]] = [*PLUMES, *WINDS, *VEHICLES]


def test_the_models_are_found() -> None:
    assert {"hit_rate"} <= {kind(cls) for cls in PLUMES}
    assert {"uniform"} <= {kind(cls) for cls in WINDS}
    assert {"grid_hop", "point_mass"} <= {kind(cls) for cls in VEHICLES}
    assert len({kind(cls) for cls in MODELS}) == len(MODELS)


@pytest.mark.parametrize("cls", MODELS)
def test_parameters_are_frozen_documented_and_have_units(cls: type[Parameters]) -> None:
    model = cls()
    assert cls.__doc__
    with pytest.raises(ValidationError, match="extra"):
        cls(**{"no_such_parameter": 1})
    for name, field in cls.model_fields.items():
        with pytest.raises(ValidationError, match="frozen"):
            setattr(model, name, getattr(model, name))
        if isinstance(field.default, float):
            extra: Any = field.json_schema_extra
            assert extra is not None, f"{name}: a number without a unit"
            assert "unit" in extra
            for bad in (math.nan, -math.inf, True, "five", [1.0, 2.0]):
                with pytest.raises(ValidationError):
                    cls(**{name: bad})
    assert cls.model_validate(model.model_dump()) == model


def batch(n_envs: int, n_uavs: int, seed: int = 0) -> tuple[Any, Any, FloatArray, FloatArray]:
    """Motion, episode, sources and strengths of random worlds."""
    rng = np.random.default_rng(seed)
    motion, episode = np.zeros((n_envs, n_uavs), MOTION), np.zeros(n_envs, EPISODE)
    motion["position"] = rng.uniform(0, 30, (n_envs, n_uavs, 3))
    episode["wind"][:, :2] = rng.normal(size=(n_envs, 2))
    return motion, episode, rng.uniform(0, 30, (n_envs, 2, 3)), rng.uniform(0.5, 2, (n_envs, 2))


@pytest.mark.parametrize("cls", PLUMES)
def test_plumes_read_every_uav_as_if_it_were_alone(cls: type[PlumeModel]) -> None:
    motion, episode, sources, strengths = batch(7, 3)
    plume, out = cls(), np.full((7, 3), np.nan)
    before = [array.tobytes() for array in (motion, episode, sources, strengths)]
    plume.read(motion, sources, strengths, episode, out)
    assert before == [array.tobytes() for array in (motion, episode, sources, strengths)]
    assert np.all(np.isfinite(out))
    assert np.all(out >= 0)
    for env in range(7):
        for uav in range(3):
            alone = np.full((1, 1), np.nan)
            row, one = slice(env, env + 1), slice(uav, uav + 1)
            plume.read(motion[row, one].copy(), sources[row].copy(), strengths[row].copy(), episode[row].copy(), alone)
            assert alone[0, 0] == out[env, uav]


@pytest.mark.parametrize("cls", PLUMES)
def test_plumes_say_what_they_measure_and_hold_on_the_source_and_without_wind(cls: type[PlumeModel]) -> None:
    assert cls.measures in ("hit_rate", "concentration")
    motion, episode, sources, strengths = batch(2, 2)
    motion["position"][:, 0] = sources[:, 0]
    episode["wind"][0] = 0.0
    out = np.full((2, 2), np.nan)
    cls().read(motion, sources, strengths, episode, out)
    assert np.all(np.isfinite(out))
    assert np.all(out[:, 0] > 0)


@pytest.mark.parametrize("cls", PLUMES)
def test_plumes_turn_with_the_world(cls: type[PlumeModel]) -> None:
    motion, episode, sources, strengths = batch(3, 2)
    out, turned = np.full((3, 2), np.nan), np.full((3, 2), np.nan)
    cls().read(motion, sources, strengths, episode, out)
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    motion["position"], episode["wind"] = motion["position"] @ quarter.T, episode["wind"] @ quarter.T
    cls().read(motion, np.ascontiguousarray(sources @ quarter.T), strengths, episode, turned)
    np.testing.assert_allclose(turned, out, rtol=1e-9)


@pytest.mark.parametrize("cls", WINDS)
def test_winds_depend_on_the_seed_alone(cls: type[Wind]) -> None:
    options = {"random_direction": True} if "random_direction" in cls.model_fields else {}
    for wind in (cls(), cls(**options)):
        seeds = np.array([5, 2**62, 0, 5])
        drawn = wind.draw(seeds)
        assert drawn.shape == (4, 3)
        assert np.all(np.isfinite(drawn))
        assert np.array_equal(drawn[0], drawn[3])
        assert np.array_equal(drawn[::-1], wind.draw(seeds[::-1].copy()))
        assert np.array_equal(drawn[1:2], wind.draw(seeds[1:2].copy()))
    if options:
        many = cls(**options).draw(np.arange(2000))
        speeds = np.linalg.norm(many, axis=1)
        np.testing.assert_allclose(speeds, speeds[0])
        # the mean of uniform directions: each component has variance 1/2; 5 standard errors
        assert np.all(np.abs(many[:, :2].mean(axis=0)) < 5 * speeds[0] * np.sqrt(0.5 / 2000))


FLIGHTS = [(cls, command, clock) for cls in VEHICLES for command in cls.commands for clock in ("barrier", "event")]


def scenario(cls: type[Vehicle], command: str, clock: str, **changes: Any) -> Scenario:
    return small(vehicle={"kind": kind(cls)}, action=command, clock=clock, **NOISY | changes)


@pytest.mark.parametrize(("cls", "command", "clock"), FLIGHTS)
def test_vehicles_obey_the_laws_of_flight(cls: type[Vehicle], command: str, clock: str) -> None:
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
            assert np.all(flown <= world.scenario.vehicle.speed * airborne + 1e-9)
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
