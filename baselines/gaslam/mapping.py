"""What one UAV knows of the gas and its source: the kernel map, the posterior of the source term, and their gas cells.

Parameters are stated for the paper's search volume of 7 x 2 x 0.5 m and its sensor's scale of 0 to 1000. With `adapt`
they are carried over to another area and sensor; without, they are taken as they stand:

    cells, bins   14 x 10 x 5, over the area
    lengths       times the cube root of the area's volume over the paper's: the kernel's width. Its stretching is a
                  time, the wind's, and stays: scaled, it made a kernel of eight metres for a plume of twenty
    sensor_scale  times the sensor's full scale over 1000; where it has none or counts hits, 10 times the highest mean
                  in the kernel map stand for it: sigma_E, 0.03 of the scale, is then 0.3 of that mean

The least mean that 2-means may call gas is the sensor's threshold (`minimum_gas`). A sensor that counts gives hits a
second. The plume lies along the mean of all that the anemometer has measured, the kernel of a reading along the wind
at that time. Of several UAVs that share, each enters what it hears into its own maps: the newest frame of each
neighbour, once.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from baselines.gaslam.cells import PAPER_SHAPE, Cells
from baselines.gaslam.final_map import final_map
from baselines.gaslam.gaseous import gaseous
from baselines.gaslam.kernel_map import KernelMap, KernelParameters
from baselines.gaslam.navigation import agreement
from baselines.gaslam.source_term import Posterior, SourceTerm, SourceTermParameters
from baselines.policy import Belief, Briefing, GasMap
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, Parameters, quantity
from osl_env.state import BoolArray

_PAPER_VOLUME = 7.0 * 2.0 * 0.5  # m^3
_PAPER_SCALE = 1000.0  # full scale of the paper's sensor
_SCALE_OF_HIGHEST = 10.0  # what stands for the full scale of a sensor without one, in highest means
_CELL_BITS = 32
_PICTURED = 500  # points of a belief for pictures


class MappingParameters(Parameters):
    """Parameters of the maps and of the posterior; mixed into the parameters of policies that map."""

    shape: tuple[int, int, int] = quantity(PAPER_SHAPE, "")  # cells along x, y, z
    kernel: KernelParameters = KernelParameters()
    source_term: SourceTermParameters = SourceTermParameters()
    adapt: bool = True  # to area and sensor
    used_cells: Literal["confident", "all"] = "confident"  # by the likelihood; of all, unknown ones read as zeros
    minimum_gas: float | None = quantity(None, "unit of the reading", ge=0)  # None: the sensor's threshold
    estimate: Literal["mean", "best"] = "mean"  # the posterior's, that is the guess of the source
    sharing: bool = True  # enter readings of others heard by radio into the own maps


def length_scale(briefing: Briefing, parameters: MappingParameters) -> float:
    """What lengths stated for the paper's volume are multiplied by in the area of `briefing`."""
    return (float(np.prod(briefing.area)) / _PAPER_VOLUME) ** (1.0 / 3.0) if parameters.adapt else 1.0


