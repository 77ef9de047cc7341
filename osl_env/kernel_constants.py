"""The numbers of a scenario that the kernels need, in one record (`state.CONSTANTS`)."""

from __future__ import annotations

import numpy as np

from osl_env.energy import ThrustEnergy
from osl_env.radio import HEADER_BYTES
from osl_env.scenario import Scenario
from osl_env.sensors import PoissonCounter
from osl_env.state import CONSTANTS, StateArray
from osl_env.vehicles.quadrotor import Quadrotor
from osl_env.vehicles.rotor_power import hovering_power


def kernel_constants(scenario: Scenario) -> StateArray:
    """CONSTANTS (1,) of `scenario`: what the kernels need of its model objects."""
    constants = np.zeros(1, CONSTANTS)
    vehicle, energy, ending, radio = scenario.vehicle, scenario.energy, scenario.ending, scenario.radio
    for name in ("step_length", "hop_lengths", "speed", "acceleration", "hover_time", "turn_time", "max_samples"):
        constants[name] = getattr(vehicle, name)
    for name in ("decision_period", "physics_step", "position_gain"):
        constants[name] = getattr(vehicle, name, 0.0)
    for name in ("flying_power", "hovering_power", "turn_energy", "capacity"):
        constants[name] = getattr(energy, name)
    if isinstance(energy, ThrustEnergy) and isinstance(vehicle, Quadrotor):
        constants["hovering_power"] = hovering_power(vehicle.airframe, energy)
    for name in ("time_limit", "max_decisions", "success_radius"):
        constants[name] = getattr(ending, name)
    if isinstance(scenario.gas_sensor, PoissonCounter):
        for name in ("false_positive_rate", "miss_probability", "dead_time"):
            constants[name] = getattr(scenario.gas_sensor, name)
    for name in ("radius", "latency", "loss"):
        constants[name] = getattr(radio, name)
    for name in ("time", "success", "false_declaration", "energy", "detection", "shaping"):
        constants[f"reward_{name}"] = getattr(scenario.reward, name)
    constants["area"] = scenario.arena.size
    constants["joule_per_bit_computed"] = energy.joule_per_bit
    constants["joule_per_byte_sent"] = radio.joule_per_byte
    constants["event_clock"] = scenario.clock == "event"
    constants["collision"] = ("stop", "slide", "end").index(scenario.arena.collision)
    constants["bounds_end"] = scenario.arena.bounds == "end"
    constants["margin"] = scenario.arena.margin
    constants["planar"] = vehicle.is_planar
    constants["reach"] = ending.success == "reach"
    constants["wind_noise"] = scenario.anemometer.noise
    constants["header_bytes"] = HEADER_BYTES
    constants["discount"] = scenario.reward.discount
    return constants
