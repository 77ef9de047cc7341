"""Fluxotaxis: a lattice of robots goes where chemical mass flows in, and tells a source by the flux's divergence.

D. Zarzhitsky, D. Spears and W. Spears, "Swarms for chemical plume tracing", IEEE Swarm Intelligence Symposium 2005, and
"Distributed robotics approach to chemical plume tracing", IROS 2005; D. Spears, D. Thayer and D. Zarzhitsky,
"Foundations of swarm robotic chemical plume tracing from a fluid dynamics perspective", Int. J. Intelligent Computing
and Cybernetics 2 (2009). By the divergence theorem, a region out of which more chemical mass flux rho V flows than in
holds an emitter, one with more inflow a sink; GDMF, the gradient of div(rho V), points to the emitter.

Lattice (physicomimetics; W. Spears, D. Spears, J. Hamann, R. Heil, Autonomous Robots 17, 2004). Between robots r apart,
attraction positive, none beyond `sight` R, at most F_max:
    lennard-jones   F = G ((R / r)^2.1 - (R / r)^2.7), with the exponents of Zarzhitsky's published simulator
    split-newton    F = +-G (R / r)^p, repulsion below R and attraction above, sight 1.5 (R to the p makes G a force)

Goal (as in that simulator). Seen from robot i, neighbour j has the flux rho_j V_j.e_ij (times r_ij), e_ij the direction
to it; 0 where rho or V is below what the sensor detects. With two neighbours or more:
    1. the flux of some j is negative (gas flows in): go to the most negative;
    2. else, some is positive (all flows out): go to the most positive: the plume lies there, or the emitter between;
    3. else, the gas stands still: go to the neighbour with the largest rho if it is above the own; else cast.
With fewer: upwind while gas is smelt; else cast diagonally (`baselines.hearing`). `goal: gradient` follows GDMF in
place of 1 and 2 where it is not zero, from the divergences that the neighbours found at their last decision.

Emitter test: rho V is fitted by least squares as linear in place over the neighbours and the own reading; its trace is
the divergence. The simulator turns every robot back that sees outflow only, the foremost in the plume too, and so
the swarm waits for others to drift past. Read differently: one that smells gas itself goes on upwind in case 2 unless
the divergence is positive (`front: return` restores it). Mode "emitter": outflow only, and a positive divergence.

Read differently as well: forces are velocities in units of the speed (the simulator adds them up to a velocity that it
cuts, without friction), so the goal's is 1 and G twice the goal's; R is half the radio's radius, as there; with an
infinite radio 0.1 of the area's scale. rho and V are low-pass means, and rho is 0 three filter times after the last
detection. A frame without a payload counts with its reading and the own wind. The payload has 20 bytes.
"""

from __future__ import annotations

import math
from typing import ClassVar, Literal

import numpy as np

from baselines.hearing import CALM, DiagonalCast, Heard, HearingPilot, HearingPolicy, pack, unpack
from baselines.policy import Briefing, register_policy
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity

_SLANT = math.radians(30.0)  # of the cast
_NEAREST = 0.2  # of R: forces of nearer robots are those at this distance
_FORGET = 3.0  # filter times after a detection
_ATTRACTION, _REPULSION = 2.1, 2.7  # exponents
_RANK = 1e-6  # of the largest singular value: neighbours in a line tell nothing across it


def lattice_force(distance: float, spacing: float, law: str, exponent: float = 2.0) -> float:
    """F / G at `distance`, m, in a lattice of `spacing` R, m; attraction is positive, 0 exactly at R."""
    ratio = spacing / max(distance, _NEAREST * spacing)
    if law == "lennard-jones":
        return float(ratio**_ATTRACTION - ratio**_REPULSION)
    return float(np.sign(distance - spacing) * ratio**exponent)


def slopes(offsets: FloatArray, differences: FloatArray) -> FloatArray:
    """(3, k): the gradients of k quantities, 1/m, from their `differences` (n, k) over `offsets` (n, 3), least squares.

    Zero across what the offsets span, and without neighbours.
    """
    if not len(offsets) or not offsets.any():
        return np.zeros((3, differences.shape[1]))
    return np.asarray(np.linalg.lstsq(offsets, differences, rcond=_RANK)[0], dtype=np.float64)


def divergence(offsets: FloatArray, flux: FloatArray, own: FloatArray) -> float:
    """div(rho V) at a robot with the flux `own` (3,), from its neighbours' `flux` (n, 3) at `offsets` (n, 3) m."""
    return float(np.trace(slopes(offsets, flux - own)))


