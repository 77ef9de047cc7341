"""How wide a puff is: the standard deviations sigma_y (horizontal) and sigma_z (vertical) of its concentration.

Three laws give them as functions of the distance x (m) that the puff has travelled, for the Pasquill stability classes
A (very unstable) to F (stable):

    Briggs, open country and urban    sigma = a x (1 + b x)^p       (Briggs 1973; urban: EPA ISC3 Tables 1-3 and 1-4)
    Pasquill and Gifford, rural       sigma_y = 465.11628 X tan(TH),  TH = 0.017453293 (c - d ln X)   (ISC3 1-32, 1-33)
                                      sigma_z = a X^b, in pieces of X = x / 1000, at most 5000 m      (ISC3 1-34)

with the coefficients of EPA-454/B-95-003b (ISC3 user's guide, volume II), Tables 1-1 and 1-2. A fourth has no
stability class and depends on the puff's age t: sigma^2 = sigma_0^2 + 2 D t (`fixed`), the solution of the
advection-diffusion equation.

Assumptions: the curves were measured over 0.1 to 10 km and several minutes; close to the source they are
extrapolated, and `minimum_sigma_y` and `minimum_sigma_z` keep a puff from being a point. The pieces of ISC3's sigma_z
meet to about 0.5 % only.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, Literal, NamedTuple

import numpy as np
from numba import njit

from osl_env.parameters import FloatArray, Parameters, quantity

Stability = Literal["A", "B", "C", "D", "E", "F"]

_CLASSES = "ABCDEF"
_POWER, _ISC3, _DIFFUSION = range(3)  # forms of a law
_MINUS_ONE, _MINUS_HALF, _NONE, _HALF = -2, -1, 0, 1  # p of (1 + b x)^p, in halves

# a (-), b (1/m) and p, for A to F
_OPEN_Y = ((0.22, 1e-4, -1), (0.16, 1e-4, -1), (0.11, 1e-4, -1), (0.08, 1e-4, -1), (0.06, 1e-4, -1), (0.04, 1e-4, -1))
_OPEN_Z = (
    (0.20, 0.0, _NONE),
    (0.12, 0.0, _NONE),
    (0.08, 2e-4, _MINUS_HALF),
    (0.06, 15e-4, _MINUS_HALF),
    (0.03, 3e-4, _MINUS_ONE),
    (0.016, 3e-4, _MINUS_ONE),
)
_URBAN_Y = ((0.32, 4e-4, -1), (0.32, 4e-4, -1), (0.22, 4e-4, -1), (0.16, 4e-4, -1), (0.11, 4e-4, -1), (0.11, 4e-4, -1))
_URBAN_Z = (
    (0.24, 1e-3, _HALF),
    (0.24, 1e-3, _HALF),
    (0.20, 0.0, _NONE),
    (0.14, 3e-4, _MINUS_HALF),
    (0.08, 15e-4, _MINUS_HALF),
    (0.08, 15e-4, _MINUS_HALF),
)
# Table 1-1: c and d, degrees
_ISC3_Y = (
    (24.1670, 2.5334),
    (18.3330, 1.8096),
    (12.5000, 1.0857),
    (8.3330, 0.72382),
    (6.2500, 0.54287),
    (4.1667, 0.36191),
)
_REST = math.inf
# Table 1-2: up to X km, a, b; sigma_z in m
_ISC3_Z = (
    (
        (0.10, 122.800, 0.94470),
        (0.15, 158.080, 1.05420),
        (0.20, 170.220, 1.09320),
        (0.25, 179.520, 1.12620),
        (0.30, 217.410, 1.26440),
        (0.40, 258.890, 1.40940),
        (0.50, 346.750, 1.72830),
        (3.11, 453.850, 2.11660),
        (_REST, 5000.0, 0.0),
    ),
    ((0.20, 90.673, 0.93198), (0.40, 98.483, 0.98332), (_REST, 109.300, 1.09710)),
    ((_REST, 61.141, 0.91465),),
    (
        (0.30, 34.459, 0.86974),
        (1.00, 32.093, 0.81066),
        (3.00, 32.093, 0.64403),
        (10.00, 33.504, 0.60486),
        (30.00, 36.650, 0.56589),
        (_REST, 44.053, 0.51179),
    ),
    (
        (0.10, 24.260, 0.83660),
        (0.30, 23.331, 0.81956),
        (1.00, 21.628, 0.75660),
        (2.00, 21.628, 0.63077),
        (4.00, 22.534, 0.57154),
        (10.00, 24.703, 0.50527),
        (20.00, 26.970, 0.46713),
        (40.00, 35.420, 0.37615),
        (_REST, 47.618, 0.29592),
    ),
    (
        (0.20, 15.209, 0.81558),
        (0.70, 14.457, 0.78407),
        (1.00, 13.953, 0.68465),
        (2.00, 13.953, 0.63227),
        (3.00, 14.823, 0.54503),
        (7.00, 16.187, 0.46490),
        (15.00, 17.836, 0.41507),
        (30.00, 22.651, 0.32681),
        (60.00, 27.074, 0.27436),
        (_REST, 34.219, 0.21716),
    ),
)
_SIGMA_Z_CAP = 5000.0  # m
_SHORTEST, _LONGEST = 1e-6, 1e3  # km: where the ISC3 curve of sigma_y still grows with the distance


class DispersionLaw(NamedTuple):
    """A law for compiled code; what the numbers mean depends on `form`."""

    form: int
    y: FloatArray  # (3,): a, b, p; or c, d, -; or sigma_0, D, -
    z: FloatArray  # (3,): the same of sigma_z; of the ISC3 form unused
    pieces: FloatArray  # (n, 3): Table 1-2 for the class
    minimum: FloatArray  # (2,) m: of sigma_y and sigma_z


@njit(inline="always", error_model="numpy")
def _power(of: Any, x: float) -> float:
    stretch = 1.0 + of[1] * x
    p = of[2]
    if p == _MINUS_HALF:
        factor = 1.0 / math.sqrt(stretch)
    elif p == _MINUS_ONE:
        factor = 1.0 / stretch
    elif p == _HALF:
        factor = math.sqrt(stretch)
    else:
        factor = 1.0
    return float(of[0] * x * factor)


@njit(error_model="numpy")
def sigmas(law: Any, distance: float, age: float) -> tuple[float, float]:
    """sigma_y and sigma_z, m, of a puff that has travelled `distance` m in `age` s."""
    if law.form == _DIFFUSION:
        sigma_y = math.sqrt(law.y[0] * law.y[0] + 2.0 * law.y[1] * age)
        sigma_z = math.sqrt(law.z[0] * law.z[0] + 2.0 * law.z[1] * age)
    elif law.form == _POWER:
        sigma_y = _power(law.y, distance)
        sigma_z = _power(law.z, distance)
    else:
        x = min(max(1e-3 * distance, _SHORTEST), _LONGEST)
        log_x = math.log(x)
        sigma_y = 465.11628 * x * math.tan(0.017453293 * (law.y[0] - law.y[1] * log_x))
        piece = 0
        while x > law.pieces[piece, 0]:
            piece += 1
        sigma_z = min(law.pieces[piece, 1] * math.exp(law.pieces[piece, 2] * log_x), _SIGMA_Z_CAP)
    return max(sigma_y, law.minimum[0]), max(sigma_z, law.minimum[1])


@njit(cache=True, error_model="numpy")
def _all_sigmas(law: DispersionLaw, distances: FloatArray, ages: FloatArray, out: FloatArray) -> None:
    for k in range(distances.size):
        out[0, k], out[1, k] = sigmas(law, distances[k], ages[k])


class _Dispersion(Parameters):
    """Base of the laws."""

    @abstractmethod
    def law(self) -> DispersionLaw:
        """The law for compiled code."""

    def sigmas(self, distance: Any, age: Any = 0.0) -> tuple[FloatArray, FloatArray]:
        """sigma_y and sigma_z, m, after `distance` (..) m and `age` (..) s, which broadcast; each of their shape."""
        distances, ages = np.broadcast_arrays(np.asarray(distance, np.float64), np.asarray(age, np.float64))
        out = np.empty((2, distances.size))
        _all_sigmas(self.law(), distances.reshape(-1).copy(), ages.reshape(-1).copy(), out)
        return out[0].reshape(distances.shape), out[1].reshape(distances.shape)


class _ByStability(_Dispersion):
    """A law of the distance and the stability class."""

    stability: Stability = "A"
    minimum_sigma_y: float = quantity(0.5, "m", gt=0)  # the chemotaxis page's reading, as the next
    minimum_sigma_z: float = quantity(0.2, "m", gt=0)

    def _law(self, form: int, y: Any, z: Any, pieces: Any = ()) -> DispersionLaw:
        row = _CLASSES.index(self.stability)
        return DispersionLaw(
            form,
            np.resize(np.array(y[row], np.float64), 3),
            np.resize(np.array(z[row], np.float64), 3),
            np.array(pieces[row] if pieces else [], np.float64).reshape(-1, 3),
            np.array([self.minimum_sigma_y, self.minimum_sigma_z]),
        )


class BriggsOpenCountry(_ByStability):
    """Briggs's interpolation for open country (Briggs 1973, ATDL 79)."""

    kind: Literal["briggs_open_country"] = "briggs_open_country"

    def law(self) -> DispersionLaw:
        """The law for compiled code."""
        return self._law(_POWER, _OPEN_Y, _OPEN_Z)


