"""State -> what one UAV may know: the only gate between the world and its policies.

One definition (`ObservationLayout`) lists every quantity with its size, unit and scale. From it come the physical
`Observation` of the scripted policies and the flat, normalised vector in [-1, 1] of the learned ones: no quantity is
in one that is not derived from the other. The source's position is not among them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from osl_env.parameters import FloatArray
from osl_env.scenario import Scenario
from osl_env.state import DETECTION_MEMORY, BoolArray, IntArray, StateArray

_K = DETECTION_MEMORY
_DETECTION_SIZE = 6  # mask, age, offset (3), reading
_NEIGHBOUR_SIZE = 7  # mask, offset (3), reading, sampling time, age
_HEAD_SIZE = 17
_DETECTIONS_END = _HEAD_SIZE + _K * _DETECTION_SIZE
_BLOCK = 32  # UAVs whose rows are written before they are normalised
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
    reading: float  # the last sample: hits (a count) or concentration, by the plume's kind
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

    def __init__(self, scenario: Scenario) -> None:
        """Lay out the observation of `scenario`: it depends on the number of neighbours, scales on area and budgets."""
        self.n_neighbours = scenario.n_neighbours
        self.fields = _fields(scenario, self.n_neighbours)
        self.size = sum(field.size for field in self.fields)  # of a physical row
        flat = [field for field in self.fields if field.normalised != "no"]
        self.flat_size = sum(field.size for field in flat)  # of the flat vector: the row's first columns
        columns = []
        for field in flat:
            linear = field.normalised == "linear"
            scales = list(field.scale) * (field.size // len(field.scale))
            columns += [(x, field.offset, 0.0, 1.0) if linear else (1.0, 0.0, 1.0, x) for x in scales]
        # (4, _BLOCK * flat_size), the same for each of _BLOCK rows; both normalisations are one branch-free formula:
        # (x * gain + offset) / (|x| * bend + base)
        self._transform = np.ascontiguousarray(np.tile(np.array(columns, dtype=np.float32).T, _BLOCK))
        self._to_all = scenario.radio.reaches_all
        area = scenario.arena.size
        self._numbers = np.array([*area, scenario.energy.capacity, scenario.ending.time_limit])

    def physical(self, world: Any) -> FloatArray:
        """The physical rows of every UAV: (n_envs, n_uavs, size)."""
        rows = np.empty((*world.motion.shape, self.size))
        _physical(
            world.motion, world.ledger, world.senses, world.heard, world.episode,
            self._numbers, self.n_neighbours, self._to_all, rows,
        )  # fmt: skip
        return rows

    def flat(self, world: Any, out: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        """The normalised vectors of every UAV, in [-1, 1]: (n_envs, n_uavs, flat_size) float32."""
        if out is None:
            out = np.empty((*world.motion.shape, self.flat_size), dtype=np.float32)
        _flat(
            world.motion, world.ledger, world.senses, world.heard, world.episode,
            self._numbers, self.n_neighbours, self._to_all, self._transform, out,
        )  # fmt: skip
        return out

    def observation(self, row: FloatArray) -> Observation:
        """The Observation that a physical row (size,) holds. Its arrays are views of the row."""
        detections = row[_HEAD_SIZE:_DETECTIONS_END].reshape(_K, _DETECTION_SIZE)
        clock_at = _DETECTIONS_END + self.n_neighbours * _NEIGHBOUR_SIZE
        neighbours = row[_DETECTIONS_END:clock_at].reshape(self.n_neighbours, _NEIGHBOUR_SIZE)
        ready, reading, sampling_time, energy_left, time_left = row[12:_HEAD_SIZE].tolist()
        return Observation(
            time=float(row[clock_at]),
            decision=int(row[clock_at + 1]),
            ready=ready > 0.0,
            position=row[0:3],
            velocity=row[6:9],
            wind=row[9:12],
            reading=reading,
            sampling_time=sampling_time,
            energy_left=energy_left,
            time_left=time_left,
            detection_mask=detections[:, 0] > 0.0,
            detection_age=detections[:, 1],
            detection_offset=detections[:, 2:5],
            detection_reading=detections[:, 5],
            neighbour_mask=neighbours[:, 0] > 0.0,
            neighbour_id=row[clock_at + 2 :].astype(np.int64),
            neighbour_offset=neighbours[:, 1:4],
            neighbour_reading=neighbours[:, 4],
            neighbour_sampling_time=neighbours[:, 5],
            neighbour_age=neighbours[:, 6],
        )


def _fields(scenario: Scenario, n_neighbours: int) -> list[Field]:
    """Every quantity in the order of the physical row. `_write_row` below fills exactly this."""
    area = scenario.arena.size
    side = 1.0 / max(area)
    to_unit = tuple(2.0 / length for length in area)
    detection = [
        Field("detection_mask", 1, "", "1 if there is such a detection", "linear"),
        Field("detection_age", 1, "s", "since that detection", "rational", (AGE_SCALE,)),
        Field("detection_offset", 3, "m", "where it was, relative to the UAV", "linear", (side,)),
        Field("detection_reading", 1, "hits", "what it read", "rational", (READING_SCALE,)),
    ]
    neighbour = [
        Field("neighbour_mask", 1, "", "1 if there is such a neighbour", "linear"),
        Field("neighbour_offset", 3, "m", "where it was when it sent, relative to the UAV", "linear", (side,)),
        Field("neighbour_reading", 1, "hits", "its last sample", "rational", (READING_SCALE,)),
        Field("neighbour_sampling_time", 1, "s", "of that sample", "rational", (SAMPLING_SCALE,)),
        Field("neighbour_age", 1, "s", "since it sent", "rational", (AGE_SCALE,)),
    ]
    return [
        Field("position", 3, "m", "in the area", "linear", to_unit, -1.0),
        Field("area", 3, "m", "sides of the search volume", "rational", (AREA_SCALE,)),
        Field("velocity", 3, "m/s", "zero between legs", "linear", (1.0 / scenario.vehicle.speed,)),
        Field("wind", 3, "m/s", "measured by the anemometer", "rational", (WIND_SCALE,)),
        Field("ready", 1, "", "1 when the UAV decides now", "linear"),
        Field("reading", 1, "hits", "of the last sample", "rational", (READING_SCALE,)),
        Field("sampling_time", 1, "s", "of the last sample", "rational", (SAMPLING_SCALE,)),
        Field("energy_left", 1, "J", "in the battery", "linear", (1.0 / scenario.energy.capacity,)),
        Field("time_left", 1, "s", "of search time", "linear", (1.0 / scenario.ending.time_limit,)),
        *(detection * _K),
        *(neighbour * n_neighbours),
        Field("time", 1, "s", "mission clock", "no"),
        Field("decision", 1, "", "decisions taken so far", "no"),
        Field("neighbour_id", n_neighbours, "", "the neighbours' UAV numbers, -1 where there is none", "no"),
    ]


@njit(inline="always", error_model="numpy")
def _write_row(motion: Any, ledger: Any, senses: Any, clock: float, numbers: Any, row: Any, extra: Any) -> None:
    """The physical row of one UAV, without its neighbours."""
    for axis in range(3):
        row[axis] = motion.position[axis]
        row[3 + axis] = numbers[axis]
        row[6 + axis] = motion.velocity[axis]
        row[9 + axis] = senses.wind[axis]
    row[12] = 1.0 if motion.active and motion.ready else 0.0
    row[13] = senses.reading
    row[14] = senses.sampling_time
    row[15] = max(0.0, numbers[3] - ledger.spent)
    row[16] = max(0.0, numbers[4] - ledger.search_time)
    extra[0] = clock
    extra[1] = float(ledger.decisions)
    at = _HEAD_SIZE
    for k in range(_K):
        if k < senses.detections:
            row[at] = 1.0
            row[at + 1] = clock - senses.detection_time[k]
            for axis in range(3):
                row[at + 2 + axis] = senses.detection_position[k, axis] - motion.position[axis]
            row[at + 5] = senses.detection_reading[k]
        else:
            for column in range(_DETECTION_SIZE):
                row[at + column] = 0.0
        at += _DETECTION_SIZE


@njit(inline="always", error_model="numpy")
def _squared(dx: Any, dy: Any, dz: Any) -> Any:
    """Squared distance in single precision: both forms of an observation must order their neighbours alike."""
    u, v, w = np.float32(dx), np.float32(dy), np.float32(dz)
    return u * u + v * v + w * w


@njit(inline="always", error_model="numpy")
def _write_neighbours(
    motion: Any,
    senses: Any,
    heard: Any,
    to_all: bool,
    e: int,
    own: int,
    clock: float,
    n_neighbours: int,
    row: Any,
    extra: Any,
) -> None:
    """The neighbour table of UAV `own` of world `e`: the nearest heard ones, by insertion into the table."""
    position = motion[e, own].position
    count = 0
    for j in range(motion.shape[1] if n_neighbours > 0 else 0):
        if j == own or (not to_all and not heard[e, own, j].known):
            continue
        sent = motion[e, j].position if to_all else heard[e, own, j].position
        dx, dy, dz = sent[0] - position[0], sent[1] - position[1], sent[2] - position[2]
        squared = _squared(dx, dy, dz)
        slot = count
        while slot > 0:
            at = _DETECTIONS_END + (slot - 1) * _NEIGHBOUR_SIZE
            if _squared(row[at + 1], row[at + 2], row[at + 3]) <= squared:
                break
            if slot < n_neighbours:
                for column in range(_NEIGHBOUR_SIZE):
                    row[at + _NEIGHBOUR_SIZE + column] = row[at + column]
                extra[2 + slot] = extra[1 + slot]
            slot -= 1
        if slot < n_neighbours:
            at = _DETECTIONS_END + slot * _NEIGHBOUR_SIZE
            row[at], row[at + 1], row[at + 2], row[at + 3] = 1.0, dx, dy, dz
            if to_all:
                row[at + 4], row[at + 5] = senses[e, j].reading, senses[e, j].sampling_time
                row[at + 6] = clock - senses[e, j].sent_time
            else:
                frame = heard[e, own, j]
                row[at + 4], row[at + 5], row[at + 6] = frame.reading, frame.sampling_time, clock - frame.time
            extra[2 + slot] = float(j)
        count = min(count + 1, n_neighbours)
    for slot in range(count, n_neighbours):
        at = _DETECTIONS_END + slot * _NEIGHBOUR_SIZE
        for column in range(_NEIGHBOUR_SIZE):
            row[at + column] = 0.0
        extra[2 + slot] = -1.0


@njit(cache=True, error_model="numpy")
def _physical(
    motion: StateArray,
    ledger: StateArray,
    senses: StateArray,
    heard: StateArray,
    episode: StateArray,
    numbers: FloatArray,
    n_neighbours: int,
    to_all: bool,
    rows: FloatArray,
) -> None:
    n_envs, n_uavs = motion.shape
    width = rows.shape[2] - 2 - n_neighbours
    for e in range(n_envs):
        clock = episode[e].clock
        for i in range(n_uavs):
            row, extra = rows[e, i, :width], rows[e, i, width:]
            _write_row(motion[e, i], ledger[e, i], senses[e, i], clock, numbers, row, extra)
            _write_neighbours(motion, senses, heard, to_all, e, i, clock, n_neighbours, row, extra)


@njit(cache=True, error_model="numpy")
def _flat(
    motion: StateArray,
    ledger: StateArray,
    senses: StateArray,
    heard: StateArray,
    episode: StateArray,
    numbers: FloatArray,
    n_neighbours: int,
    to_all: bool,
    transform: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """Rows in blocks of UAVs, then their normalisation in one long loop over the block, which vectorises."""
    n_uavs = motion.shape[1]
    n, width = motion.size, out.shape[2]
    flat = out.reshape(-1)
    rows = np.zeros((min(_BLOCK, n), width), dtype=np.float32)
    numbers_of_row = rows.reshape(-1)
    extra = np.zeros(2 + n_neighbours, dtype=np.float32)
    gain, offset, bend, base = transform[0], transform[1], transform[2], transform[3]
    one = np.float32(1.0)
    e, i = 0, 0
    for start in range(0, n, _BLOCK):
        count = min(_BLOCK, n - start)
        for b in range(count):
            clock, row = episode[e].clock, rows[b]
            _write_row(motion[e, i], ledger[e, i], senses[e, i], clock, numbers, row, extra)
            _write_neighbours(motion, senses, heard, to_all, e, i, clock, n_neighbours, row, extra)
            i += 1
            if i == n_uavs:
                e, i = e + 1, 0
        normalised = flat[start * width : (start + count) * width]
        for k in range(normalised.size):
            x = numbers_of_row[k]
            y = (x * gain[k] + offset[k]) / (abs(x) * bend[k] + base[k])
            normalised[k] = min(max(y, -one), one)
