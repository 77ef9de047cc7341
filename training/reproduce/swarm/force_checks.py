"""Whether the law's forces are what the paper's text describes: checks of the functions that the robots fly by.

Forces follow from formulas, so a check either holds in every place tried, to rounding, or it is contradicted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from baselines.swarm.law import LawParameters, cohesion_force, goal_vector, gradient, obstacle_force, odor_weight
from osl_env.geometry import Geometry, range_readings
from osl_env.parameters import FloatArray
from training.reproduce.claims import Finding

_ROUNDING = 1e-9  # relative
_NEAREST = 0.02  # m, of two robots: above the law's smallest distance
_TRIALS = 1000
_MAX_NEIGHBOURS = 12


@dataclass(frozen=True)
class Sensed:
    """Obstacle forces at places, by the range sensors of a scenario."""

    places: FloatArray  # (n, 3) m
    ranges: FloatArray  # (n, n_rays) m
    forces: FloatArray  # (n, 3) m/s


def radial(distances: FloatArray, law: LawParameters, weight: float = 1.0) -> FloatArray:
    """(n,) m/s, eq 5 towards a neighbour at `distances` (n,) m: positive pulls, negative pushes."""
    offset = np.zeros((distances.size, 3))
    offset[:, 0] = distances
    return np.asarray(cohesion_force(offset, weight, law)[:, 0])


def sensed(geometry: Geometry, area: FloatArray, places: FloatArray, n_rays: int, law: LawParameters) -> Sensed:
    """What eq 8 makes of the ranges at `places` (n, 3) m, in the arena with the far corner `area` (3,) m."""
    ranges = np.empty((1, len(places), n_rays))
    range_readings(geometry, area, places[None], n_rays, law.sensor_range, ranges)
    return Sensed(places, ranges[0], np.array([obstacle_force(row, law) for row in ranges[0]]))


def zones(law: LawParameters, delta_d: float, arena: str) -> Finding:
    """Repulsion below R1, nothing between, attraction beyond R2, up to delta_d, m, in one of the arenas."""
    near, far = law.repulsion_distance, law.attraction_distance
    distances = np.linspace(_NEAREST, delta_d, 2000)
    force = radial(distances, law)
    # on R1 and R2 themselves either side will do
    right = (
        bool(np.all(force[distances < near] < 0.0))
        and not np.any(force[(distances > near) & (distances < far)])
        and bool(np.all(force[distances > far] > 0.0))
    )
    ends = radial(np.array([0.5 * near, 0.5 * (near + far), delta_d]), law)
    ours = (
        f"{ends[0]:+.3g} m/s at R1 / 2, {ends[1]:.3g} between R1 = {near:g} and R2 = {far:g} m, "
        f"{ends[2]:+.3g} at {delta_d:g} m (positive pulls)"
    )
    claim = f"{arena}: robots nearer than R1 push each other apart, those beyond R2 pull, none between"
    return _decided(claim, right, ours)


def printed_zones(law: LawParameters) -> Finding:
    """The printed eq 5 does the opposite."""
    near, far = law.repulsion_distance, law.attraction_distance
    force = radial(np.array([0.5 * near, 1.5 * far]), law._replace(sign=-1.0))
    ours = f"{force[0]:+.3g} m/s at R1 / 2, {force[1]:+.3g} at 1.5 R2"
    return _decided("(ours) Eq 5 as printed does the opposite of the text", force[0] > 0.0 > force[1], ours)


def proportional(law: LawParameters) -> Finding:
    """Cohesion is proportional to q_j and to 1 / d^2; q_j to the neighbour's concentration."""
    far = law.attraction_distance * np.array([1.25, 2.5])
    whole, half = radial(far, law), radial(far, law, 0.5)
    weights = odor_weight(np.array([0.0, 0.25, 0.5, 1.0]) * 0.08, 0.08, law) / law.odor_gain
    right = np.allclose([*(half / whole), whole[0] / whole[1]], [0.5, 0.5, 4.0], rtol=_ROUNDING, atol=0.0)
    right &= np.allclose(weights, [0.0, 0.25, 0.5, 1.0], rtol=_ROUNDING, atol=_ROUNDING)
    ours = (
        f"half the odor: {half[0] / whole[0]:.3g} of the force; twice the distance: {whole[1] / whole[0]:.3g}; "
        f"half of Cmax: q = {weights[2]:.3g} beta"
    )
    return _decided("The neighbour's odor weighs the force: F ~ q_j / d^2", bool(right), ours)


def away_from_obstacles(near: Sensed, normals: FloatArray) -> Finding:
    """Beside each face the force points away from it: `normals` (n, 3), outwards, at the places of `near`."""
    outwards = np.sum(near.forces * normals, axis=1)
    ours = f"at {np.count_nonzero(outwards > 0.0)} of {outwards.size} places beside the obstacles' faces"
    return _decided("The obstacle force points away from the obstacle", bool(np.all(outwards > 0.0)), ours)


def obstacle_decay(approach: Sensed, normal: FloatArray, distances: FloatArray, law: LawParameters) -> Finding:
    """On the way to the middle of a face, at `distances` (n,) m, the force grows as 1 / d^n; along `normal` (3,)."""
    force = approach.forces @ normal
    slope = float(np.polyfit(np.log(distances), np.log(force), 1)[0])
    silent = obstacle_force(np.full(approach.ranges.shape[1], law.sensor_range), law)
    right = abs(slope + law.obstacle_exponent) < 1e-6 and not silent.any()
    ours = f"d^{slope:.3f} from {distances[0]:g} to {distances[-1]:g} m of a face; none where no ray meets anything"
    return _decided(f"The obstacle force falls as 1 / d^n, n = {law.obstacle_exponent:g}", right, ours)


def uphill(law: LawParameters, delta_d: float, seed: int = 0) -> Finding:
    """In a field that rises evenly the gradient never points down, wherever the neighbours are."""
    rng = np.random.default_rng(seed)
    slope = np.array([1.0, 0.0, 0.0])
    rises = []
    for _ in range(_TRIALS):
        angle, distance = (
            rng.uniform(0.0, 2.0 * np.pi, (n := int(rng.integers(1, _MAX_NEIGHBOURS)))),
            rng.uniform(_NEAREST, delta_d, n),
        )
        offset = np.stack([distance * np.cos(angle), distance * np.sin(angle), np.zeros(n)], axis=1)
        rises.append(float(gradient(offset, offset @ slope, 0.0) @ slope))
    alone = goal_vector(np.zeros((0, 3)), np.zeros(0), 0.0, np.array([0.5, 0.0, 0.0]), law)
    right = min(rises) > -_ROUNDING and np.allclose(alone, [-0.5 * law.wind_gain, 0.0, 0.0], rtol=_ROUNDING, atol=0.0)
    up = sum(rise > 0.0 for rise in rises)
    ours = f"up in {up} of {_TRIALS} random neighbourhoods; without neighbours upwind at {abs(alone[0]):g} m/s"
    return _decided("The goal vector points up the gradient, and upwind", bool(right), ours)


def _decided(claim: str, right: bool, ours: str) -> Finding:
    return Finding(claim, "holds" if right else "contradicted", ours)
