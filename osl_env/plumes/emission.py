"""Plumes whose sources release gas at a rate in g/s, and the unit in which they are read: g/m^3, or ppm by volume.

1 g/m^3 = 1e6 R T / (P M) ppm      of an ideal gas of molar mass M
"""

from __future__ import annotations

from typing import ClassVar, Literal

from osl_env.parameters import quantity
from osl_env.plumes.base import PlumeModel

GAS_CONSTANT = 8.31446261815324  # J/(mol K)


class EmissionPlume(PlumeModel):
    """Base of the plumes with a release rate. Molar mass, temperature and pressure matter for readings in ppm alone."""

    measures: ClassVar[Literal["hit_rate", "concentration"]] = "concentration"

    gas_unit: Literal["g/m^3", "ppm"] = "g/m^3"  # of the readings
    release_rate: float = quantity(1.0, "g/s", gt=0)  # Q, of a source with strength 1
    molar_mass: float = quantity(46.07, "g/mol", gt=0)  # of the gas (ethanol)
    temperature: float = quantity(298.0, "K", gt=0)
    pressure: float = quantity(101325.0, "Pa", gt=0)

    @property
    def unit(self) -> str:
        """Of a concentration: g/m^3 or ppm (by volume)."""
        return self.gas_unit

    @property
    def summary(self) -> str:
        """What kind of plume, and how much is released."""
        return f"{getattr(self, 'kind', 'plume').replace('_', ' ')} of {self.release_rate:g} g/s"

    @property
    def scaled_rate(self) -> float:
        """The release rate in units of the reading times m^3/s."""
        if self.gas_unit == "g/m^3":
            return self.release_rate
        return 1e6 * self.release_rate * GAS_CONSTANT * self.temperature / (self.pressure * self.molar_mass)
