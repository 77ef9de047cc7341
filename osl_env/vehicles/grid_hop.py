"""Vehicle of the MUC-OSL paper: flies straight at constant speed between hovering points, and pays for turns."""

from __future__ import annotations

from typing import Literal

from osl_env.vehicles.base import Vehicle


class GridHop(Vehicle):
    """Hops and waypoints at constant speed; defaults of MUC-OSL (1 m/s, 1 s a hovering point, 1 s a turn)."""

    kind: Literal["grid_hop"] = "grid_hop"