class Mapping:
    """The maps of one UAV and episode. After `estimate` they agree with each other, until the next reading."""

    def __init__(self, parameters: MappingParameters, briefing: Briefing) -> None:
        """Empty maps over the area of `briefing`. Raises InputError for cells that the area cannot have."""
        p = self._parameters = parameters
        scale, sensor = length_scale(briefing, p), briefing.gas_sensor
        self.cells = Cells(np.zeros(3), np.asarray(briefing.area, dtype=np.float64), p.shape)
        self.kernel = KernelMap(self.cells, p.kernel.model_copy(update={"width": scale * p.kernel.width}))
        self._counts = sensor.reports == "hits"
        self._floor = briefing.threshold if p.minimum_gas is None else p.minimum_gas
        full_scale = math.inf if self._counts else float(sensor.full_scale)
        self._share = full_scale / _PAPER_SCALE if p.adapt else 1.0  # of the stated sensor_scale; infinite: see above
        self._source_term = SourceTerm(self.cells, p.source_term)
        self._wind, self._n_winds = np.zeros(3), 0  # m/s, the sum of what was measured
        self._heard: dict[int, float] = {}  # s: when the newest frame of a UAV was sent
        self.others: FloatArray = np.empty((0, 3))  # (k, 3) m, where the others were when they were last heard
        self.posterior: Posterior | None = None
        self.plume: FloatArray = np.zeros(self.cells.n)  # of the likeliest source term, in the sensor's unit
        self.kernel_gas: BoolArray = np.zeros(self.cells.n, np.bool_)
        self.plume_gas: BoolArray = np.zeros(self.cells.n, np.bool_)
        self.alpha = 0.0  # (9)

    @property
    def wind(self) -> FloatArray:
        """(3,) m/s: the mean of what was measured."""
        return self._wind / max(self._n_winds, 1)

    @property
    def guess(self) -> FloatArray:
        """(3,) m: the source by the last estimate; the middle of the area before the first."""
        if self.posterior is None:
            return 0.5 * (self.cells.low + self.cells.high)
        return self.posterior.mean if self._parameters.estimate == "mean" else self.posterior.best[1:4]

    @property
    def bins(self) -> FloatArray:
        """(3,) m, sides of the posterior's bins."""
        return np.asarray((self.cells.high - self.cells.low) / np.array(self._parameters.source_term.bins))

    def take(self, observation: Observation) -> None:
        """Enter the reading of `observation`, and those heard in it, into the kernel map."""
        self._wind += observation.wind
        self._n_winds += 1
        self._enter(observation.position, observation.reading, observation.sampling_time, observation.wind)
        if self._parameters.sharing and observation.neighbour_mask.size:
            self._listen(observation)

    def _enter(self, position: FloatArray, reading: float, duration: float, wind: FloatArray) -> None:
        if duration > 0.0 and math.isfinite(reading):
            self.kernel.add(position, reading / duration if self._counts else reading, wind)

    def _listen(self, observation: Observation) -> None:
        known = np.flatnonzero(observation.neighbour_mask)
        self.others = observation.position + observation.neighbour_offset[known]
        for row, place in zip(known.tolist(), self.others, strict=True):
            sender, sent = int(observation.neighbour_id[row]), observation.time - float(observation.neighbour_age[row])
            if sent > self._heard.get(sender, -math.inf) + 1e-9:  # the age is rounded
                self._heard[sender] = sent
                reading, duration = observation.neighbour_reading[row], observation.neighbour_sampling_time[row]
                self._enter(place, float(reading), float(duration), observation.wind)

    def estimate(self, rng: np.random.Generator) -> float:
        """Sample the posterior anew and compare both maps; gives the bits of the cells gone through, 0 without any."""
        p, kernel = self._parameters, self.kernel
        measured, mean = kernel.measured, kernel.mean
        self.kernel_gas = gaseous(mean, self._floor, measured)
        use = measured if p.used_cells == "confident" else np.full(self.cells.n, kernel.n_readings > 0)
        if not use.any():
            return 0.0
        term, wind = self._scaled(float(mean.max())), self.wind
        self.posterior = term.sample(mean, use, wind, rng, self.posterior)
        self.plume = term.plume_map(self.posterior.best, wind)
        self.plume_gas = gaseous(self.plume, self._floor)
        self.alpha = agreement(self.kernel_gas, self.plume_gas)
        iterations = len(self.posterior.chain) + p.source_term.burn_in
        return float(_CELL_BITS * iterations * int(np.count_nonzero(use)))

    @property
    def sigma_e(self) -> float:
        """sigma_E in the reading's unit, of an estimate from the present readings."""
        return self._scaled(float(self.kernel.mean.max())).parameters.sigma_e

    def _scaled(self, highest: float) -> SourceTerm:
        """The source term on the sensor's scale, or on that of the `highest` mean in the map."""
        stated = self._parameters.source_term
        if self._share == 1.0:
            return self._source_term
        of_highest = _SCALE_OF_HIGHEST * highest / _PAPER_SCALE if highest > 0.0 else 1.0
        share = self._share if math.isfinite(self._share) else of_highest
        return SourceTerm(self.cells, stated.model_copy(update={"sensor_scale": share * stated.sensor_scale}))

    def final(self) -> FloatArray:
        """(n,) the final map by all readings so far, in the sensor's unit."""
        measured, mean = self.kernel.measured, self.kernel.mean
        return final_map(self.plume, mean, measured, gaseous(mean, self._floor, measured))

    def belief(self) -> Belief:
        """The posterior of the last estimate, the prior before the first, and the final map."""
        shape, size = self.cells.shape, self.cells.size
        gas = GasMap(self.cells.low.copy(), size.copy(), self.final().reshape(shape))
        if self.posterior is None:
            return Belief(self.guess, np.diag((self.cells.high - self.cells.low) ** 2 / 12.0), gas_map=gas)
        posterior = self.posterior
        rows = np.linspace(0, len(posterior.positions) - 1, min(_PICTURED, len(posterior.positions))).astype(np.int64)
        mean, covariance = posterior.mean.copy(), posterior.covariance.copy()
        return Belief(mean, covariance, posterior.positions[rows].copy(), gas_map=gas)
