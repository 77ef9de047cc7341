"""Pictures of episodes: what the legend names, and which samples are drawn as detections."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from osl_env import World, load_scenario
from osl_env.envs.render import TrackRecorder, _blocks, _spaced


def recorded(name: str, readings: list[float], **changes: Any) -> TrackRecorder:
    """A world of the preset `name`, where each UAV has read one of `readings` at its start."""
    world = World(load_scenario(name, **changes))
    world.reset([0])
    recorder = TrackRecorder(world)
    recorder.positions.append(recorder.positions[0])
    recorder.readings.append(np.array(readings))
    return recorder


def legend(recorder: TrackRecorder) -> list[str]:
    return [text.get_text() for text in recorder.figure().legends[0].get_texts()]


@pytest.mark.parametrize("readings", [[3.0, 0.0, 0.0], [0.0, 2.0, 5.0]])
def test_detections_are_named_once_whoever_has_them(readings: list[float]) -> None:
    assert legend(recorded("rate-60x60x30", readings)).count("detections") == 1


def test_a_reading_below_the_threshold_is_no_detection() -> None:
    change = {"gas_sensor.threshold": 0.5}
    assert "detections" not in legend(recorded("tunnel-a", [0.4], **change))
    assert "detections" in legend(recorded("tunnel-a", [0.6], **change))


def test_a_large_team_has_one_line_in_the_legend() -> None:
    assert legend(recorded("arena-4x6-5", [0.0] * 15)) == ["UAVs", "source"]


@pytest.mark.parametrize("name", ["rate-60x60x30", "rate-100x200x50", "arena-4x6-5"])
def test_labels_lie_within_the_picture(name: str) -> None:
    recorder = recorded(name, [0.0] * load_scenario(name).team.n_uavs)
    image = recorder.draw()
    for edge in (image[0], image[-1], image[:, 0], image[:, -1]):
        assert (edge == 255).all()


def test_blocks_fill_the_solid_cells() -> None:
    solid = np.random.default_rng(0).random((6, 5, 4)) < 0.6
    filled = np.zeros(solid.shape, int)
    for (x0, y0, z0), (x1, y1, z1) in _blocks(solid):
        filled[x0:x1, y0:y1, z0:z1] += 1
    assert (filled == solid).all()
    assert len(list(_blocks(np.ones((9, 8, 7), bool)))) == 1


def test_solid_cells_are_drawn() -> None:
    plain, walled = (
        recorded("arena-4x6-5", [0.0] * 15, **{"arena.obstacles": [], "arena.occupancy": field}).figure()
        for field in (None, "arena-4x6-5")
    )
    assert len(walled.axes[0].collections) == len(plain.axes[0].collections) + 5


def test_markers_of_detections_keep_a_distance_along_the_track() -> None:
    rng = np.random.default_rng(0)
    track, chosen = np.cumsum(rng.normal(scale=0.1, size=(500, 3)), axis=0), rng.random(500) < 0.7
    kept = np.flatnonzero(_spaced(track, chosen, 0.5))
    assert kept[0] == np.flatnonzero(chosen)[0]
    assert np.all(chosen[kept])
    assert np.linalg.norm(np.diff(track[kept], axis=0), axis=1).min() >= 0.5
    for k in np.flatnonzero(chosen):  # nothing is left out that is that far from the one kept before
        before = kept[kept <= k][-1]
        assert k == before or np.linalg.norm(track[k] - track[before]) < 0.5
