"""What the agent goes by at one UAV's turn: features of each candidate goal, and their weighted sum. Compiled.

All lengths are in the wind's frame and squashed by x / (|x| + scale), so that areas of any size give the same range.

    score = reference + sum_k weight_k feature_k

The reference is the scripted rule: expected gain a second, relative to the best candidate's (0, and less for others),

    gain = h I(goal, dwell) + E|u - s| - E|goal - s|        over travel + dwell, s

with I the expected information, nats, and h `entropy_weight`, m a nat; without a trace only I counts, and the dwell is
what the way there leaves of `horizon`. The network gives the weights (`levers`), which are 0 at the beginning.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from baselines.search_agent.candidates import BELIEF, KINDS, N_CANDIDATES, NEIGHBOUR, SUPPORT, write_candidates
from baselines.search_agent.expectations import N_TERMS, discount, expected_spread, information, mean_counts, sum32
from osl_env.parameters import FloatArray

FEATURES = (
    "travel", "turns", "stays", "same_goal", "neighbour", "of_belief", "of_support", "information",
    "information_rate", "hit", "hit_rate", "leg_information", "leg_hit", "spread_change", "spread_rate", "nearer",
    "distance", "mass_near", "from_mean_along", "from_mean_across", "from_mean_up", "from_own_along",
    "from_own_across", "from_own_up", "from_other_goals", "nearer_than_others", "spreads_along", "off_axis",
    "off_level", "reference",
)  # fmt: skip
N_FEATURES = len(FEATURES)
_SAME = 1e-6  # m: no flight
_STRAIGHT = 1.0 - 1e-9  # cosine above which a leg needs no turn


@njit(inline="always", error_model="numpy")
def squash(x: float, scale: float) -> float:
    """x / (|x| + scale)."""
    return x / (abs(x) + scale)


@njit(cache=True, error_model="numpy")
def plan_leg(own: Any, heading: Any, goal: Any, s: Any, place: Any) -> tuple[int, bool]:
    """One leg towards `goal` under the setting `s`: its end in `place` (3,), m; (samples there, whether it turns)."""
    dx, dy, dz = goal[0] - own[0], goal[1] - own[1], goal[2] - own[2]
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    time, turns = s.leg_time, False
    place[0], place[1], place[2] = own[0], own[1], own[2]
    if distance > _SAME:
        cosine = (dx * heading[0] + dy * heading[1] + dz * heading[2]) / distance
        flown = heading[0] != 0.0 or heading[1] != 0.0 or heading[2] != 0.0
        turns = flown and cosine < _STRAIGHT
        if turns:
            time -= s.turn_time
        reach = max(time - s.sample, s.sample) * s.speed
        if reach < distance - 0.5 * s.speed * s.sample:
            share = reach / distance
            place[0], place[1], place[2] = own[0] + share * dx, own[1] + share * dy, own[2] + share * dz
            return 1, turns
        place[0], place[1], place[2] = goal[0], goal[1], goal[2]
        time -= distance / s.speed
    return min(max(round(time / s.sample), 1), s.most_samples), turns


@njit(error_model="numpy")
def _distance(a: Any, b: Any) -> float:
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return math.sqrt(x * x + y * y + z * z)


@njit(error_model="numpy")
def _mean_distance(x: Any, y: Any, z: Any, u: Any, weight: Any, room: Any) -> float:
    ux, uy, uz = np.float32(u[0]), np.float32(u[1]), np.float32(u[2])
    for i in range(x.size):
        dx, dy, dz = x[i] - ux, y[i] - uy, z[i] - uz
        room[i] = weight[i] * np.float32(math.sqrt(dx * dx + dy * dy + dz * dz))
    return sum32(room)


@njit(error_model="numpy")
def _mass_within(x: Any, y: Any, z: Any, u: Any, radius: float, room: Any) -> float:
    ux, uy, uz, limit = np.float32(u[0]), np.float32(u[1]), np.float32(u[2]), np.float32(radius * radius)
    for i in range(x.size):
        dx, dy, dz = x[i] - ux, y[i] - uy, z[i] - uz
        room[i] = np.float32(1.0) if dx * dx + dy * dy + dz * dz <= limit else np.float32(0.0)
    return float(sum32(room) / x.size)


@njit(inline="always", error_model="numpy")
def in_wind(a: Any, b: Any, along: Any) -> tuple[float, float, float]:
    """b - a, along, across and up."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    return x * along[0] + y * along[1], y * along[0] - x * along[1], z


