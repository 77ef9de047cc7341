"""Finds what is there, so that anything new is tested without a new test: the model classes of each package."""

from __future__ import annotations

import importlib
import pkgutil
from types import ModuleType
from typing import Any, TypeVar

import osl_env.plumes
import osl_env.vehicles
import osl_env.winds
from osl_env.parameters import Parameters
from osl_env.plumes.base import PlumeModel
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


PLUMES = models(osl_env.plumes, PlumeModel)
WINDS = models(osl_env.winds, Wind)
VEHICLES = models(osl_env.vehicles, Vehicle)
