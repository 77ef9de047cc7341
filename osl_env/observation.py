"""State -> what one UAV may know: the only gate between the world and its policies.

One definition (`ObservationLayout`) lists every quantity with its size, unit and scale. From it come the physical
`Observation` of the scripted policies and the flat, normalised vector in [-1, 1] of the learned ones: no quantity is
in one that is not derived from the other. The source's position is not among them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from osl_env.observation_rows import (
    BLOCK,
    DETECTION_SIZE,
    DETECTIONS_END,
    HEAD_SIZE,
    NEIGHBOUR_SIZE,
    write_flat,
    write_physical,
)
from osl_env.parameters import FloatArray
from osl_env.scenario import Scenario
from osl_env.state import DETECTION_MEMORY, BoolArray, IntArray

_K = DETECTION_MEMORY
AREA_SCALE, WIND_SCALE, READING_SCALE, SAMPLING_SCALE, AGE_SCALE = 100.0, 2.0, 5.0, 5.0, 60.0  # m, m/s, 1, s, s


class Field(NamedTuple):
    """One quantity of an observation: where it stands in the physical row, and how it is normalised."""

    name: str
    size: int
    unit: str
    meaning: str
    normalised: str  # "no": physical only; "linear": x * scale + offset; "rational": x / (|x| + scale)
    scale: tuple[float, ...] = (1.0,)
    offset: float = 0.0


@dataclass(slots=True)
class Observation:
    """What one UAV may know at a decision, in physical units. K = 3 detections are kept; M neighbours at most.

    Absent entries (no such detection, no such neighbour) are masked and hold zeros.
    """

    time: float  # s, mission clock
    decision: int  # decisions taken so far; 0 at the first observation
    ready: bool  # False while a leg is still being flown (event clock)
    position: FloatArray  # (3,) m
    velocity: FloatArray  # (3,) m/s; zero between legs
    wind: FloatArray  # (3,) m/s, as measured by the anemometer
    reading: float  # the last sample: hits (a count) or a concentration, as the gas sensor reports
    sampling_time: float  # s, over which the hits were counted; 0 if nothing has been sampled yet
    energy_left: float  # J
    time_left: float  # s of search time
    detection_mask: BoolArray  # (K,) latest first
    detection_age: FloatArray  # (K,) s since that detection
    detection_offset: FloatArray  # (K, 3) m, where it was, relative to the UAV
    detection_reading: FloatArray  # (K,)
    neighbour_mask: BoolArray  # (M,) heard by radio; nearest first
    neighbour_id: IntArray  # (M,) its UAV number, -1 where masked
    neighbour_offset: FloatArray  # (M, 3) m, where it was when it sent, relative to the UAV
    neighbour_reading: FloatArray  # (M,)
    neighbour_sampling_time: FloatArray  # (M,) s
    neighbour_age: FloatArray  # (M,) s since it was sent
    ranges: FloatArray  # (R,) m, the free distance along each ray of the range sensors

    @property
    def detection_position(self) -> FloatArray:
        """(K, 3) m: where the remembered detections were."""
        return self.position + self.detection_offset

    @property
    def neighbour_position(self) -> FloatArray:
        """(M, 3) m: where the neighbours were when they sent."""
        return self.position + self.neighbour_offset


class ObservationLayout:
    """The definition of a scenario's observations: fields, sizes and scales; makes both forms from a world's state."""

    def __init__(self, scenario: Scenario, reading_scale: float | None = None) -> None:
        """Lay out the observation of `scenario`: its size depends on the numbers of neighbours and of range sensors,
        its scales on the area and the budgets, and on the gas sensor unless `reading_scale` is given.
        """
        self.n_neighbours, self.n_rays = scenario.n_neighbours, scenario.range_sensors.count
        scale = float(scenario.gas_sensor.scale) if reading_scale is None else reading_scale
        self.fields = _fields(scenario, self.n_neighbours, scale)
        self.size = sum(field.size for field in self.fields)  # of a physical row
        flat = [field for field in self.fields if field.normalised != "no"]
        self.flat_size = sum(field.size for field in flat)  # of the flat vector: the row's first columns
        columns = []
        for field in flat:
            linear = field.normalised == "linear"
            scales = list(field.scale) * (field.size // len(field.scale))
            columns += [(x, field.offset, 0.0, 1.0) if linear else (1.0, 0.0, 1.0, x) for x in scales]
        # (4, BLOCK * flat_size), the same for each of BLOCK rows; both normalisations are one branch-free formula:
        # (x * gain + offset) / (|x| * bend + base)
        self._transform = np.ascontiguousarray(np.tile(np.array(columns, dtype=np.float32).T, BLOCK))
        self._to_all = scenario.hears_all
        area = scenario.arena.size
        self._numbers = np.array([*area, scenario.energy.capacity, scenario.ending.time_limit])

    def physical(self, world: Any) -> FloatArray:
        """The physical rows of every UAV: (n_envs, n_uavs, size)."""
        rows = np.empty((*world.motion.shape, self.size))
        write_physical(
            world.motion, world.ledger, world.senses, world.heard, world.contacts, world.episode, world.ranges,
            self._numbers, self.n_neighbours, self._to_all, rows,
        )  # fmt: skip
        return rows

    def flat(self, world: Any, out: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        """The normalised vectors of every UAV, in [-1, 1]: (n_envs, n_uavs, flat_size) float32."""
        if out is None:
            out = np.empty((*world.motion.shape, self.flat_size), dtype=np.float32)
        write_flat(
            world.motion, world.ledger, world.senses, world.heard, world.contacts, world.episode, world.ranges,
            self._numbers, self.n_neighbours, self._to_all, self._transform, out,
        )  # fmt: skip
        return out

    def observation(self, row: FloatArray) -> Observation:
        """The Observation that a physical row (size,) holds. Its arrays are views of the row."""
        return Observation(*self.values(row[None])[0])

    def values(self, rows: FloatArray) -> list[tuple[Any, ...]]:
        """The fields, in order, of the Observations that physical `rows` (n, size) hold: much of the work is shared."""
        detections = rows[:, HEAD_SIZE:DETECTIONS_END].reshape(len(rows), _K, DETECTION_SIZE)
        neighbours_end = DETECTIONS_END + self.n_neighbours * NEIGHBOUR_SIZE
        clock_at = neighbours_end + self.n_rays
        neighbours = rows[:, DETECTIONS_END:neighbours_end].reshape(len(rows), self.n_neighbours, NEIGHBOUR_SIZE)
        head, end = rows[:, 13:HEAD_SIZE].T.tolist(), rows[:, clock_at : clock_at + 2]
        return list(
            zip(
                end[:, 0].tolist(),  # time
                end[:, 1].astype(np.int64).tolist(),
                (rows[:, 12] > 0.0).tolist(),  # ready
                rows[:, 0:3],
                rows[:, 6:9],
                rows[:, 9:12],  # wind
                *head,  # reading, sampling time, energy and time left
                detections[:, :, 0] > 0.0,
                detections[:, :, 1],
                detections[:, :, 2:5],
                detections[:, :, 5],
                neighbours[:, :, 0] > 0.0,
                rows[:, clock_at + 2 :].astype(np.int64),
                neighbours[:, :, 1:4],
                neighbours[:, :, 4],
                neighbours[:, :, 5],
                neighbours[:, :, 6],
                rows[:, neighbours_end:clock_at],
                strict=True,
            )
        )


def _fields(scenario: Scenario, n_neighbours: int, reading_scale: float) -> list[Field]:
    """Every quantity in the order of the physical row. The kernels of `observation_rows` fill exactly this."""
    area = scenario.arena.size
    side = 1.0 / max(area)
    unit = "hits" if scenario.reports == "hits" else scenario.plume.unit
    sees = scenario.range_sensors
    to_unit = tuple(2.0 / length for length in area)
    detection = [
        Field("detection_mask", 1, "", "1 if there is such a detection", "linear"),
        Field("detection_age", 1, "s", "since that detection", "rational", (AGE_SCALE,)),
        Field("detection_offset", 3, "m", "where it was, relative to the UAV", "linear", (side,)),
        Field("detection_reading", 1, unit, "what it read", "rational", (reading_scale,)),
    ]
    neighbour = [
        Field("neighbour_mask", 1, "", "1 if there is such a neighbour", "linear"),
        Field("neighbour_offset", 3, "m", "where it was when it sent, relative to the UAV", "linear", (side,)),
        Field("neighbour_reading", 1, unit, "its last sample", "rational", (reading_scale,)),
        Field("neighbour_sampling_time", 1, "s", "of that sample", "rational", (SAMPLING_SCALE,)),
        Field("neighbour_age", 1, "s", "since it sent", "rational", (AGE_SCALE,)),
    ]
    return [
        Field("position", 3, "m", "in the area", "linear", to_unit, -1.0),
        Field("area", 3, "m", "sides of the search volume", "rational", (AREA_SCALE,)),
        Field("velocity", 3, "m/s", "zero between legs", "linear", (1.0 / scenario.vehicle.speed,)),
        Field("wind", 3, "m/s", "measured by the anemometer", "rational", (WIND_SCALE,)),
        Field("ready", 1, "", "1 when the UAV decides now", "linear"),
        Field("reading", 1, unit, "of the last sample", "rational", (reading_scale,)),
        Field("sampling_time", 1, "s", "of the last sample", "rational", (SAMPLING_SCALE,)),
        Field("energy_left", 1, "J", "in the battery", "linear", (1.0 / scenario.energy.capacity,)),
        Field("time_left", 1, "s", "of search time", "linear", (1.0 / scenario.ending.time_limit,)),
        *(detection * _K),
        *(neighbour * n_neighbours),
        *(
            [Field("ranges", sees.count, "m", "free distance along each ray", "linear", (1.0 / sees.range,))]
            * bool(sees.count)
        ),
        Field("time", 1, "s", "mission clock", "no"),
        Field("decision", 1, "", "decisions taken so far", "no"),
        Field("neighbour_id", n_neighbours, "", "the neighbours' UAV numbers, -1 where there is none", "no"),
    ]
