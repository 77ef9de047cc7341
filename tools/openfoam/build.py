"""Builds the wind fields that ship: writes each case, runs OpenFOAM, closes the loop, saves field, card and picture.

    sh tools/openfoam/install.sh
    python tools/openfoam/build.py                       # all of cases/; some minutes of one core each
    python tools/openfoam/build.py arena-4x6-5           # one
    python tools/openfoam/build.py arena-4x6-5 --keep    # the run is there already: only export it again

The run is left in `--work` (default: build/openfoam), a usual OpenFOAM case that paraview opens.
"""

from __future__ import annotations

import argparse
import dataclasses
import shutil
import time
from pathlib import Path
from typing import Any

import numpy as np
from foam import run_case, version, write_case
from loop import Loop, close_loop
from measure import develop, divergence, of_gas, of_wakes
from pictures import draw
from settings import Box, Case, read_arena, read_case, read_preset

from osl_env.arena import Arena
from osl_env.configuration import config_folder
from osl_env.fields import Field, read_field, save_field, statistics
from osl_env.fields.openfoam import import_openfoam
from osl_env.parameters import Vector
from osl_env.plumes.filament import FilamentPlume

HERE = Path(__file__).resolve().parent
GAS_TIMES = np.arange(40.0, 240.0, 1.0)  # s after the source opened, for an area of 6 m along the wind


def read_loop(folder: Path, case: Case) -> tuple[Field, Loop]:
    """The run in `folder` after the spin-up as a field, and its loop."""
    run = import_openfoam(folder, start=case.spin_up - 1e-6, stop=case.duration)
    assert run.wind is not None
    length, seam = round(case.inlet.period / case.frame_period), round(case.seam / case.frame_period)
    return run, close_loop(np.asarray(run.wind), length, seam)


def card(case: Case, obstacles: list[Box], folder: Path, run: Field, loop: Loop) -> dict[str, Any]:
    """What the field says of itself, without its statistics."""
    return {
        "title": case.scenario,
        "description": case.description,
        "source": f"OpenFOAM {version()}, pimpleFoam, two-dimensional; tools/openfoam/cases/{folder.name}.yaml",
        "licence": "MIT",
        "case": case.model_dump(mode="json", exclude={"scenario", "description"}),
        "obstacles": [[list(low), list(high)] for low, high in obstacles],
        "loop": {
            "begins_s": float(run.times[loop.start]),
            "correlation_of_ends": round(loop.correlation, 3),
            "largest_change_at_seam": round(loop.jump, 3),
        },
    }


def gas_numbers(path: Path, case: Case, arena: Arena, size: Vector) -> tuple[dict[str, Any], np.ndarray]:
    """How intermittent the preset's own plume is in the wind of `path`, and a picture of it (nx, ny)."""
    preset = read_preset(case.scenario)
    plume = FilamentPlume(**preset["plume"])
    source = np.array(preset["sources"]["positions"][0])
    field = read_field(path)
    x, y = field.centres("x")[::2], field.centres("y")[::2]
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    points = np.concatenate([points, np.full((*points.shape[:2], 1), source[2])], axis=-1)
    scale = size[0] / 6.0
    gas = develop(path, plume, arena, source, GAS_TIMES * scale, points.reshape(-1, 3))
    return of_gas(gas), gas[-1].reshape(points.shape[:2])


def export(name: str, case: Case, folder: Path, out: Path, pictures: Path) -> None:
    """Save the run in `folder` as the field `out`/NAME.npz, and its picture."""
    size, obstacles = read_arena(case.scenario)
    run, loop = read_loop(folder, case)
    wind = np.round(loop.frames / case.resolution) * case.resolution
    wind[..., 2] = 0.0
    field = Field(
        times=np.arange(len(wind), dtype=np.float64) * case.frame_period,
        origin=run.origin * [1, 1, 0] + [0, 0, size[2] / 2],
        spacing=np.array([*run.spacing[:2], size[2]]),
        wind=wind.astype(np.float32),
        solid=run.solid,
        period=case.inlet.period,
        card=card(case, obstacles, HERE / "cases" / name, run, loop),
    )
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"{name}.npz"
    save_field(field, path, wind_step=case.resolution)
    arena = Arena(**read_preset(case.scenario)["arena"])
    numbers, gas = gas_numbers(path, case, arena, size)
    measured = statistics(field) | {
        "wakes" if obstacles else "arena": of_wakes(field, obstacles),
        "divergence": round(divergence(field), 3),
        "gas": numbers,
    }
    save_field(dataclasses.replace(field, card=field.card | {"statistics": measured}), path, wind_step=case.resolution)
    draw(field, gas, pictures / f"{name}.png")
    print(f"{name}: {path.stat().st_size / 1e6:.1f} MB {measured} {field.card['loop']}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="cases; default: all")
    parser.add_argument("--keep", action="store_true", help="export the runs that are there, without OpenFOAM")
    parser.add_argument("--work", type=Path, default=Path("build/openfoam"), help="where the runs go")
    parser.add_argument("--out", type=Path, default=config_folder() / "fields", help="where the fields go")
    parser.add_argument("--pictures", type=Path, default=HERE / "pictures", help="where the pictures go")
    given = parser.parse_args()
    for name in given.names or sorted(path.stem for path in (HERE / "cases").glob("*.yaml")):
        case = read_case(HERE / "cases" / f"{name}.yaml")
        folder = given.work / name
        if not given.keep:
            size, obstacles = read_arena(case.scenario)
            shutil.rmtree(folder, ignore_errors=True)
            began = time.perf_counter()
            write_case(folder, case, size, obstacles)
            run_case(folder, bool(obstacles))
            print(f"{name}: {case.duration:g} s of flow in {time.perf_counter() - began:.0f} s")
        export(name, case, folder, given.out, given.pictures)


if __name__ == "__main__":
    main()
