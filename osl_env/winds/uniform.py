"""Uniform horizontal wind: one velocity everywhere and always, drawn once an episode where its direction is random."""

from __future__ import annotations

from typing import Literal

from osl_env.winds.mean_wind import MeanWind


class UniformWind(MeanWind):
    """Uniform wind. Zero wind is allowed; the rate plume is then isotropic."""

    kind: Literal["uniform"] = "uniform"
