"""Finds what is there, so that anything new is tested without a new test: the model classes of each package."""

from __future__ import annotations

import functools
import importlib
import pkgutil
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numpy as np

import osl_env.plumes
import osl_env.sensors
import osl_env.vehicles
import osl_env.winds
from osl_env.fields import Field, save_field
from osl_env.parameters import Parameters
from osl_env.plumes.base import PlumeModel
from osl_env.sensors import GasSensor
from osl_env.vehicles.base import Vehicle
from osl_env.winds.base import Wind

Model = TypeVar("Model", bound=Parameters)


def models(package: ModuleType, base: type[Model]) -> list[type[Model]]:
    """The subclasses of `base` with a `kind`, from all modules of `package`."""
    for module in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
        importlib.import_module(module.name)
    found, pending = [], [base]
    while pending:
        pending += (subclasses := pending.pop().__subclasses__())
        found += [
            cls for cls in subclasses if "kind" in cls.model_fields and cls.__module__.startswith(package.__name__)
        ]
    return sorted(found, key=lambda cls: cls.__name__)


def kind(cls: type[Any]) -> str:
    """The value of `kind` that chooses the model in a scenario file."""
    return str(cls.model_fields["kind"].default)


@functools.cache
def field_files() -> tuple[str, str]:
    """Two small fields with wind and the gas of one source each, everywhere, as files."""
    paths = []
    for place in (12.0, 18.0):
        rng = np.random.default_rng(int(place))
        wind = rng.normal(0.5, 0.2, (3, 8, 8, 8, 3)).astype(np.float32)
        gas = rng.uniform(0.1, 2.0, (3, 8, 8, 8)).astype(np.float32)
        card = {"title": "random", "sources": [{"position": [place] * 3}]}
        field = Field(times=np.array([0.0, 1.0, 2.0]), origin=np.full(3, 2.0), spacing=np.full(3, 4.0), wind=wind,
                      concentration=gas, period=3.0, card=card)  # fmt: skip
        paths.append(str(Path(tempfile.mkdtemp()) / "field.npz"))
        save_field(field, Path(paths[-1]))
    return paths[0], paths[1]


def example(cls: type[Model]) -> Model:
    """A model with its defaults, and files where it needs them."""
    given: dict[str, Any] = {"field": field_files()[0], "fields": field_files()}
    return cls(**{key: value for key, value in given.items() if key in cls.model_fields})


PLUMES = models(osl_env.plumes, PlumeModel)
WINDS = models(osl_env.winds, Wind)
VEHICLES = models(osl_env.vehicles, Vehicle)
SENSORS = models(osl_env.sensors, GasSensor)