@njit(error_model="numpy")
def _leave_to_others(mates: Any, b: int, i: int, x: Any, y: Any, z: Any, model: Any, weight: Any, room: Any,
                     dwell: float) -> None:  # fmt: skip
    """Make `weight` (P,), sum 1, the belief if the others in contact find nothing where they mean to sample."""
    weight[:] = np.float32(1.0 / weight.size)
    for j in range(mates.shape[1]):
        mate = mates[b, j]
        if j == i or not mate.known:
            continue
        if mate.planned:
            mean_counts(x, y, z, mate.place, mate.seconds, model, room)
            discount(weight, room)
        if not mate.planned or _distance(mate.place, mate.goal) > _SAME:
            mean_counts(x, y, z, mate.goal, dwell, model, room)
            discount(weight, room)
    scale = np.float32(1.0 / max(sum32(weight), 1e-20))
    for p in range(weight.size):
        weight[p] *= scale


@njit(error_model="numpy")
def _about_mean(x: Any, y: Any, z: Any, weight: Any, mean: Any, centred: Any, moments: Any, room: Any) -> float:
    """Places about `mean` and their squared lengths in `centred` (4, P), their sums in `moments` (5,); the spread."""
    mx, my, mz = np.float32(mean[0]), np.float32(mean[1]), np.float32(mean[2])
    for p in range(x.size):
        dx, dy, dz = x[p] - mx, y[p] - my, z[p] - mz
        centred[0, p], centred[1, p], centred[2, p] = dx, dy, dz
        centred[3, p] = dx * dx + dy * dy + dz * dz
    moments[0] = sum32(weight)
    for row in range(4):
        for p in range(x.size):
            room[p] = weight[p] * centred[row, p]
        moments[row + 1] = sum32(room)
    inverse = 1.0 / moments[0]
    squared = moments[1] ** 2 + moments[2] ** 2 + moments[3] ** 2
    return math.sqrt(max(moments[4] * inverse - squared * inverse * inverse, 0.0)) + 0.05


@njit(error_model="numpy")
def _write_features(situation: Any, mates: Any, b: int, i: int, s: Any, model: Any, support: Any, room: Any,
                    candidates: Any, rows: Any) -> None:  # fmt: skip
    """Candidates (K, 3), m, and their features `rows` (K, N_FEATURES), for UAV i of crew b. `room`: see `decide`."""
    weight, counts, terms, centred, small = room
    moments, along, spreads, place = small[0], small[1, :2], small[2, :3], small[3, :3]
    x, y, z = support[0], support[1], support[2]
    own, heading = mates[b, i].position, mates[b, i].heading
    wind_frame(situation, along, spreads)
    goal = mates[b, i].goal
    write_candidates(own, goal, along, situation.mean, spreads, support, s.area, situation.decision, candidates)
    ahead = 0.5 * s.horizon if situation.searching else s.dwell
    _leave_to_others(mates, b, i, x, y, z, model, weight, counts, ahead)
    spread = _about_mean(x, y, z, weight, situation.mean, centred, moments, counts)
    now_far = _mean_distance(x, y, z, own, weight, counts)
    best = 1e-9
    for k in range(candidates.shape[0]):
        goal, row = candidates[k], rows[k]
        samples, turns = plan_leg(own, heading, goal, s, place)
        travel = _distance(own, goal) / s.speed + (s.turn_time if turns else 0.0)
        dwell = max(s.horizon - travel, 2.0 * s.sample) if situation.searching else s.dwell
        mean_counts(x, y, z, goal, dwell, model, counts)
        hit, gain = information(counts, weight, terms)
        after = expected_spread(centred[0], centred[1], centred[2], centred[3], moments, terms) + 0.05
        mean_counts(x, y, z, place, samples * s.sample, model, counts)
        leg_hit, leg_gain = information(counts, weight, terms)
        far = _mean_distance(x, y, z, goal, weight, counts)
        seconds = travel + dwell
        row[29] = (s.entropy_weight * gain + (0.0 if situation.searching else now_far - far)) / seconds
        best = max(best, row[29])
        change = math.log(after / spread)
        row[0], row[1], row[2] = squash(travel, 10.0), 1.0 if turns else 0.0, 1.0 if k == 0 else 0.0
        row[3], row[4], row[5] = 1.0 if k == 1 else 0.0, KINDS[k] == NEIGHBOUR, KINDS[k] == BELIEF
        row[6], row[7], row[8] = KINDS[k] == SUPPORT, 2.0 * gain, 20.0 * gain / seconds
        row[9], row[10], row[11], row[12] = hit, 10.0 * hit / seconds, 4.0 * leg_gain, 2.0 * leg_hit
        row[13], row[14] = change, 20.0 * change / seconds
        row[15], row[16] = squash(now_far - far, 10.0), squash(far, 1.0 + spread)
        row[17] = _mass_within(x, y, z, goal, 5.0, counts)
        row[18], row[19], row[20] = in_wind(situation.mean, goal, along)
        row[21], row[22], row[23] = in_wind(own, goal, along)
        for axis in range(3):
            row[26 + axis] = squash(row[18 + axis], spreads[axis] + 0.5)
        row[27], row[28] = abs(row[27]), abs(row[28])
        for column in range(18, 24):
            row[column] = squash(row[column], 10.0)
        _compare_with_others(mates, b, i, goal, row)
    for k in range(candidates.shape[0]):
        rows[k, 29] = max((rows[k, 29] - best) / best, -3.0)