class Tracer(HearingPilot):
    """One robot of the lattice."""

    __slots__ = ("_cast", "_p", "divergence", "sight", "spacing")

    def __init__(self, parameters: Fluxotaxis, briefing: Briefing) -> None:
        super().__init__(briefing, parameters)
        self._p = parameters
        self.spacing = self.radius(0.5, 0.1) if parameters.spacing is None else parameters.spacing  # R, m
        self.sight = parameters.sight * self.spacing
        self._cast = DiagonalCast(briefing, self.fence, _SLANT, self.leg)
        self.divergence = 0.0  # of rho V here, at the last decision

    def _own(self, time: float) -> tuple[float, FloatArray]:
        """rho and V here."""
        smelt = self.senses.smelt(time, _FORGET * self.senses.time_constant)
        wind = self.senses.wind
        if self.briefing.planar:
            wind = np.array([wind[0], wind[1], 0.0])
        return self.senses.concentration if smelt else 0.0, wind

    def payload(self, observation: Observation) -> bytes:
        """rho, V and the last divergence, 20 bytes."""
        rho, wind = self._own(observation.time)
        return pack(rho, *wind.tolist(), self.divergence)

    def wish(self, observation: Observation, others: list[Heard]) -> FloatArray:
        """Lattice force and goal force, as a velocity."""
        near = [other for other in others if other.distance <= self.sight]
        force = np.zeros(3)
        for other in near:
            size = self._p.lattice_gain * lattice_force(other.distance, self.spacing, self._p.law, self._p.exponent)
            force += float(np.clip(size, -self._p.force_limit, self._p.force_limit)) * other.direction
        return self.speed * (force + self._p.goal_gain * self._goal(observation, near))

    def _goal(self, observation: Observation, near: list[Heard]) -> FloatArray:
        """Unit vector of the goal force; zero in a calm that smells."""
        rho, wind = self._own(observation.time)
        told = [self._told(other, wind) for other in near]
        offsets = np.array([other.distance * other.direction for other in near]).reshape(-1, 3)
        flux = np.array([part[0] * part[1] for part in told]).reshape(-1, 3)
        self.divergence = divergence(offsets, flux, rho * wind)
        if len(near) < 2:
            return self._upwind_or_cast(observation, rho)
        if self._p.goal == "gradient":
            rises = np.array([part[2] - self.divergence for part in told])[:, None]
            slope = slopes(offsets, rises)[:, 0]
            size = math.sqrt(float(slope @ slope))
            if size > 0.0:
                self.mode = "gradient"
                return slope / size
        out = [self._outflow(other, part[0], part[1]) for other, part in zip(near, told, strict=True)]
        if min(out) < 0.0:
            self.mode = "inflow"
            return near[int(np.argmin(out))].direction
        if max(out) > 0.0:
            self.mode = "emitter" if self.divergence > 0.0 else "outflow"
            upwind = self.senses.upwind
            if self._p.front == "upwind" and rho > 0.0 and self.divergence <= 0.0 and upwind is not None:
                self.mode = "front"
                return upwind
            return near[int(np.argmax(out))].direction
        densest = int(np.argmax([part[0] for part in told]))
        if told[densest][0] > rho:
            self.mode = "chemotaxis"
            return near[densest].direction
        return self._upwind_or_cast(observation, rho)

    def _outflow(self, other: Heard, rho: float, wind: FloatArray) -> float:
        if rho <= 0.0 or float(wind @ wind) < CALM * CALM:
            return 0.0
        flux = rho * float(wind @ other.direction)
        return flux * other.distance if self._p.distance_bias else flux

    def _upwind_or_cast(self, observation: Observation, rho: float) -> FloatArray:
        upwind = self.senses.upwind
        if rho > 0.0:
            self.mode = "upwind"
            return np.zeros(3) if upwind is None else upwind
        self.mode = "cast"
        return self._cast.direction(observation.position, upwind)

    def _told(self, other: Heard, wind: FloatArray) -> tuple[float, FloatArray, float]:
        """rho, V and divergence of a neighbour."""
        numbers = unpack(other.payload, 5)
        if numbers is not None:
            return max(numbers[0], 0.0), np.array(numbers[1:4]), numbers[4]
        above = other.concentration > (0.0 if self.counts else self.briefing.threshold)
        return other.concentration if above else 0.0, wind, 0.0


@register_policy
class Fluxotaxis(HearingPolicy):
    """Fluxotaxis with a physicomimetic lattice."""

    name: ClassVar[str] = "fluxotaxis"
    summary: ClassVar[str] = (
        "fluxotaxis: a lattice of robots goes where chemical mass flows in; divergence tells the source"
    )

    law: Literal["lennard-jones", "split-newton"] = "lennard-jones"
    spacing: float | None = quantity(None, "m", gt=0)  # R; None: 0.5 of the radio's radius, or 0.1 of the area's scale
    sight: float = quantity(2.0, "", gt=1)  # of R: neighbours
    lattice_gain: float = quantity(2.0, "", ge=0)  # G, of the speed
    exponent: float = quantity(2.0, "", ge=0, le=10)  # p of split-newton
    force_limit: float = quantity(4.0, "", gt=0)  # F_max, of the speed, of each neighbour
    goal_gain: float = quantity(1.0, "", ge=0)  # of the speed
    goal: Literal["flux", "gradient"] = "flux"
    front: Literal["upwind", "return"] = "upwind"
    distance_bias: bool = True  # a far neighbour's flux counts more

    def pilot(self, briefing: Briefing) -> Tracer:
        """A robot for an episode with `briefing`."""
        return Tracer(self, briefing)
