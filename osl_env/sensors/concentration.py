"""Gas sensors that follow a concentration c(t): ideal, photo-ionisation (PID) and metal oxide (MOX).

    d level / dt = (c - level) / tau,   tau = rise_time if c > level else recovery_time
    output       = min(level + baseline + noise, full_scale)

A first-order lag with two time constants is the reduced model of a MOX sensor of GADEN's simulated sensor (Monroy et
al. 2017, Sensors 17(7):1479), which Monroy et al. (2012, Sensors 12:13664) invert to undo the slow recovery: the gas
adsorbs fast and desorbs slowly (Gonzalez-Jimenez, Monroy and Blanco 2011, Sensors 11:6145). Unlike GADEN's, whose lag
acts on the resistance and precedes its calibration curve, it acts on the concentration: the output is taken to be
linearised. It is integrated exactly for a concentration that is constant during a tick, so halving the tick leaves it.

Noise is Gaussian and independent between the outputs, one each `period`; a tick that is longer than the period stands
for all outputs in it, so its noise is that of their mean. The baseline is a random walk from 0 (drift). A reading is
the mean of the outputs in the sampling time, not below 0, rounded to the resolution; it is a detection if it is
above the threshold. A sensor that smells nothing gives exactly 0 if it has no noise or drift.

With a `count_unit` the sensor reports whole hits, for policies that count: the model of `baselines.belief.likelihood`.
Gaussian filaments that are scattered like a Poisson process, with concentration c0 at their centres, have

    mean of c = n c0 (2 pi)^(3/2) sigma^3,   variance of c = n c0^2 pi^(3/2) sigma^3   (Campbell; n per volume)

so that c / u with u = c0 / 2^(3/2) has equal mean and variance: a Poisson count to second order. `count_unit` is that
u, or any other concentration that gives one count a second; a sampling time of dt s counts x = c dt / u on average, and
the reading is floor(x + U) with U uniform on [0, 1): its mean is x, without the bias of rounding (a dither), and its
variance exceeds that of x by at most 1/4. Concentrations not above the threshold count as none. Counts saturate at
`max_count`. For dt other than 1 s the mean is still right, but the variance is not Poisson's: encounters last.
"""

from __future__ import annotations

import math
from typing import ClassVar, Literal

import numpy as np
from pydantic import model_validator

from osl_env.parameters import quantity
from osl_env.sensors.base import HITS_SCALE, RESPONSE, GasSensor
from osl_env.state import StateArray

_UNIT = "unit of the plume"  # no unit that could be converted: concentrations are given as plain numbers
_THRESHOLDS_OF_SCALE = 10.0


class ConcentrationSensor(GasSensor):
    """Base of the sensors of concentration; concentrations are in the plume's unit. As it stands it is ideal."""

    measures: ClassVar[Literal["hit_rate", "concentration"]] = "concentration"

    period: float = quantity(0.1, "s", gt=0)  # between two outputs
    rise_time: float = quantity(0.0, "s", ge=0)  # time constant while the level rises; 0: at once
    recovery_time: float = quantity(0.0, "s", ge=0)  # time constant while it falls
    noise: float = quantity(0.0, _UNIT, ge=0)  # standard deviation of an output
    relative_noise: float = quantity(0.0, "", ge=0)  # standard deviation of an output, as a share of the level
    drift: float = quantity(0.0, _UNIT + "/sqrt(s)", ge=0)  # of the baseline: its standard deviation after 1 s
    threshold: float = quantity(0.0, _UNIT, ge=0)  # a reading above it is a detection
    full_scale: float = quantity(math.inf, _UNIT, gt=0, infinite=True)  # the largest output
    resolution: float = quantity(0.0, _UNIT, ge=0)  # step of the reading; 0: none
    count_unit: float | None = quantity(None, _UNIT, gt=0)  # that gives one count a second; None: no counts
    max_count: int | None = quantity(None, "", ge=1)  # the largest count of a reading; None: no limit
    typical_reading: float | None = quantity(None, _UNIT, gt=0)  # to normalise observations; None: see `scale`

    @model_validator(mode="after")
    def _consistent(self) -> ConcentrationSensor:
        if self.threshold >= self.full_scale:
            raise ValueError(f"threshold = {self.threshold:g}: must be below full_scale = {self.full_scale:g}")
        if self.max_count is not None and self.count_unit is None:
            raise ValueError(f"max_count = {self.max_count}: needs a count_unit")
        return self

    @property
    def reports(self) -> Literal["hits", "concentration"]:
        """Hits with a `count_unit`, else the concentration."""
        return "concentration" if self.count_unit is None else "hits"

    @property
    def scale(self) -> float:
        """5 hits; or `typical_reading`, by default ten thresholds, a tenth of full scale, or 1: the first there is."""
        if self.count_unit is not None:
            return HITS_SCALE
        if self.typical_reading is not None:
            return self.typical_reading
        if self.threshold > 0.0:
            return _THRESHOLDS_OF_SCALE * self.threshold
        return self.full_scale / 10.0 if math.isfinite(self.full_scale) else 1.0

    def response(self) -> StateArray:
        """RESPONSE (1,): the numbers that the kernels need."""
        response = np.zeros(1, RESPONSE)
        for name in RESPONSE.names or ():
            value = getattr(self, name)
            response[name] = value if value is not None else math.inf if name == "max_count" else 0.0
        return response


class IdealSensor(ConcentrationSensor):
    """Sensor that reads the concentration as it is, at once.

    Its threshold of 0 makes any trace of gas a detection, and a Gaussian plume has no edge: give one there.
    """

    kind: Literal["ideal"] = "ideal"


class PidSensor(ConcentrationSensor):
    """Photo-ionisation detector: one first-order lag, noise, a range.

    Defaults, in ppm, are those of a miniature 10.6 eV detector in diffusion mode by its data sheet (range 4000 ppm,
    least detectable 0.1 ppm, 90 % of a step within 3 s: a time constant of 3 s / ln 10); the noise is taken to be a
    third of what is detectable. For a plume in another unit give noise, threshold and full scale in that unit.
    """

    kind: Literal["pid"] = "pid"
    rise_time: float = quantity(1.3, "s", ge=0)
    recovery_time: float = quantity(1.3, "s", ge=0)
    noise: float = quantity(0.033, _UNIT, ge=0)
    threshold: float = quantity(0.1, _UNIT, ge=0)
    full_scale: float = quantity(4000.0, _UNIT, gt=0, infinite=True)


class MoxSensor(ConcentrationSensor):
    """Metal oxide sensor at 10 Hz: fast rise, slow recovery, drift.

    Time constants are those of a Figaro TGS2620 in GADEN's simulated sensor (2.96 s and 15.71 s, from experiments).
    Noise, drift (0.35 ppm in 20 min) and threshold are round numbers in ppm for a calibrated sensor, from no source.
    """

    kind: Literal["mox"] = "mox"
    rise_time: float = quantity(2.96, "s", ge=0)
    recovery_time: float = quantity(15.71, "s", ge=0)
    noise: float = quantity(0.1, _UNIT, ge=0)
    drift: float = quantity(0.01, _UNIT + "/sqrt(s)", ge=0)
    threshold: float = quantity(1.0, _UNIT, ge=0)
    full_scale: float = quantity(5000.0, _UNIT, gt=0, infinite=True)
