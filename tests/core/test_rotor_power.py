"""Power from thrust: momentum theory in its limits, its shape in flight, and published figures of three quadrotors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from bodies import flight, hovering, numbers_of, powers
from numba import njit

from osl_env.energy import EnergyModel, MeasuredEnergy, ThrustEnergy
from osl_env.vehicles.airframe import AIRFRAMES, GRAVITY, Airframe
from osl_env.vehicles.rotor_power import hovering_power, induced_velocity

ALL = sorted(AIRFRAMES)
IDEAL = ThrustEnergy(induced_factor=1.0, efficiency=1.0, avionics_power=0.0)


def changed(name: str, **differences: float) -> Airframe:
    return Airframe(**(AIRFRAMES[name].model_dump() | differences))


@njit
def _induced(hover_squared: float, across: float, along: float) -> float:
    return induced_velocity(hover_squared, across, along)


@pytest.mark.parametrize("name", ALL)
def test_hovering_is_ideal_momentum_theory_without_losses(name: str) -> None:
    airframe = changed(name, profile_drag=0.0)
    weight, area = airframe.mass * GRAVITY, 4 * math.pi * airframe.rotor_radius**2
    ideal = weight * math.sqrt(weight / (2 * IDEAL.air_density * area))  # Leishman eq 2.16, on four discs
    assert hovering_power(airframe, IDEAL) == pytest.approx(ideal, rel=1e-12)
    thin = ThrustEnergy(**(IDEAL.model_dump() | {"air_density": 0.9}))
    assert hovering_power(airframe, thin) == pytest.approx(ideal * math.sqrt(1.225 / 0.9), rel=1e-12)
    lossy = ThrustEnergy(induced_factor=1.2, efficiency=0.5, avionics_power=3.0)
    assert hovering_power(airframe, lossy) == pytest.approx(1.2 * ideal / 0.5 + 3.0, rel=1e-12)


@pytest.mark.parametrize("name", ALL)
def test_profile_power_of_hovering_is_that_of_blade_element_theory(name: str) -> None:
    airframe = AIRFRAMES[name]
    tip, area = airframe.hover_speed * airframe.rotor_radius, math.pi * airframe.rotor_radius**2
    profile = 4 * IDEAL.air_density * area * tip**3 * airframe.solidity * airframe.profile_drag / 8
    without = hovering_power(changed(name, profile_drag=0.0), IDEAL)
    assert hovering_power(airframe, IDEAL) - without == pytest.approx(profile, rel=1e-12)


def test_the_induced_velocity_solves_glauerts_equation() -> None:
    hover = 4.0  # m/s
    across, along = np.meshgrid(np.linspace(0.0, 40.0, 41), np.linspace(-hover, 20.0, 49))
    v = np.vectorize(_induced)(hover**2, across, along)
    np.testing.assert_allclose(v * np.hypot(across, along + v), hover**2, rtol=1e-7)  # what four Newton steps leave
    assert np.all(v > 0)
    assert _induced(hover**2, 0.0, 0.0) == hover
    np.testing.assert_allclose(_induced(hover**2, 400.0, 0.0), hover**2 / 400.0, rtol=1e-6)  # fast forward flight
    for climb in (1.0, 5.0):
        expected = -climb / 2 + math.sqrt(climb**2 / 4 + hover**2)  # Leishman eq 2.78, axial climb
        assert _induced(hover**2, 0.0, climb) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", ["hummingbird", "matrice-100"])
def test_power_has_a_minimum_at_moderate_forward_speed(name: str) -> None:
    numbers, energy = numbers_of(name), ThrustEnergy()
    speeds = np.arange(0.0, 15.0, 1.0)
    steady = np.array([flight(numbers, (v, 0.0, 0.0), seconds=10.0, tracks=False)[-1] for v in speeds])
    power = powers(numbers, energy, steady)
    lowest = int(power.argmin())
    assert 3.0 <= speeds[lowest] <= 8.0
    assert power[lowest] < 0.96 * power[0]
    assert np.all(np.diff(power[: lowest + 1]) < 0)
    assert np.all(np.diff(power[lowest:]) > 0)
    assert power[-1] > 1.1 * power[0]
    # flying at a speed, and standing in a wind of that speed, are the same thing to the rotors
    steady[:, 3:6] -= (3.0, 0.0, 0.0)
    np.testing.assert_allclose(powers(numbers, energy, steady, (-3.0, 0.0, 0.0)), power, rtol=1e-12)


@pytest.mark.parametrize("name", ALL)
def test_climbing_costs_more_than_hovering_and_sinking_less(name: str) -> None:
    numbers, energy = numbers_of(name), ThrustEnergy()
    rates = (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)
    steady = np.array([flight(numbers, (0.0, 0.0, w), seconds=10.0, tracks=False)[-1] for w in rates])
    power = powers(numbers, energy, steady)
    assert np.all(np.diff(power) > 0)
    # lossless, steady climb adds at least half its potential power: the induced velocity falls as it climbs
    gain = powers(numbers, IDEAL, steady[-1:])[0] - powers(numbers, IDEAL, steady[3:4])[0]
    assert gain > 0.5 * AIRFRAMES[name].mass * GRAVITY * steady[-1, 5]


@pytest.mark.parametrize("name", ALL)
def test_power_is_finite_and_never_negative_however_it_falls(name: str) -> None:
    numbers, energy = numbers_of(name), ThrustEnergy()
    rng, states = np.random.default_rng(0), np.tile(hovering(numbers), (2000, 1))
    states[:, 3:6] = rng.normal(0.0, 15.0, (2000, 3))
    quaternions = rng.normal(size=(2000, 4))
    states[:, 6:10] = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    states[:, 13:17] *= rng.uniform(0.0, 1.5, (2000, 4))
    states[::7, 13:17] = 0.0
    power = powers(numbers, energy, states)
    assert np.all(np.isfinite(power))
    assert power.min() >= AIRFRAMES[name].avionics_power
    np.testing.assert_allclose(power[::7], AIRFRAMES[name].avionics_power)  # rotors at rest
    sinking = np.tile(hovering(numbers), (60, 1))
    sinking[:, 5] = -np.linspace(0.0, 30.0, 60)
    assert np.abs(np.diff(powers(numbers, energy, sinking))).max() < 0.1 * hovering_power(AIRFRAMES[name], energy)


def test_a_crazyflie_hovers_for_seven_minutes() -> None:
    """Bitcraze states 7 minutes with 250 mAh at 3.7 V; their thrust stand measured 8.07 W at a thrust of 30 g."""
    power = hovering_power(AIRFRAMES["crazyflie"], ThrustEnergy())
    assert power == pytest.approx(8.07, rel=0.01)
    assert 0.250 * 3.7 * 3600 / power / 60 == pytest.approx(7.0, abs=0.3)


@pytest.mark.parametrize(
    ("thrust", "measured"),  # g; W, amperes times volts of Bitcraze's thrust stand
    [(17.3, 1.37 * 3.80), (24.4, 1.83 * 3.71), (28.6, 2.11 * 3.67), (32.8, 2.39 * 3.65)],
)
def test_a_crazyflie_draws_what_the_thrust_stand_measured(thrust: float, measured: float) -> None:
    """One efficiency for all loads is our estimate: it is low by a fifth where the motors are half loaded."""
    power = hovering_power(changed("crazyflie", mass=thrust / 1000), ThrustEnergy())
    assert power == pytest.approx(measured, rel=0.25 if thrust < 20 else 0.1)


def test_a_hummingbird_hovers_about_as_long_as_its_maker_states() -> None:
    """AscTec states up to 20 minutes with 2.1 Ah at 11.1 V; solidity, blade drag and efficiency are our estimates."""
    power = hovering_power(AIRFRAMES["hummingbird"], ThrustEnergy())
    assert 15.0 < 2.1 * 11.1 * 3600 / power / 60 < 25.0


def test_a_matrice_100_draws_the_power_that_muc_osl_measured() -> None:
    measured = MeasuredEnergy().hovering_power
    assert hovering_power(AIRFRAMES["matrice-100"], ThrustEnergy()) == pytest.approx(measured, rel=0.02)


@pytest.mark.parametrize(
    ("mass", "watt_hours", "minutes"),
    [
        (2.355, 99.9, 22.0),
        (2.855, 99.9, 17.0),
        (3.355, 99.9, 13.0),
        (2.431, 129.96, 28.0),
        (2.931, 129.96, 20.0),
        (3.431, 129.96, 16.0),
    ],
)
def test_a_matrice_100_hovers_as_long_as_its_maker_states(mass: float, watt_hours: float, minutes: float) -> None:
    """DJI's table for batteries TB47D and TB48D and payloads of 0, 500 and 1000 g; only the 470 W were fitted."""
    power = hovering_power(changed("matrice-100", mass=mass), ThrustEnergy())
    assert watt_hours * 60 / power == pytest.approx(minutes, rel=0.06)


