"""What does not fit together in a scenario is refused in one line: the key's path, the value, what is allowed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from osl_env import InputError, World, load_scenario
from osl_env.fields import Field, save_field
from training.cli import main

Write = Callable[[str], Path]
GADEN, ARENA, PUFFS, RATE = "base: gaden-60x60x30", "base: arena-4x6-5", "base: puff-source1", "base: rate-60x60x30"
BOX = "arena: {obstacles: [{kind: box, low: [4, 1, 0], high: [5, 2, 1]}, %s]}"


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write(text: str) -> Path:
        path = tmp_path / "mine.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


# (the preset, its changes) -> the message after the file's name begins with the first, and holds the others
BAD: dict[tuple[str, str], tuple[str, ...]] = {
    # sensor and plume
    (RATE, "plume: {kind: filament}"): ("gas_sensor.kind = 'poisson_counter'", "hit_rate", "concentration"),
    (RATE, "gas_sensor: {kind: pid}"): ("gas_sensor.kind = 'pid'", "'hit_rate'"),
    (GADEN, "gas_sensor: {kind: poisson_counter}"): ("gas_sensor.kind = 'poisson_counter'", "'filament'"),
    (GADEN, "advertised_plume: null"): ("advertised_plume.kind = 'filament'", "count_unit", "hit_rate"),
    (GADEN, "advertised_plume: {kind: gaussian_puff}"): ("advertised_plume.kind = 'gaussian_puff'", "hit_rate"),
    (RATE, "advertised_plume: {kind: filament}"): ("advertised_plume.kind = 'filament'", "hit_rate"),
    (RATE, "advertised_plume: {kind: playback, fields: nowhere}"): ("advertised_plume.fields = 'nowhere'", "allowed"),
    (GADEN, "advertised_plume: {kind: hit_rate, step: 1}"): ("unknown key 'advertised_plume.step'",),
    (PUFFS, "gas_sensor: {count_unit: 2}"): ("advertised_plume.kind", "count_unit"),
    (GADEN, "gas_sensor: {count_unit: null}"): ("gas_sensor.max_count = 100", "count_unit"),
    (GADEN, "gas_sensor: {threshold: 5000}"): ("gas_sensor.threshold = 5000", "full_scale = 4000"),
    (GADEN, "gas_sensor: {kind: nose}"): ("gas_sensor.kind = 'nose'", "'mox'"),
    (GADEN, "gas_sensor: {smell: 2}"): ("unknown key 'gas_sensor.smell'",),
    # faults and range sensors
    (GADEN, "sensor_faults: [{uav: 2}, {uav: 3}]"): ("sensor_faults.1.uav = 3", "UAVs 0 to 2"),
    (GADEN, "sensor_faults: [{kind: broken}]"): ("sensor_faults.0.kind = 'broken'", "'stuck'"),
    (GADEN, "sensor_faults: [{start: 5, end: 2}]"): ("sensor_faults.0.end = 2", "start = 5"),
    (GADEN, "sensor_faults: [{kind: gain, magnitude: -2}]"): ("sensor_faults.0.magnitude = -2", "at least 0"),
    (GADEN, "sensor_faults: [{when: 1}]"): ("unknown key 'sensor_faults.0.when'",),
    (GADEN, "sensor_faults: {uav: 1}"): ("sensor_faults = {'uav': 1}",),
    (GADEN, "range_sensors: {count: 65}"): ("range_sensors.count = 65", "64"),
    (GADEN, "range_sensors: {range: 0}"): ("range_sensors.range = 0", "greater than 0"),
    # ticks
    (GADEN, "plume: {step: 10}"): ("plume.step = 10", "1 s of a sample", "hover_time"),
    (PUFFS, "plume: {step: 0.5}"): ("plume.step = 0.5", "0.05 s of a sample", "decision_period"),
    (PUFFS, "plume: {step: 0.3}"): ("plume.step = 0.3", "interval = 0.5"),
    (RATE, "plume: {kind: pseudo_gaussian}\ngas_sensor: {kind: ideal, period: 5}"): (
        "gas_sensor.period = 5",
        "1 s of a sample",
    ),
    (
        RATE,
        "plume: {kind: pseudo_gaussian}\ngas_sensor: {kind: ideal, period: 5}\nwind: {kind: meander, step: 4}",
    ): ("wind.step = 4", "1 s of a sample"),
    # plumes
    (GADEN, "plume: {kind: smoke}"): ("plume.kind = 'smoke'", "'filament'"),
    (GADEN, "plume: {colour: 1}"): ("unknown key 'plume.colour'",),
    (GADEN, "plume: filament"): ("plume = 'filament'", "a mapping of keys and values"),
    (PUFFS, "plume: {dispersion: briggs_urban}"): ("plume.dispersion = 'briggs_urban'", "a mapping"),
    (GADEN, "wind: {velocity: 1}"): ("wind.velocity = 1", "must be a list"),
    (GADEN, "wind: {velocity: [1, 0, 0, 0]}"): ("wind.velocity", "at most 3 entries"),
    (GADEN, "plume: {downwash: {weight: 2}}"): ("unknown key 'plume.downwash.weight'",),
    (GADEN, "plume: {capacity: 10}"): ("plume.capacity = 10", "when_full"),
    (GADEN, "plume: {capacity: 10, when_full: merge}"): ("plume.capacity = 10", "at least"),
    (GADEN, "plume: {max_age: .inf}"): ("plume.max_age = inf", "capacity"),
    (GADEN, "plume: {release_rate: 1, centre_concentration: 2}"): ("plume.release_rate = 1", "one of the two"),
    (PUFFS, "plume: {max_age: 1.0e+9}"): ("plume.max_age = 1000000000", "puffs"),
    (PUFFS, "plume: {dispersion: {kind: magic}}"): ("plume.dispersion.kind = 'magic'", "'briggs_urban'"),
    (PUFFS, "plume: {dispersion: {sigma: 1}}"): ("unknown key 'plume.dispersion.sigma'",),
    (ARENA, "plume: {kind: playback}"): ("plume.fields = ()", "at least one"),
    (ARENA, "plume: {kind: playback, fields: nowhere}"): ("plume.fields = 'nowhere'", "arena-4x6-5"),
    (ARENA, "plume: {kind: playback, fields: arena-4x6-5}"): ("plume.fields = 'arena-4x6-5'", "no concentration"),
    # winds
    (GADEN, "wind: {kind: breeze}"): ("wind.kind = 'breeze'", "'meander'"),
    (GADEN, "wind: {kind: meander, gusts: 3}"): ("unknown key 'wind.gusts'",),
    (GADEN, "wind: {kind: series, times: [0, 1, 1]}"): ("wind.times[2] = 1", "above times[1] = 1"),
    (GADEN, "wind: {kind: series, times: [0, 1]}"): ("wind.velocities = 3 entries", "2 times"),
    (GADEN, "wind: {kind: field, field: arena-4x6-5}"): ("wind.field = 'arena-4x6-5'", "cover", "[0, 60]"),
    (GADEN, "wind: {kind: field, field: nowhere.npz}"): ("wind.field = 'nowhere.npz'", "cannot be read"),
    (ARENA, "wind: {offset: [1, 0, 0]}"): ("wind.field = 'arena-4x6-5'", "[1, 7]", "offset"),
    (ARENA, "wind: {random_start: true, loop: false}"): ("wind.random_start = True", "loop"),
    # places and obstacles
    (ARENA, "sources: {positions: [[4.6, 0.8, 0.1]]}"): ("sources.positions = [4.6, 0.8, 0.1]", "obstacle"),
    (ARENA, "team: {n_uavs: 1, starts: [[4.6, 0.8, 0.1]]}"): ("team.starts = [4.6, 0.8, 0.1]", "obstacle"),
    (ARENA, "team: {region: [[4.5, 0.7, 0.1], [4.6, 0.9, 0.2]]}"): ("team.region = ", "inside obstacles"),
    (ARENA, "sources: {region: [[4.5, 0.7, 0.1], [4.6, 0.9, 0.2]]}"): ("sources.region = ", "inside obstacles"),
    (ARENA, "team: {region: [[4.5, 0.7, 0.1], [4.6, 0.9, 0.9]]}"): ("team.region = ", "inside the area"),
    (ARENA, BOX % "{kind: sphere}"): ("arena.obstacles.1.kind = 'sphere'", "box"),
    (ARENA, BOX % "{kind: box, low: [0, 0, 0], high: [0, 1, 1]}"): ("arena.obstacles.1.high = ", "must exceed"),
    (ARENA, BOX % "{kind: box, low: [0, 0, 0], high: [1, 1, 1], hue: 2}"): ("unknown key 'arena.obstacles.1.hue'",),
    (ARENA, BOX % "{kind: box, low: [0, 0, 0]}"): ("key 'arena.obstacles.1.high' is missing",),
    (ARENA, BOX % "{kind: cylinder, center: [1, 1], radius: 5 kg}"): ("arena.obstacles.1.radius = '5 kg'", "in m"),
    (ARENA, "arena: {occupancy: nowhere.npz}"): ("arena.occupancy = 'nowhere.npz'", "cannot be read"),
    (ARENA, "arena: {occupancy: {field: arena-4x6-5, shift: 1}}"): ("unknown key 'arena.occupancy.shift'",),
    (ARENA, "arena: {collision: bounce}"): ("arena.collision = 'bounce'", "'slide'"),
}


@pytest.mark.parametrize(("base", "changes"), BAD)
def test_what_does_not_fit_is_refused_in_one_line_with_its_key(base: str, changes: str, write: Write) -> None:
    path = write(f"{base}\n{changes}\n")
    with pytest.raises(InputError) as caught:
        World(load_scenario(path))
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 500
    begin, *words = BAD[base, changes]
    assert message.startswith(f"{path}: {begin}")
    for word in words:
        assert word in message


@pytest.mark.parametrize("case", [(GADEN, "plume: {step: 10}"), (ARENA, "wind: {field: nowhere}"), (ARENA, BOX % "3")])
def test_the_command_line_says_the_same_line_and_exits_with_2(
    case: tuple[str, str], write: Write, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write("\n".join(case))
    with pytest.raises(InputError) as caught:
        load_scenario(path)
    assert main(["run", "random-walk", str(path)]) == 2
    printed = capsys.readouterr()
    assert str(caught.value) in printed.err
    assert len(printed.err.strip().splitlines()) == 1
    assert "Traceback" not in printed.err + printed.out


def gas(path: Path, source: list[float]) -> str:
    """Write two frames of gas of a `source` (3,) m on 4 x 4 x 2 cells over 8 x 8 x 4 m to `path`; its name."""
    field = Field(
        times=np.array([0.0, 1.0]),
        origin=np.ones(3),
        spacing=np.full(3, 2.0),
        concentration=np.random.default_rng(0).random((2, 4, 4, 2)).astype(np.float32),
        card={"sources": [{"position": source}]},
    )
    save_field(field, path)
    return str(path)


def played(field: str, **changes: Any) -> Any:
    settings: dict[str, Any] = {
        "arena": {"size": [8.0, 8.0, 4.0]},
        "plume": {"kind": "playback", "fields": field},
        "gas_sensor": {"kind": "ideal"},
        "sources.positions": [[1.0, 2.0, 3.0]],
        "team": {"n_uavs": 1, "starts": [[4.0, 4.0, 1.0]]},
    }
    return load_scenario("rate-60x60x30", **(settings | changes))


def test_played_back_gas_comes_from_where_its_sources_stood(tmp_path: Path) -> None:
    field = gas(tmp_path / "gas.npz", [1.0, 2.0, 3.0])
    assert played(field).tick == 0.1
    for changes, message in (
        ({"sources.positions": [[1.0, 2.0, 2.0]]}, r"sources.positions = .*\[\[1.0, 2.0, 3.0\]\]"),
        ({"sources.positions": [[1.0, 2.0, 3.0]] * 2}, r"plume.fields = .*1 sources, and the scenario has 2"),
        ({"sources.region": [[1, 2, 3], [2, 3, 3]]}, "sources.positions"),
        ({"plume.offset": [0.5, 0.0, 0.0]}, "plume.fields = .*cover"),
        ({"arena.size": [9.0, 8.0, 4.0]}, "plume.fields = .*cover"),
        ({"plume.step": 7.0}, "plume.step = 7"),
        ({"gas_sensor": {"kind": "poisson_counter"}}, "gas_sensor.kind"),
    ):
        with pytest.raises(InputError, match=message) as caught:
            played(field, **changes)
        assert "\n" not in str(caught.value)
