"""Filament plume: puffs of gas that the air carries about (Farrell et al. 2002; GADEN, Monroy et al. 2017).

Every source releases `filament_rate` filaments per second, Gaussians of the standard deviation sigma0, which move
with the air and with a white noise of their own, and grow:

    x   <- x + v(x, t) dt + rise dt + s sqrt(dt) N(0, 1)^3        sigma^2 = sigma0^2 + gamma age
    c(x) = sum_i m / ((2 pi)^{3/2} sigma_i^3) exp( -d_i^2 / (2 sigma_i^2) )

m is the content, the integral of the concentration of one filament. It follows from the concentration at the centre
of a fresh filament, m = c0 (2 pi)^{3/2} sigma0^3 (GADEN's n_f = 1e-6 ppm0 n_air (2 pi)^{3/2} sigma0^3 mol, n_air = P
/ (R T)), or from a release rate q in g/s: m = q / N in g, and 1e6 q / (N M n_air) in ppm m^3.

Deviations from GADEN. Noise: GADEN draws N(0, noise_std) m *per step*, so that its plume depends on the step; here it
is per square root of time, and `diffusion` = noise_std / sqrt(step) is the same at the published step
(`diffusion_of`). What the cut-off takes from a filament is given back to the rest, so that mass is kept (0.1 % at 4
sigma; GADEN loses it). Filaments released in a tick are spread over it. A blocked move slides along the wall, where
GADEN's stays. GADEN's buoyancy formula is dimensionally inconsistent: `rise` is a plain velocity, and off. `max_age`
ends what has not left by then, and so bounds the number of filaments, in still air too. Other readings of the Farrell
model: the kernel exp(-d^2 / w^2) of the Webots plugin has sigma0 = w / sqrt(2), and A / (sqrt(8 pi^3) w^3) at the
centre; its noise of sigma dt in a step dt is `diffusion` = sigma sqrt(dt) (0.3 at 1/30 s: 0.055).

Defaults: MUC-OSL Table 1 (GADEN), white noise "0.5 m" read as GADEN's noise_std at the step of 0.5 s.
"""

from __future__ import annotations

import math
import warnings
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from osl_env.arena import Arena
from osl_env.geometry import Geometry
from osl_env.parameters import FloatArray, quantity
from osl_env.plumes.base import PlumeModel, Scene
from osl_env.plumes.downwash import Downwash, no_wake
from osl_env.plumes.emission import GAS_CONSTANT
from osl_env.plumes.filament_blocks import AGE, CONTENT, SLOTS, VARIANCE, FilamentState, X, Z, empty_state
from osl_env.plumes.filament_motion import MERGE, OLDEST, REFUSE, Law, advance_worlds, clear_worlds
from osl_env.plumes.filament_reading import Optics, optics, read_points, read_worlds
from osl_env.plumes.filament_walls import ABSORB, OPEN, REFLECT
from osl_env.state import BoolArray, IntArray

_FLOORS = {"reflect": REFLECT, "absorb": ABSORB, "open": OPEN}
_POLICIES = {"refuse": REFUSE, "oldest": OLDEST, "merge": MERGE}
_MOST = 20_000_000  # filaments a world: half a gigabyte


def diffusion_of(noise_std: float, step: float) -> float:
    """The `diffusion`, m/s^0.5, with the spread of a noise of `noise_std` m in every `step` s (GADEN's)."""
    return noise_std / math.sqrt(step)


def _solids(geometry: Geometry) -> Geometry | None:
    """`geometry`, or None if there is nothing in it: the kernels have a form without walls."""
    return geometry if geometry.boxes.size or geometry.cylinders.size or geometry.cells.size else None


class Filaments(NamedTuple):
    """The live filaments of a world, for playback and exports."""

    positions: FloatArray  # (n, 3) m
    sigmas: FloatArray  # (n,) m
    contents: FloatArray  # (n,) unit m^3
    ages: FloatArray  # (n,) s


