"""Legs and observations relative to the wind."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from checkpoints import random_checkpoint
from worlds import small

from baselines import make_policy
from baselines.features import FeatureBank, make_spec, spec_names
from baselines.learned.checkpoint import Checkpoint
from baselines.learned.course import Course, WindFrame, upwind
from osl_env import InputError, World
from osl_env.agent_actions import box_declares, box_waypoints

AREA = np.array([100.0, 60.0, 30.0])
PLACE = np.array([[50.0, 30.0, 15.0]])
NO_HIT = np.zeros(1)
FEATURES = [{"kind": "raw", "neighbours": 2}, {"kind": "hits", "length": 2, "heard": True}, {"kind": "team"}]


def leg(course: Course, action: int, wind: tuple[float, float], place: np.ndarray = PLACE) -> tuple[np.ndarray, int]:
    """Where the leg of `action` ends, relative to `place`, and its samples."""
    boxes = course.boxes(np.array([action]), place, np.array([[*wind, 0.0]]), NO_HIT, AREA, 20)
    targets, samples = box_waypoints(boxes, AREA, 20)
    return targets[0] - place[0], int(samples[0])


@pytest.mark.parametrize("wind", [(0.0, -1.0), (0.6, 0.8), (-2.0, 0.1), (0.0, 0.0)])
def test_directions_are_relative_to_the_wind(wind: tuple[float, float]) -> None:
    course = Course(lengths=(3.0, 9.0), samples=2, hover_samples=4)
    up = -np.array(wind) / math.hypot(*wind) if any(wind) else np.array([0.0, 1.0])
    left = np.array([-up[1], up[0]])
    for action, expected in ((1, [*9.0 * up, 0.0]), (4, [*3.0 * left, 0.0]), (17, [0.0, 0.0, 9.0])):
        move, samples = leg(course, action, wind)
        np.testing.assert_allclose(move, expected, atol=1e-9)
        assert samples == 2
    moves = np.array([leg(course, action, wind)[0] for action in range(course.n_actions - 2)])
    np.testing.assert_allclose(np.linalg.norm(moves, axis=1), [3.0, 9.0] * 10, atol=1e-9)
    assert len(np.unique(moves.round(6), axis=0)) == 20


def test_hovering_and_declaring_stay_where_the_uav_is() -> None:
    course = Course(hover_samples=5)
    for action, declares in ((20, False), (21, True)):
        boxes = course.boxes(np.array([action]), PLACE + 0.123456789, np.array([[1.0, 1.0, 0.0]]), NO_HIT, AREA, 20)
        assert box_declares(boxes).tolist() == [declares]
        targets, samples = box_waypoints(boxes, AREA, 20)
        assert np.abs(targets - PLACE - 0.123456789).max() < 1e-12  # shorter than a leg that would need a turn
        assert samples.tolist() == [5]
    assert course.n_actions == 22


def test_legs_end_at_the_boundary_and_samples_at_their_limit() -> None:
    move, _ = leg(Course(lengths=(500.0,)), 0, (0.0, -1.0))
    np.testing.assert_allclose(move, [0.0, 30.0, 0.0], atol=1e-12)
    boxes = Course(samples=9).boxes(np.array([0]), PLACE, np.zeros((1, 3)), NO_HIT, AREA, 3)
    assert box_waypoints(boxes, AREA, 3)[1].tolist() == [3]
    boxes = Course().boxes(np.array([0]), PLACE, np.zeros((1, 3)), NO_HIT, AREA, 1)
    assert box_waypoints(boxes, AREA, 1)[1].tolist() == [1]


def test_declaring_can_be_tied_to_the_last_reading() -> None:
    course = Course(declare_reading=3)
    readings = np.array([2.0, 3.0, 4.0, 9.0])
    actions = np.array([21, 21, 21, 20])
    boxes = course.boxes(actions, np.repeat(PLACE, 4, axis=0), np.zeros((4, 3)), readings, AREA, 20)
    assert box_declares(boxes).tolist() == [False, True, True, False]
    assert box_waypoints(boxes, AREA, 20)[1].tolist() == [4, 4, 4, 4]


def test_rows_are_turned_about_the_vertical() -> None:
    spec = make_spec(FEATURES)
    names = spec_names(spec)
    scenario = small(**{"wind.random_direction": True})
    world, bank = World(scenario, 4), FeatureBank(spec, scenario, 4)
    world.reset([1, 2, 3, 4])
    bank.reset()
    rows = bank.update(world).reshape(12, -1)
    turned = WindFrame(spec).turned(rows)
    up = np.repeat(upwind(world.episode["wind"][:, :2]), 3, axis=0)
    left = np.stack([-up[:, 1], up[:, 0]], axis=1)
    side = np.max(scenario.arena.size)
    at = names.index("raw.neighbour[0].offset.x")
    offset = rows[:, at : at + 2] * side
    np.testing.assert_allclose(turned[:, at] * side, (offset * up).sum(axis=1), atol=1e-4)
    np.testing.assert_allclose(turned[:, at + 1] * side, (offset * left).sum(axis=1), atol=1e-4)
    half = np.array(scenario.arena.size[:2]) / 2.0
    diagonal = math.hypot(*half)
    centred = world.motion["position"].reshape(12, 3)[:, :2] - half
    at = names.index("raw.position.x")
    np.testing.assert_allclose(turned[:, at] * diagonal, (centred * up).sum(axis=1), atol=1e-4)
    np.testing.assert_allclose(turned[:, at + 1] * diagonal, (centred * left).sum(axis=1), atol=1e-4)
    at = names.index("raw.area.x")
    np.testing.assert_allclose(turned[:, at] * diagonal, np.abs(up) @ half, atol=1e-4)
    untouched = [k for k, name in enumerate(names) if not name.endswith((".x", ".y")) or name.startswith("raw.wind")]
    np.testing.assert_array_equal(turned[:, untouched], rows[:, untouched])
    np.testing.assert_array_equal(WindFrame(spec).turned(rows[3:4]), turned[3:4])
    assert np.isfinite(WindFrame(spec).turned(np.zeros_like(rows))).all()


def test_features_that_cannot_be_turned_are_refused() -> None:
    with pytest.raises(InputError, match=r"needs \{kind: raw\}"):
        WindFrame(make_spec([{"kind": "hits"}]))
    with pytest.raises(InputError, match=r"takes no \{kind: belief\}"):
        WindFrame(make_spec([{"kind": "raw"}, {"kind": "belief"}]))


def test_a_course_checkpoint_must_say_its_course(tmp_path: Path) -> None:
    checkpoint = random_checkpoint(small())
    header = checkpoint.header.model_copy(update={"agent": "course"})
    folder = Checkpoint(header, checkpoint.arrays).write(tmp_path / "none")
    with pytest.raises(InputError, match="agent = 'course' needs the key course"):
        make_policy("checkpoint", path=folder)
    header = header.model_copy(update={"action": {"course": {"lengths": [3.0]}}})
    folder = replace(checkpoint, header=header).write(tmp_path / "other")
    with pytest.raises(InputError, match="agent = 'course' needs 12 outputs"):
        make_policy("checkpoint", path=folder)
