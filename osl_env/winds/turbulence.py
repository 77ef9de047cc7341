"""A wind that differs from place to place: the wind model of Farrell et al. (2002, Environ. Fluid Mech. 2, 143-169).

A horizontal wind (u, v) on a coarse grid over the arena, the same at all heights, obeys

    du/dt = -u du/dx - v du/dy + K/2 (d2u/dx2 + d2u/dy2),    and the same for v

The wind at the arena's four corners is the mean velocity plus coloured noise, independent for each corner and
component, and along the edges it is linear between the corners. The noise is a damped oscillator driven by white noise:

    dx = y dt,    dy = -(omega^2 x + 2 zeta omega y) dt + G omega^2 dW

with bandwidth (omega) and damping (zeta). Farrell et al. give K = 1 .. 30 m^2/s (10 in their code) for 100 x 100 m at
1 m/s on nodes 5 to 10 m apart, and two settings: small meander (G = 3, zeta = 0.071, omega = 0.71 rad/s) and large
(G = 20, zeta = 0.1, omega = 0.2 rad/s). Values and equations as restated by M. Graham's pompy. The model is made for
the meander of a plume, not for small eddies; it is not free of divergence and knows no obstacles.

Here the noise has its stationary standard deviation as parameter, `noise_std` = G sqrt(omega / (4 zeta)), and:
- The noise takes its exact solution over a step. Farrell's Euler step adds G omega^2 N(0, 1) dt, so that its amplitude
  depends on the step: at step dt their G is `noise_std` = G sqrt(omega dt / (4 zeta)); 0.47 and 1.41 m/s at 0.01 s.
- It begins stationary, with a flow that has developed, instead of with the mean velocity everywhere.
- Where a cell is too coarse for K (K < |u| dx), K is raised to |u| dx in that direction (hybrid differencing, Spalding
  1972). With the substeps chosen, a new value is then a mean of old ones: the flow stays within its edges' bounds.
- K defaults to 0.1 V L, for V the mean speed (or the noise, if larger) and L the arena's longer side: Farrell's ratio.
- The noise is slower by default. At omega = 0.2 rad/s, K = 10 m^2/s smooths it away within sqrt(K / omega) = 7 m of
  the edges, and of Farrell's 1.41 m/s some 0.35 m/s is left in the middle of 100 x 60 m; at 0.05 rad/s 0.4 m/s leaves
  0.2 m/s.
- Nodes on the edges are the arena's own edges; pompy adds a layer outside.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from osl_env.air import Air
from osl_env.arena import Arena
from osl_env.errors import InputError
from osl_env.parameters import FloatArray, quantity
from osl_env.state import BoolArray, IntArray
from osl_env.winds.base import WindState
from osl_env.winds.mean_wind import MeanWind
from osl_env.winds.turbulence_kernels import NOISE_COLUMNS, Flow, advance_flows, begin_flows

_FEWEST = 4  # nodes along a side
_CLEARING_TIMES = 3.0  # of development before an episode: what is left of the first guess is e^-3 of its error
_MAX_SUBSTEPS = 1000  # in a tick
_MAX_BYTES = 4 * 2**30


class TurbulentWind(MeanWind):
    """A horizontal wind with large eddies, correlated in space and time, about a mean. Zero mean wind is allowed."""

    kind: Literal["turbulent"] = "turbulent"
    noise_std: float = quantity(0.4, "m/s", ge=0)  # of each component at the corners
    noise_bandwidth: float = quantity(0.05, "rad/s", gt=0)  # omega
    noise_damping: float = quantity(0.3, "", gt=0, le=1)  # zeta
    diffusivity: float | None = quantity(None, "m^2/s", gt=0)  # K; by default 0.1 V L
    nodes: int = quantity(20, "", ge=_FEWEST, le=200)  # along the longer side
    step: float = quantity(0.1, "s", gt=0)  # between two changes, where the plume does not set it

    @property
    def changes(self) -> bool:
        """Whether there is noise."""
        return self.noise_std > 0

    @property
    def uniform(self) -> bool:
        """Never: the air is on a grid."""
        return False

    def flow(self, lx: float, ly: float) -> Flow:
        """The numbers of the flow over `lx` x `ly` m, for the kernels."""
        nx, ny = (max(_FEWEST, 1 + round((self.nodes - 1) * side / max(lx, ly))) for side in (lx, ly))
        scale = max(self.speed, self.noise_std)
        k = 0.1 * scale * max(lx, ly) if self.diffusivity is None else self.diffusivity
        clearing = self.speed / max(lx, ly) + math.pi**2 * k / 2.0 * (1.0 / lx**2 + 1.0 / ly**2)  # 1/s
        development = _CLEARING_TIMES / clearing if self.changes else 0.0
        return Flow(
            nx, ny, lx / (nx - 1), ly / (ny - 1), k / 2.0, self.noise_std, self.noise_bandwidth, self.noise_damping,
            development,
        )  # fmt: skip

    def check(self, arena: Arena) -> None:
        """Raise ValueError if a tick would take too many substeps."""
        flow = self.flow(*arena.size[:2])
        fastest = self.speed + 5.0 * self.noise_std
        rate = sum(2.0 * max(flow.diffusivity, fastest * side / 2.0) / side**2 for side in (flow.dx, flow.dy))
        if self.step * rate > _MAX_SUBSTEPS:
            raise ValueError(
                f"nodes = {self.nodes}: with {flow.dx:.3g} m between nodes and K = {2 * flow.diffusivity:.3g} m^2/s"
                f" a tick of {self.step:g} s takes {self.step * rate:.0f} substeps; at most {_MAX_SUBSTEPS}"
            )

    def allocate(self, n_envs: int, arena: Arena) -> WindState:
        """Still air on a grid for each world. Raises InputError above 4 GiB."""
        flow = self.flow(*arena.size[:2])
        size = flow.nx * flow.ny
        if n_envs * size * (2 * 8 + 3 * 4) > _MAX_BYTES:
            raise InputError(f"wind.nodes = {self.nodes}: the wind of {n_envs} worlds needs over 4 GiB")
        air = Air(
            mean=np.zeros((n_envs, 3)),
            grid=np.zeros((n_envs, flow.nx, flow.ny, 1, 3), np.float32),
            frame=np.repeat(np.arange(n_envs)[:, None], 2, axis=1),
            blend=np.zeros(n_envs),
            origin=np.zeros(3),
            spacing=np.array([flow.dx, flow.dy, 1.0]),
        )
        return WindState(air, np.zeros((n_envs, NOISE_COLUMNS + 2 * size)), np.zeros(n_envs, np.uint64))

    def begin(self, state: WindState, rows: IntArray, seeds: IntArray, start: float) -> None:
        """Draw the noise of the worlds `rows` from its stationary distribution, and let the flow develop."""
        state.air.mean[rows] = self.draw(seeds)
        begin_flows(rows, seeds, self._flow_of(state), state.air.mean, state.memory, state.streams, state.air.grid)

    def advance(self, state: WindState, due: BoolArray, clock: FloatArray, tick: float) -> None:
        """Move the flow in the worlds of `due` (n_envs,) on by `tick` s."""
        advance_flows(due, tick, self._flow_of(state), state.air.mean, state.memory, state.streams, state.air.grid)

    def _flow_of(self, state: WindState) -> Flow:
        """The flow on the grid of `state`, whose arena is as long as its nodes reach."""
        _, nx, ny, _, _ = state.air.grid.shape
        dx, dy, _ = state.air.spacing
        return self.flow(float(dx * (nx - 1)), float(dy * (ny - 1)))