class FilamentPlume(PlumeModel):
    """A filament plume; the strength of a source scales the content of its filaments."""

    measures: ClassVar[Literal["hit_rate", "concentration"]] = "concentration"

    kind: Literal["filament"] = "filament"
    gas_unit: Literal["ppm", "g/m^3"] = "ppm"  # of the readings
    centre_concentration: float | None = quantity(None, "", gt=0)  # of a fresh filament, in gas_unit; default: 100
    release_rate: float | None = quantity(None, "g/s", gt=0)  # instead: of a source with strength 1
    molar_mass: float = quantity(46.07, "g/mol", gt=0)  # of the gas (ethanol); ppm from g/s
    temperature: float = quantity(298.0, "K", gt=0)
    pressure: float = quantity(101325.0, "Pa", gt=0)
    filament_rate: float = quantity(50.0, "1/s", gt=0)  # of every source
    sigma: float = quantity(0.5, "m", gt=0)  # sigma0
    growth: float = quantity(0.005, "m^2/s", ge=0)  # gamma, of sigma^2
    diffusion: float = quantity(diffusion_of(0.5, 0.5), "m/s^0.5", ge=0)  # s: diffusivity s^2 / 2
    rise: float = quantity(0.0, "m/s")  # buoyancy, upwards
    step: float = quantity(0.5, "s", gt=0)  # of the update
    development: float = quantity(0.0, "s", ge=0)  # of the plume before an episode
    cut_off: float = quantity(4.0, "", ge=3, le=5)  # in sigma
    floor: Literal["reflect", "absorb", "open"] = "reflect"  # at z = 0; open: like the other bounds
    margin: float = quantity(0.0, "m", ge=0)  # filaments live on so far outside the arena's open bounds
    line_of_sight: bool = True  # walls hide filaments
    max_age: float = quantity(300.0, "s", infinite=True, gt=0)
    capacity: int | None = Field(default=None, ge=1)  # filaments in a world; by default enough for max_age
    when_full: Literal["refuse", "oldest", "merge"] = "refuse"  # a capacity that may not suffice; the other two act
    downwash: Downwash | None = None  # of the UAVs

    @model_validator(mode="after")
    def _consistent(self) -> FilamentPlume:
        if self.centre_concentration is not None and self.release_rate is not None:
            raise ValueError(
                f"release_rate = {self.release_rate}: centre_concentration = {self.centre_concentration} is given as"
                " well; one of the two sets the strength"
            )
        if math.isinf(self.max_age) and (self.capacity is None or self.when_full == "refuse"):
            raise ValueError("max_age = inf: needs a capacity, and when_full = oldest or merge")
        return self

    @property
    def unit(self) -> str:
        """Of a concentration: ppm (by volume) or g/m^3."""
        return self.gas_unit

    @property
    def summary(self) -> str:
        """How much is released, and in how many filaments."""
        released = (
            f"{self.content / ((2.0 * math.pi) ** 1.5 * self.sigma**3):g} {self.gas_unit} at the centre"
            if self.release_rate is None
            else f"{self.release_rate:g} g/s"
        )
        return f"{self.filament_rate:g} filaments/s, {released}"

    @property
    def tick(self) -> float:
        """s between two updates."""
        return self.step

    @property
    def lead_time(self) -> float:
        """s of development before an episode."""
        return self.development

    @property
    def air_density(self) -> float:
        """n_air, mol/m^3, of an ideal gas."""
        return self.pressure / (GAS_CONSTANT * self.temperature)

    @property
    def content(self) -> float:
        """m, in gas_unit m^3: the integral of the concentration of one filament."""
        if self.release_rate is None:
            centre = 100.0 if self.centre_concentration is None else self.centre_concentration
            return float(centre * (2.0 * math.pi) ** 1.5 * self.sigma**3)
        grams = self.release_rate / self.filament_rate
        return grams if self.gas_unit == "g/m^3" else 1e6 * grams / (self.molar_mass * self.air_density)

    @property
    def moles(self) -> float:
        """n_f, mol of gas in one filament."""
        if self.gas_unit == "g/m^3":
            return self.content / self.molar_mass
        return 1e-6 * self.content * self.air_density

    def axis_mean(self, distance: float, speed: float) -> float:
        """Q / (2 pi (V sigma0^2 + (s^2 + gamma) x)): a Gaussian plume that begins with the filaments' size."""
        spread = speed * self.sigma**2 + (self.diffusion**2 + self.growth) * distance
        return self.filament_rate * self.content / (2.0 * math.pi * spread) if spread > 0.0 else math.inf

    def need(self, n_sources: int) -> int:
        """Filaments that a world can hold at most, by rate and max_age."""
        return n_sources * (math.ceil(self.filament_rate * (self.max_age + self.step)) + 2)

    def room(self, n_sources: int) -> int:
        """Filaments for which a world has room."""
        return self.need(n_sources) if self.capacity is None else self.capacity

    def check(self, arena: Arena, n_sources: int) -> None:
        """Refuse a capacity that may not suffice (or never does), and one that no machine holds."""
        rates = f"{n_sources} source(s) of {self.filament_rate:g} filaments/s"
        if self.capacity is not None and self.when_full == "refuse" and self.capacity < self.need(n_sources):
            raise ValueError(
                f"capacity = {self.capacity}: {rates} within max_age = {self.max_age:g} s are up to"
                f" {self.need(n_sources)} filaments; raise it, or set when_full to oldest or merge"
            )
        least = n_sources * (math.ceil(self.filament_rate * self.step) + 1)
        if self.capacity is not None and self.capacity < 2 * least:
            raise ValueError(
                f"capacity = {self.capacity}: {rates} need at least {2 * least}, two ticks of {self.step:g} s"
            )
        if self.room(n_sources) > _MOST:
            raise ValueError(
                f"max_age = {self.max_age:g}: {rates} are up to {self.room(n_sources)} filaments; at most {_MOST} are"
                " allowed: lower it, or set a capacity"
            )

    def law(self) -> Law:
        """The parameters of the motion, in the kernels' form."""
        return Law(
            self.step,
            self.filament_rate,
            self.content,
            self.sigma**2,
            self.growth,
            self.diffusion,
            self.rise,
            self.max_age,
            self.margin,
            _FLOORS[self.floor],
            _POLICIES[self.when_full],
            no_wake() if self.downwash is None else self.downwash.wake,
        )

    def optics(self) -> Optics:
        """The parameters of a reading, in the kernels' form."""
        return optics(self.cut_off, self.floor == "reflect")

    def _screens(self, scene: Scene) -> Geometry | None:
        """What hides filaments."""
        return _solids(scene.geometry) if self.line_of_sight else None

    def allocate(self, n_envs: int, n_sources: int, arena: Arena) -> FilamentState:
        """Clean air in `n_envs` worlds."""
        return empty_state(n_envs, n_sources, self.room(n_sources))

    def begin(self, state: FilamentState, scene: Scene, rows: IntArray, seeds: IntArray) -> None:
        """Clean air in the worlds `rows` for the episodes with `seeds`."""
        clear_worlds(state, np.asarray(rows, np.int64), np.asarray(seeds, np.int64))

    def advance(self, state: FilamentState, scene: Scene, due: BoolArray) -> None:
        """One tick. Warns (RuntimeWarning) if filaments had to be dropped or merged; the state counts them."""
        sources = np.ascontiguousarray(scene.sources)  # one layout to compile for
        strengths, uavs = np.ascontiguousarray(scene.strengths), np.ascontiguousarray(scene.positions)
        law, solids = self.law(), _solids(scene.geometry)
        lost = advance_worlds(state, sources, strengths, scene.air, solids, scene.area, uavs, due, law)
        if lost:
            text = (
                f"plume.capacity = {self.capacity} is full: {lost} filaments gave room (when_full = {self.when_full})"
            )
            warnings.warn(text, RuntimeWarning, stacklevel=2)

    def read(self, state: FilamentState, scene: Scene, positions: FloatArray, due: BoolArray, out: FloatArray) -> None:
        """The concentration, in gas_unit, at `positions`, into `out`; see `PlumeModel.read`."""
        read_worlds(state, self._screens(scene), self.optics(), np.ascontiguousarray(positions), due, out)

    def at(self, state: FilamentState, scene: Scene, env: int, points: FloatArray) -> FloatArray:
        """The concentration, in gas_unit, of world `env` at `points` (.., 3) m."""
        places = np.ascontiguousarray(points, dtype=np.float64)
        out = np.empty(places.size // 3)
        read_points(state, self._screens(scene), self.optics(), env, places.reshape(-1, 3), out)
        return out.reshape(places.shape[:-1])

    def filaments(self, state: FilamentState, env: int) -> Filaments:
        """The live filaments of world `env`, as they are now (copies)."""
        bodies = state.bodies[env, :, : int(state.tallies[env, SLOTS])]
        live: Any = bodies[:, bodies[CONTENT] > 0.0].astype(np.float64)
        return Filaments(live[X : Z + 1].T.copy(), np.sqrt(live[VARIANCE]), live[CONTENT], live[AGE])