def test_the_energy_of_a_flight_is_the_integral_of_its_power() -> None:
    numbers = numbers_of("crazyflie", physics_step=0.01)
    states = flight(numbers, (0.0, 0.0, 10.0), seconds=6.0, longest=1.0)
    work = float(powers(numbers, IDEAL, states).sum()) * 0.01
    potential = AIRFRAMES["crazyflie"].mass * GRAVITY * states[-1, 2]
    hover = 6.0 * hovering_power(AIRFRAMES["crazyflie"], IDEAL)
    assert hover < work < hover + 1.5 * potential  # the climb costs, and no more than its height and the drag


def test_energy_models_answer_alike() -> None:
    measured, thrust = MeasuredEnergy(), ThrustEnergy()
    assert (measured.kind, thrust.kind) == ("measured", "thrust")
    assert (measured.flying_power, measured.hovering_power, measured.turn_energy) == (663.0, 470.0, 3415.0)
    assert (thrust.flying_power, thrust.hovering_power, thrust.turn_energy) == (0.0, 0.0, 0.0)
    assert isinstance(measured, EnergyModel)
    assert measured.joule_per_bit == thrust.joule_per_bit == pytest.approx(1e-7)
    record = thrust.numbers()[0]
    assert (record["air_density"], record["efficiency"], record["avionics_power"]) == (1.225, 0.0, -1.0)
    for bad in ({"efficiency": 0.0}, {"efficiency": 1.5}, {"air_density": 0.0}, {"induced_factor": 0.9}):
        with pytest.raises(ValueError, match=next(iter(bad))):
            ThrustEnergy(**bad)
