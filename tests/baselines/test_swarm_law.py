"""The swarm's control law: signs, ranges, limits and invariances of eqs 1 to 9."""

from __future__ import annotations

import math

import numpy as np
import pytest

from baselines.swarm.law import (
    PAPER_LAW,
    SMALLEST_DISTANCE,
    cohesion_force,
    goal_vector,
    gradient,
    obstacle_force,
    odor_weight,
    total_force,
)
from baselines.swarm.robot import default_distances

LAW = PAPER_LAW  # R1 = 0.1 m, R2 = 0.5 m
RNG = np.random.default_rng(7)


def along(distance: float) -> np.ndarray:
    return np.array([distance, 0.0, 0.0])


def turned(vectors: np.ndarray, angle: float) -> np.ndarray:
    cos, sin = math.cos(angle), math.sin(angle)
    return vectors @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])


def test_near_robots_push_far_ones_pull_and_between_there_is_nothing() -> None:
    assert cohesion_force(along(0.05), 1.0)[0] == pytest.approx(-1.0 / 0.05**2)
    assert cohesion_force(along(0.1), 1.0).tolist() == [0.0, 0.0, 0.0]
    assert cohesion_force(along(0.3), 1.0).tolist() == [0.0, 0.0, 0.0]
    assert cohesion_force(along(0.5), 1.0).tolist() == [0.0, 0.0, 0.0]
    assert cohesion_force(along(0.8), 1.0)[0] == pytest.approx(1.0 / 0.8**2)
    assert cohesion_force(along(1.6), 1.0)[0] == pytest.approx(cohesion_force(along(0.8), 1.0)[0] / 4.0)


def test_gains_scale_their_own_side_only() -> None:
    law = LAW._replace(repulsion_gain=3.0, attraction_gain=5.0)
    assert cohesion_force(along(0.05), 1.0, law)[0] == pytest.approx(-3.0 / 0.05**2)
    assert cohesion_force(along(0.8), 1.0, law)[0] == pytest.approx(5.0 / 0.8**2)


def test_the_printed_sign_pulls_near_robots_together_and_pushes_far_ones_apart() -> None:
    printed = LAW._replace(sign=-1.0)
    for distance in (0.05, 0.3, 0.8):
        assert np.array_equal(cohesion_force(along(distance), 0.7, printed), -cohesion_force(along(distance), 0.7))
    assert cohesion_force(along(0.05), 1.0, printed)[0] > 0.0
    assert cohesion_force(along(0.8), 1.0, printed)[0] < 0.0


def test_cohesion_is_opposite_for_the_two_of_a_pair_with_equal_odor() -> None:
    offsets = RNG.normal(0.0, 0.5, (50, 3))
    there = cohesion_force(offsets, 0.4, own=3, other=8)
    back = cohesion_force(-offsets, 0.4, own=8, other=3)
    assert np.array_equal(there, -back)


def test_cohesion_is_in_proportion_to_the_neighbours_odor() -> None:
    offsets = RNG.normal(0.0, 0.5, (50, 3))
    full = cohesion_force(offsets, np.ones(50))
    assert np.allclose(cohesion_force(offsets, np.full(50, 0.25)), 0.25 * full, rtol=1e-12)
    assert not cohesion_force(offsets, np.zeros(50)).any()
    assert cohesion_force(offsets.reshape(5, 10, 3), 1.0).shape == (5, 10, 3)


def test_odor_weights_lie_between_0_and_beta() -> None:
    assert odor_weight([0.0, 1.0, 2.0, 4.0], 4.0).tolist() == [0.0, 0.25, 0.5, 1.0]
    assert odor_weight([5.0], 4.0).tolist() == [1.0]
    assert odor_weight([0.0, 3.0], 0.0).tolist() == [0.0, 0.0]  # nothing but clean air so far
    law = LAW._replace(clean_air=1.0, odor_gain=2.0)
    assert odor_weight([0.5, 1.0, 2.0, 3.0], 3.0, law).tolist() == [0.0, 0.0, 1.0, 2.0]
    assert odor_weight([1.0], 1.0, law).tolist() == [0.0]


