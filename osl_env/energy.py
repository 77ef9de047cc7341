"""Energy of a UAV: what each kind of work costs, and the battery that ends its flight (MUC-OSL eqs 4 to 9).

    E_f = P_f l / v (4);  E_h = P_h n_h t_h (5);  E_b = n_b e_b (6);  E_C = gamma_c C f_c^2 N_c (7);  E_T = P_T N_d /
    r_T (8) E   = E_f + E_h + E_b + E_C + E_T <= E_max
    (9)

Eq 5 is printed with P_f, a slip: hovering costs P_h. Waiting for the others (barrier clock) is hovering too, kept as
a kind of its own because the paper does not count it. A UAV whose battery is empty stops where it is, in the middle
of a leg. The flying, hovering and turning constants are the paper's measurements on a DJI Matrice 100; the computing
constants are the usual ones of mobile edge computing (the paper states none). The paper's E_max is not stated and
does not bind: the default exceeds what 20 minutes can cost. The Matrice 100's own two batteries hold 0.94 MJ.

`MeasuredEnergy` is that model: constants a kind of work. `ThrustEnergy` instead takes the power from the thrust of
each rotor at each moment (`vehicles/rotor_power.py`), for vehicles that have rotors; its turns and legs have no price
of their own, and what a hovering second costs depends on the airframe.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from osl_env.parameters import Parameters, quantity
from osl_env.state import StateArray

ROTORS = np.dtype(  # (1,): the numbers of a `ThrustEnergy` that the kernels use
    [
        ("air_density", np.float64),  # kg/m^3
        ("induced_factor", np.float64),
        ("efficiency", np.float64),  # 0: the airframe's
        ("avionics_power", np.float64),  # W; negative: the airframe's
    ],
    align=True,
)


class EnergyModel(Parameters):
    """Base of the energy models: the battery, and what computing costs (MUC-OSL eq 7)."""

    switched_capacitance: float = quantity(1e-28, "F", ge=0)  # gamma_c
    cycles_per_bit: float = quantity(1000.0, "", ge=0)  # C
    clock_frequency: float = quantity(1e9, "Hz", ge=0)  # f_c
    capacity: float = quantity(2.0e6, "J", gt=0)  # E_max

    @property
    def joule_per_bit(self) -> float:
        """Energy of processing one bit, J (eq 7)."""
        return self.switched_capacitance * self.cycles_per_bit * self.clock_frequency**2


class MeasuredEnergy(EnergyModel):
    """Measured powers of flying and hovering, and an energy of each turn (MUC-OSL eqs 4 to 6)."""

    kind: Literal["measured"] = "measured"
    flying_power: float = quantity(663.0, "W", ge=0)  # P_f
    hovering_power: float = quantity(470.0, "W", ge=0)  # P_h
    turn_energy: float = quantity(3415.0, "J", ge=0)  # e_b, of one turn by any angle


class ThrustEnergy(EnergyModel):
    """Power from the rotors' thrust: induced, profile and climbing power over the drive's efficiency, and avionics."""

    kind: Literal["thrust"] = "thrust"
    air_density: float = quantity(1.225, "kg/m^3", gt=0)  # rho
    induced_factor: float = quantity(1.15, "", ge=1)  # kappa: what uneven inflow and swirl cost above the ideal
    efficiency: float | None = quantity(None, "", gt=0, le=1)  # of the drive; None: the airframe's
    avionics_power: float | None = quantity(None, "W", ge=0)  # None: the airframe's

    @property
    def flying_power(self) -> float:
        """W beyond the rotors' own power: none."""
        return 0.0

    @property
    def hovering_power(self) -> float:
        """W beyond the rotors' own power: none. `rotor_power.hovering_power` gives that of an airframe."""
        return 0.0

    @property
    def turn_energy(self) -> float:
        """J of a turn beyond the rotors' own power: none."""
        return 0.0

    def numbers(self) -> StateArray:
        """ROTORS (1,)."""
        record = np.zeros(1, ROTORS)
        record["air_density"], record["induced_factor"] = self.air_density, self.induced_factor
        record["efficiency"] = 0.0 if self.efficiency is None else self.efficiency
        record["avionics_power"] = -1.0 if self.avionics_power is None else self.avionics_power
        return record
