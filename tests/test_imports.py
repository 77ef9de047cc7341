"""Imports go one way: foundations -> models -> scenario -> world -> views; baselines and training stand above them."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent
PACKAGES = ("osl_env", "baselines", "training")
MODULES = sorted(
    path.relative_to(REPOSITORY).with_suffix("").as_posix().replace("/", ".").removesuffix(".__init__")
    for package in PACKAGES
    for path in (REPOSITORY / package).rglob("*.py")
)

# a module may import from its own layer and from those above it in this list
LAYERS: tuple[tuple[str, ...], ...] = (
    (
        "errors",
        "numerics",
        "streams",
        "parameters",
        "state",
        "configuration",
        "actions",
        "agent_actions",
        "kernel_cache",
    ),
    ("geometry", "intersections", "air", "cells"),
    ("fields",),
    ("arena",),
    ("plumes", "winds", "vehicles", "energy", "sensors", "radio", "reward", "placement", "faults"),
    ("scenario", "scenario_files"),
    (
        "observation",
        "observation_rows",
        "kernel_constants",
        "surroundings",
        "ending",
        "flying",
        "flying_bodies",
        "flying_body_legs",
        "flying_rotorpy",
        "stepping",
        "block",
        "mailbox",
        "world",
        "record",
    ),
    ("envs",),
)
FORBIDDEN = {
    "osl_env": ("torch", "stable_baselines3", "sb3_contrib", "baselines", "training"),
    "baselines": ("torch", "stable_baselines3", "sb3_contrib", "training"),
    "training": (),
}


def imports(module: str) -> list[str]:
    """The full names of the modules that `module` imports when it runs, wherever in the file."""
    path = REPOSITORY / f"{module.replace('.', '/')}.py"
    path = path if path.is_file() else path.with_suffix("") / "__init__.py"
    found: list[str] = []
    pending: list[ast.AST] = [ast.parse(path.read_text(encoding="utf-8"))]
    while pending:
        node = pending.pop()
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            pending.extend(node.orelse)
        elif isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative import; name the package"
            assert node.module is not None
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            found += [name if name in MODULES else node.module for name in names]
        else:
            pending.extend(ast.iter_child_nodes(node))
    return found


def layer(module: str) -> int:
    """The place of the osl_env module in LAYERS; the package itself is above them all."""
    part = module.split(".")[1] if "." in module else ""
    if not part:
        return len(LAYERS)
    for place, parts in enumerate(LAYERS):
        if part in parts:
            return place
    raise AssertionError(f"{module} is in no layer: give {part!r} its place in LAYERS")


@pytest.mark.parametrize("module", [name for name in MODULES if name.startswith("osl_env")])
def test_osl_env_imports_downwards_only(module: str) -> None:
    upwards = [name for name in imports(module) if name.startswith("osl_env") and layer(name) > layer(module)]
    assert not upwards, f"{module} imports from a layer above its own: {upwards}"


@pytest.mark.parametrize("module", MODULES)
def test_packages_import_in_one_direction(module: str) -> None:
    package = module.split(".")[0]
    wrong = [name for name in imports(module) if name.split(".")[0] in FORBIDDEN[package]]
    assert not wrong, f"{module} must not import {wrong}"


def test_nothing_imports_the_tests() -> None:
    wrong = [
        name for module in MODULES for name in imports(module) if name.split(".")[0] in ("tests", "pytest", "worlds")
    ]
    assert not wrong


def test_the_reader_sees_imports_inside_functions() -> None:
    assert "osl_env.envs.render" in imports("osl_env.envs.parallel")
    assert "osl_env.world" not in imports("osl_env.mailbox")  # for type checking only
