"""What a plume model is: parameters, and a batched reading at the UAVs' positions.

A plume either gives a hit rate (encounters per second, for a counting sensor) or a concentration. All methods are
batched over worlds; a model without memory keeps an empty state.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Literal

from osl_env.parameters import FloatArray, Parameters
from osl_env.state import StateArray


class PlumeModel(Parameters):
    """Base of the plume models. `measures` says what `read` returns: a hit rate (1/s) or a concentration."""

    measures: ClassVar[Literal["hit_rate", "concentration"]]

    @abstractmethod
    def field(self, positions: FloatArray, sources: FloatArray, strengths: FloatArray, wind: FloatArray) -> FloatArray:
        """Mean reading at `positions` (m, 3) m from `sources` (s, 3) m with relative `strengths` (s,) in `wind` (3,)
        m/s.

        Returns (m,). For pictures and tests; the batched reading is `read`.
        """

    @abstractmethod
    def read(
        self,
        motion: StateArray,
        sources: FloatArray,
        strengths: FloatArray,
        episode: StateArray,
        out: FloatArray,
    ) -> None:
        """Mean reading at every UAV of a batch of worlds, into `out` (n_envs, n_uavs).

        `motion` (n_envs, n_uavs) and `episode` (n_envs,) are laid out as in `osl_env.state`; `sources` (n_envs,
        n_sources, 3) m; `strengths` (n_envs, n_sources), relative.
        """
