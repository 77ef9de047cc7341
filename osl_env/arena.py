"""The search volume: an axis-aligned box from the origin to its far corner."""

from __future__ import annotations

from pydantic import field_validator

from osl_env.parameters import Parameters, Vector, quantity


class Arena(Parameters):
    """Bounds of the search volume: 0 <= x <= Lx, 0 <= y <= Ly, 0 <= z <= Lz."""

    size: Vector = quantity((100.0, 60.0, 30.0), "m")  # Lx, Ly, Lz

    @field_validator("size")
    @classmethod
    def _positive(cls, size: Vector) -> Vector:
        if min(size) <= 0:
            raise ValueError(f"size = {list(size)}: every side must be above 0 m")
        return size

    def contains(self, position: Vector) -> bool:
        """Whether `position` (m) lies inside or on the bounds."""
        return all(0.0 <= x <= side for x, side in zip(position, self.size, strict=True))
