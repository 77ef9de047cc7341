"""Writes an OpenFOAM case and runs it: blockMesh, topoSet, subsetMesh (obstacles), pimpleFoam."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
from inlet import profiles
from settings import Box, Case

from osl_env.parameters import FloatArray, Vector

BASHRC = "/usr/share/openfoam/etc/bashrc"

_HEADER = """FoamFile
{{
    version 2.0;
    format ascii;
    class {kind};
    object {name};
}}
"""

_BLOCK_MESH = """
vertices ((0 0 0) ({x} 0 0) ({x} {y} 0) (0 {y} 0) (0 0 {cell}) ({x} 0 {cell}) ({x} {y} {cell}) (0 {y} {cell}));
blocks (hex (0 1 2 3 4 5 6 7) ({nx} {ny} 1) simpleGrading (1 1 1));
boundary
(
    inlet {{ type patch; faces ((0 4 7 3)); }}
    outlet {{ type patch; faces ((1 2 6 5)); }}
    sides {{ type patch; faces ((0 1 5 4) (3 7 6 2)); }}
    frontAndBack {{ type empty; faces ((0 3 2 1) (4 5 6 7)); }}
    obstacles {{ type wall; faces (); }}
);
"""

_CONTROL = """
application pimpleFoam;
startFrom startTime;
startTime 0;
stopAt endTime;
endTime {duration};
deltaT 0.005;
adjustTimeStep yes;
maxCo {courant};
maxDeltaT {frame_period};
writeControl adjustableRunTime;
writeInterval {frame_period};
writeFormat binary;
timePrecision 8;
runTimeModifiable no;
"""

_SCHEMES = """
ddtSchemes { default backward; }
gradSchemes { default Gauss linear; }
divSchemes
{
    default none;
    div(phi,U) Gauss LUST grad(U);
    div((nuEff*dev2(T(grad(U))))) Gauss linear;
}
laplacianSchemes { default Gauss linear orthogonal; }
interpolationSchemes { default linear; }
snGradSchemes { default orthogonal; }
"""

_SOLUTION = """
solvers
{
    "p|pFinal" { solver PCG; preconditioner DIC; tolerance 1e-6; relTol 0.01; }
    pFinal { $p; relTol 0; }
    "U|UFinal" { solver PBiCGStab; preconditioner DILU; tolerance 1e-7; relTol 0; }
}
PIMPLE { nOuterCorrectors 1; nCorrectors 2; nNonOrthogonalCorrectors 0; }
"""

_VELOCITY = """
dimensions [0 1 -1 0 0 0 0];
internalField uniform ({speed} 0 0);
boundaryField
{{
    inlet {{ type timeVaryingMappedFixedValue; mapMethod nearest; offset (0 0 0); setAverage off; }}
    outlet {{ type inletOutlet; inletValue uniform (0 0 0); value uniform ({speed} 0 0); }}
    sides {{ type slip; }}
    obstacles {{ type noSlip; }}
    frontAndBack {{ type empty; }}
}}
"""

_PRESSURE = """
dimensions [0 2 -2 0 0 0 0];
internalField uniform 0;
boundaryField
{
    inlet { type zeroGradient; }
    outlet { type fixedValue; value uniform 0; }
    sides { type zeroGradient; }
    obstacles { type zeroGradient; }
    frontAndBack { type empty; }
}
"""


def _write(folder: Path, name: str, body: str, kind: str = "dictionary") -> None:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(_HEADER.format(kind=kind, name=path.name) + body, encoding="ascii")


def _vectors(values: FloatArray) -> str:
    lines = "\n".join(f"({x:.6g} {y:.6g} {z:.6g})" for x, y, z in values.tolist())
    return f"{len(values)}\n(\n{lines}\n)\n"


def _write_inlet(folder: Path, case: Case, width: float) -> None:
    """The inlet's profiles, one file for each time, on the centres of its faces."""
    y = (np.arange(round(width / case.cell)) + 0.5) * case.cell
    period = profiles(case.inlet, y, width)
    patch = folder / "constant/boundaryData/inlet"
    centres = np.stack([np.zeros_like(y), y, np.full_like(y, case.cell / 2)], axis=1)
    patch.mkdir(parents=True)
    (patch / "points").write_text(_vectors(centres), encoding="ascii")
    for k in range(int(case.duration / case.inlet.step) + 2):
        velocity = np.pad(period[k % len(period)], ((0, 0), (0, 1)))
        at = patch / f"{k * case.inlet.step:.8g}"
        at.mkdir()
        (at / "U").write_text(_vectors(velocity), encoding="ascii")


