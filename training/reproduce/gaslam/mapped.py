"""The maps that a policy has drawn by the end of its flight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines import Policy
from baselines.gaslam.cells import Cells
from osl_env.errors import InputError
from osl_env.parameters import FloatArray
from training.gas_mapping import cells_of


@dataclass(frozen=True, eq=False)
class GasMaps:
    """Maps over `cells`, each (n,) in the unit of the sensor but for the confidence."""

    cells: Cells
    kernel: FloatArray  # mean of the readings
    confidence: FloatArray  # of the kernel map, 0 to 1
    plume: FloatArray | None  # of the source term; None where none was estimated
    final: FloatArray


def maps_of(policy: Policy) -> GasMaps:
    """The maps that `policy` holds now. Raises InputError for a policy that maps no gas."""
    belief = policy.belief()
    mapping: Any = getattr(policy, "mapping", None)
    if mapping is None or belief is None or belief.gas_map is None:
        raise InputError(f"policy {policy.name}: draws no gas map")
    final, cells = belief.gas_map, cells_of(belief.gas_map)
    if cells.shape != mapping.cells.shape:
        raise InputError(f"policy {policy.name}: its maps have {cells.shape} and {mapping.cells.shape} cells")
    return GasMaps(
        cells=cells,
        kernel=np.array(mapping.kernel.mean),
        confidence=np.array(mapping.kernel.confidence),
        plume=None if mapping.posterior is None else np.array(mapping.plume),
        final=final.values.ravel().copy(),
    )