def test_the_gradient_of_a_linear_field_points_up_it() -> None:
    slope = np.array([0.3, -0.2, 0.1])
    # the six axis neighbours see each component twice: their sum is twice the gradient
    offsets = 0.7 * np.vstack([np.eye(3), -np.eye(3)])
    assert np.allclose(gradient(offsets, 1.0 + offsets @ slope, 1.0), 2.0 * slope, rtol=1e-12)
    assert not gradient(offsets, np.ones(6), 1.0).any()
    assert not gradient(np.empty((0, 3)), np.empty(0), 1.0).any()


def test_the_goal_vector_goes_up_the_gradient_and_against_the_wind() -> None:
    wind = np.array([0.5, 0.1, 0.0])
    assert np.allclose(goal_vector(np.empty((0, 3)), [], 0.0, wind), -0.5 * wind)
    up = goal_vector(along(2.0)[None], [0.4], 0.0, np.zeros(3))
    assert np.allclose(up, [50.0 * 0.4 / 2.0, 0.0, 0.0])


def test_forces_turn_with_the_plane() -> None:
    offsets, concentration = RNG.normal(0.0, 0.6, (12, 3)), RNG.uniform(0.0, 1.0, 12)
    wind = np.array([0.4, -0.2, 0.05])
    force = total_force(offsets, concentration, 0.3, 1.0, wind)
    for angle in (0.3, 2.0, 4.5):
        rotated = total_force(turned(offsets, angle), concentration, 0.3, 1.0, turned(wind, angle))
        assert np.allclose(rotated, turned(force, angle), rtol=1e-9)


def test_obstacles_push_away_with_the_inverse_square_of_their_distance() -> None:
    law = LAW._replace(sensor_range=4.0)
    for ray in range(8):
        ranges = np.full(8, 4.0)
        ranges[ray] = 0.5
        force, angle = obstacle_force(ranges, law), ray * math.pi / 4.0
        assert np.allclose(force, [-4.0 * math.cos(angle), -4.0 * math.sin(angle), 0.0], atol=1e-12)
        ranges[ray] = 1.0
        assert np.allclose(obstacle_force(ranges, law), force / 4.0, atol=1e-12)
    assert not obstacle_force(np.full(8, 4.0), law).any()  # rays that meet nothing
    assert not obstacle_force([], law).any()
    linear = law._replace(obstacle_exponent=1.0, obstacle_gain=3.0)
    assert obstacle_force([0.5, 4.0], linear)[0] == pytest.approx(-6.0)
    assert np.isfinite(obstacle_force(np.zeros(8), law)).all()


def test_robots_at_one_place_part_and_feel_no_gradient() -> None:
    here = np.zeros(3)
    first, second = cohesion_force(here, 1.0, own=2, other=5), cohesion_force(here, 1.0, own=5, other=2)
    assert np.array_equal(first, -second)
    assert np.linalg.norm(first) == pytest.approx(1.0 / SMALLEST_DISTANCE**2)
    assert not gradient(here[None], [3.0], 1.0).any()
    # three at one place: not all along one line
    thirds = [cohesion_force(here, 1.0, own=2, other=k) for k in (5, 6)]
    assert np.linalg.norm(np.cross(*thirds)) > 0.1 * np.linalg.norm(thirds[0]) ** 2
    for tiny in (1e-300, 1e-12, 1e-6):
        force = cohesion_force(along(tiny), 1.0)
        assert np.isfinite(force).all()
        assert np.linalg.norm(force) == pytest.approx(1.0 / SMALLEST_DISTANCE**2)


def test_distances_meet_both_published_settings() -> None:
    assert default_distances(1.0) == pytest.approx((0.1, 0.5))
    assert default_distances(6.0) == pytest.approx((2.2, 3.3))
    assert default_distances(0.5) == pytest.approx((0.05, 0.25))
    assert default_distances(12.0) == pytest.approx((4.4, 6.6))
    assert all(near < far for near, far in map(default_distances, (1e-3, 0.7, 2.0, 5.0, 50.0)))