def _keep_free(size: Vector, obstacles: list[Box], cell: float) -> str:
    """topoSetDict: the cells that are in no obstacle."""
    whole = (
        f"{{ name free; type cellSet; action new; source boxToCell; box (-1 -1 -1) ({size[0] + 1} {size[1] + 1} 1); }}"
    )
    remove = "\n".join(
        "{ name free; type cellSet; action subtract; source boxToCell; "
        f"box ({low[0]} {low[1]} -1) ({high[0]} {high[1]} 1); }}"
        for low, high in obstacles
    )
    return f"actions\n(\n{whole}\n{remove}\n);\n"


def write_case(folder: Path, case: Case, size: Vector, obstacles: list[Box]) -> None:
    """Write all dictionaries of `case` into `folder`, which must not exist."""
    counts = [round(side / case.cell) for side in size[:2]]
    for _, corner in [((0, 0, 0), size), *obstacles]:
        for side in corner[:2]:
            if abs(side / case.cell - round(side / case.cell)) > 1e-6:
                raise ValueError(
                    f"scenario {case.scenario}: {side:g} m is not a multiple of the cell of {case.cell:g} m"
                )
    folder.mkdir(parents=True)
    x, y = size[:2]
    _write(folder, "system/blockMeshDict", _BLOCK_MESH.format(x=x, y=y, nx=counts[0], ny=counts[1], cell=case.cell))
    _write(folder, "system/controlDict", _CONTROL.format(**case.model_dump(), duration=case.duration))
    _write(folder, "system/fvSchemes", _SCHEMES)
    _write(folder, "system/fvSolution", _SOLUTION)
    _write(folder, "system/topoSetDict", _keep_free(size, obstacles, case.cell))
    _write(folder, "constant/transportProperties", f"transportModel Newtonian;\nnu {case.viscosity};\n")
    _write(folder, "constant/turbulenceProperties", "simulationType laminar;\n")
    _write(folder, "0/U", _VELOCITY.format(speed=case.inlet.speed), "volVectorField")
    _write(folder, "0/p", _PRESSURE, "volScalarField")
    _write_inlet(folder, case, y)


def run_case(folder: Path, obstacles: bool) -> None:
    """Mesh and solve the case in `folder`; the programs' output goes to `folder`/log.NAME."""
    commands = ["blockMesh"]
    if obstacles:
        commands += ["topoSet", "subsetMesh free -patch obstacles -overwrite"]
    for command in [*commands, "pimpleFoam"]:
        log = folder / f"log.{command.split()[0]}"
        with log.open("w", encoding="utf-8") as output:
            shell = f". {BASHRC}; exec {command}"
            finished = subprocess.run(["bash", "-c", shell], cwd=folder, stdout=output, stderr=subprocess.STDOUT)
        if finished.returncode:
            raise RuntimeError(f"{command}: failed with exit code {finished.returncode}; see {log}")


def version() -> str:
    """The version of the OpenFOAM that is installed."""
    shell = f". {BASHRC} >&2; echo $WM_PROJECT_VERSION"
    shown = subprocess.run(["bash", "-c", shell], capture_output=True, text=True, check=False).stdout.strip()
    return shown or "of an unknown version"