@njit(cache=True, error_model="numpy")
def decide(situations: Any, mates: Any, settings: Any, models: FloatArray, support: NDArray[np.float32],
           weights: FloatArray, turn: int, features: FloatArray) -> None:  # fmt: skip
    """UAV `turn` of each crew takes the candidate with the greatest score, and plans its leg of this beat.

    weights (B, 2, N_FEATURES): with a trace, and without. `features` (B, K, N_FEATURES) gets what was compared.
    """
    n_points = support.shape[2]
    room = (np.empty(n_points, np.float32), np.empty(n_points, np.float32), np.empty((N_TERMS, n_points), np.float32),
            np.empty((4, n_points), np.float32), np.empty((4, 5)))  # fmt: skip
    candidates = np.empty((N_CANDIDATES, 3))
    for b in range(situations.shape[0]):
        mate, situation, s = mates[b, turn], situations[b], settings[b]
        if not (situation.searching and situation.clock < mate.hold):
            rows = features[b]
            _write_features(situation, mates, b, turn, s, models[b], support[b], room, candidates, rows)
            w = weights[b, 1 if situation.searching else 0]
            best, highest = 0, -np.inf
            for k in range(N_CANDIDATES):
                score = 0.0
                for f in range(N_FEATURES):
                    score += w[f] * rows[k, f]
                if score > highest:
                    best, highest = k, score
            for axis in range(3):
                mate.goal[axis] = candidates[best, axis]
            mate.hold = situation.clock + _distance(mate.position, mate.goal) / s.speed + s.stand
        samples, _ = plan_leg(mate.position, mate.heading, mate.goal, s, mate.place)
        mate.seconds, mate.planned = samples * s.sample, True


@njit(error_model="numpy")
def wind_frame(situation: Any, along: Any, spreads: Any) -> None:
    """The wind's direction in `along` (2,), and the belief's spreads along, across and up in `spreads` (3,), m."""
    speed = math.sqrt(situation.wind[0] ** 2 + situation.wind[1] ** 2)
    along[0], along[1] = 1.0, 0.0
    if speed > 1e-3:
        along[0], along[1] = situation.wind[0] / speed, situation.wind[1] / speed
    c = situation.covariance
    cross, difference = 2.0 * along[0] * along[1] * c[0, 1], along[0] * along[0] - along[1] * along[1]
    half, total = 0.5 * difference * (c[0, 0] - c[1, 1]) + cross, 0.5 * (c[0, 0] + c[1, 1])
    spreads[0], spreads[1] = math.sqrt(max(total + half, 0.0)), math.sqrt(max(total - half, 0.0))
    spreads[2] = math.sqrt(max(c[2, 2], 0.0))


@njit(error_model="numpy")
def _compare_with_others(mates: Any, b: int, i: int, goal: Any, row: Any) -> None:
    """How far `goal` is from the others' goals, and how much nearer this UAV is to it than they are."""
    nearest_goal, nearest = 1e3, 1e3
    for j in range(mates.shape[1]):
        mate = mates[b, j]
        if j != i and mate.known:
            nearest_goal = min(nearest_goal, _distance(mate.goal, goal))
            nearest = min(nearest, _distance(mate.position, goal))
    row[24] = squash(nearest_goal, 10.0)
    row[25] = squash(nearest - _distance(mates[b, i].position, goal), 10.0)
