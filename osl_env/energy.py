"""Energy of a UAV: what each kind of work costs, and the battery that ends its flight (MUC-OSL eqs 4 to 9).

    E_f = P_f l / v (4);  E_h = P_h n_h t_h (5);  E_b = n_b e_b (6);  E_C = gamma_c C f_c^2 N_c (7);  E_T = P_T N_d /
    r_T (8) E   = E_f + E_h + E_b + E_C + E_T <= E_max
    (9)

Eq 5 is printed with P_f, a slip: hovering costs P_h. Waiting for the others (barrier clock) is hovering too, kept as
a kind of its own because the paper does not count it. A UAV whose battery is empty stops where it is, in the middle
of a leg. The flying, hovering and turning constants are the paper's measurements on a DJI Matrice 100; the computing
constants are the usual ones of mobile edge computing (the paper states none). The paper's E_max is not stated and
does not bind: the default exceeds what 20 minutes can cost. The Matrice 100's own two batteries hold 0.94 MJ.
"""

from __future__ import annotations

from osl_env.parameters import Parameters, quantity


class EnergyModel(Parameters):
    """Powers, energies and battery capacity of one UAV (MUC-OSL eqs 4 to 9)."""

    flying_power: float = quantity(663.0, "W", ge=0)  # P_f
    hovering_power: float = quantity(470.0, "W", ge=0)  # P_h
    turn_energy: float = quantity(3415.0, "J", ge=0)  # e_b, of one turn by any angle
    switched_capacitance: float = quantity(1e-28, "F", ge=0)  # gamma_c
    cycles_per_bit: float = quantity(1000.0, "", ge=0)  # C
    clock_frequency: float = quantity(1e9, "Hz", ge=0)  # f_c
    capacity: float = quantity(2.0e6, "J", gt=0)  # E_max

    @property
    def joule_per_bit(self) -> float:
        """Energy of processing one bit, J (eq 7)."""
        return self.switched_capacitance * self.cycles_per_bit * self.clock_frequency**2