class BriggsUrban(_ByStability):
    """Briggs's interpolation for towns, after the St. Louis experiments (ISC3 Tables 1-3 and 1-4)."""

    kind: Literal["briggs_urban"] = "briggs_urban"

    def law(self) -> DispersionLaw:
        """The law for compiled code."""
        return self._law(_POWER, _URBAN_Y, _URBAN_Z)


class PasquillGifford(_ByStability):
    """Pasquill and Gifford's rural curves as fitted in ISC3 (Tables 1-1 and 1-2)."""

    kind: Literal["pasquill_gifford"] = "pasquill_gifford"

    def law(self) -> DispersionLaw:
        """The law for compiled code."""
        return self._law(_ISC3, _ISC3_Y, _ISC3_Y, _ISC3_Z)


class FixedDispersion(_Dispersion):
    """Sigmas that do not depend on the distance: constant, or growing with the puff's age by diffusion."""

    kind: Literal["fixed"] = "fixed"
    sigma_y: float = quantity(0.5, "m", gt=0)  # at the release
    sigma_z: float = quantity(0.2, "m", gt=0)
    diffusivity_y: float = quantity(0.0, "m^2/s", ge=0)  # D: sigma^2 grows by 2 D t
    diffusivity_z: float = quantity(0.0, "m^2/s", ge=0)

    def law(self) -> DispersionLaw:
        """The law for compiled code."""
        return DispersionLaw(
            _DIFFUSION,
            np.array([self.sigma_y, self.diffusivity_y, 0.0]),
            np.array([self.sigma_z, self.diffusivity_z, 0.0]),
            np.empty((0, 3)),
            np.zeros(2),
        )


Dispersion = BriggsOpenCountry | BriggsUrban | PasquillGifford | FixedDispersion
