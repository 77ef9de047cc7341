"""Rotor downwash: how the wake of a hovering UAV moves and dilutes the filaments near it.

Actuator disc (momentum theory; Leishman 2006, "Principles of Helicopter Aerodynamics", ch. 2): a disc of area A = pi
R^2 that lifts T induces v_i = sqrt(T / (2 rho A)); on the axis, at the depth s below it, the wake of an evenly loaded
disc moves at v_i (1 + s / sqrt(s^2 + R^2)): slower than v_i above the disc, 2 v_i far below, where it has contracted
to R / sqrt(2). Further down it is a round turbulent jet of the diameter d = sqrt(2) R (Pope 2000, "Turbulent Flows",
section 5.1, with the laser-Doppler values of Hussein, Capp and George 1994 in his table 5.1): on the axis B d 2 v_i /
s, B = 5.8, of the half-width S s, S = 0.094; the smaller of the two velocities holds. The profile across is Gaussian.
The jet mixes with an eddy viscosity of 0.028 times half-width and axial velocity (Pope section 5.2), the same at
every depth, and a turbulent Schmidt number of 0.7: filaments grow by twice that diffusivity; their content is kept.

Assumptions: all rotors of a UAV are one disc; it hovers (a quasi-steady wake, straight down); air that is drawn in
from the side and the spreading over the floor are left out; below `depth` wind and turbulence have taken over.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from osl_env.numerics import exp
from osl_env.parameters import Parameters, quantity

_GRAVITY = 9.80665  # m/s^2
_DECAY, _SPREAD = 5.8, 0.094  # B and S of the round jet
_EDDY_VISCOSITY, _SCHMIDT = 0.028, 0.7
_SUBSTEPS = 16  # of a tick: a filament falls through several radii in one
_LN2 = math.log(2.0)


class Wake(NamedTuple):
    """What the kernels need of a downwash; `radius` 0: there is none."""

    radius: float  # m, of the disc
    induced: float  # m/s
    depth: float  # m


class Downwash(Parameters):
    """The wake of one UAV. Defaults: about a DJI Matrice 100 (2.4 kg, four rotors of 0.17 m radius)."""

    mass: float = quantity(2.4, "kg", gt=0)  # that the rotors carry
    disc_area: float = quantity(0.36, "m^2", gt=0)  # of all rotors together
    air_density: float = quantity(1.2, "kg/m^3", gt=0)
    depth: float = quantity(5.0, "m", gt=0)  # of the wake below the UAV

    @property
    def induced_velocity(self) -> float:
        """v_i, m/s, at the disc."""
        return math.sqrt(self.mass * _GRAVITY / (2.0 * self.air_density * self.disc_area))

    @property
    def wake(self) -> Wake:
        """The wake in the kernels' form."""
        return Wake(math.sqrt(self.disc_area / math.pi), self.induced_velocity, self.depth)


def no_wake() -> Wake:
    """The wake of a UAV that does not disturb the air."""
    return Wake(0.0, 0.0, 0.0)


@njit(error_model="numpy")
def axial_velocity(wake: Any, depth: float) -> float:
    """Downward velocity, m/s, on the axis of the wake, `depth` m below the disc (negative: above)."""
    near = wake.induced * (1.0 + depth / math.sqrt(depth * depth + wake.radius * wake.radius))
    if depth <= 0.0:
        return float(near)
    return float(min(near, _DECAY * math.sqrt(2.0) * wake.radius * 2.0 * wake.induced / depth))


@njit(error_model="numpy")
def wake_velocity(wake: Any, depth: float, square: float) -> float:
    """Downward velocity, m/s, `depth` m below the disc and sqrt(`square`) m from the axis."""
    if depth > wake.depth or depth < -2.0 * wake.radius:
        return 0.0
    axial = axial_velocity(wake, depth)
    tube = wake.radius * wake.radius * wake.induced / max(axial, 1e-9)  # continuity: the stream tube's radius squared
    half_width = _SPREAD * max(depth, 0.0)
    return axial * exp(-_LN2 * square / max(tube, half_width * half_width))


@njit(error_model="numpy")
def blow(wake: Any, uavs: Any, x: float, y: float, z: float, span: float) -> tuple[float, float]:
    """How the wakes of UAVs at `uavs` (n, 3) m move a filament at (x, y, z) within `span` s, and widen it.

    Returns its displacement, m (downwards: negative), which ends at the floor, and the growth of its variance, m^2.
    """
    mixing = _EDDY_VISCOSITY * _SPREAD * _DECAY * math.sqrt(2.0) * wake.radius * 2.0 * wake.induced / _SCHMIDT
    reach = 4.0 * max(wake.radius * 4.0, _SPREAD * wake.depth)
    step = span / _SUBSTEPS
    fall, growth = 0.0, 0.0
    for n in range(uavs.shape[0]):
        dx, dy = x - uavs[n, 0], y - uavs[n, 1]
        square = dx * dx + dy * dy
        above = uavs[n, 2] - z
        if square > reach * reach or above > wake.depth or above < -2.0 * wake.radius:
            continue
        for _ in range(_SUBSTEPS):
            velocity = wake_velocity(wake, uavs[n, 2] - (z - fall), square)
            if velocity <= 0.0:
                break
            fall += velocity * step
            share = velocity / max(axial_velocity(wake, uavs[n, 2] - (z - fall)), 1e-9)
            growth += 2.0 * mixing * min(share, 1.0) * step
    return -min(fall, max(z, 0.0)), growth


@njit(cache=True, error_model="numpy")
def wake_velocities(wake: Wake, depths: Any, squares: Any, out: Any) -> None:
    """`wake_velocity` at `depths` and squared distances `squares` (n,), into `out` (n,)."""
    for k in range(np.shape(out)[0]):
        out[k] = wake_velocity(wake, depths[k], squares[k])
