"""Obstacle layouts of the small swarm arenas: the paper gives a number of obstacles, not their places.

Boxes are placed one after the other, from a seed: each is the candidate (of those that leave the corridors free) that
is farthest from the boxes already there. The first five of ten are therefore the layout of five. Every face lies on a
face of the CFD mesh, so that no cell is cut.

    python tools/openfoam/layout.py 10         # prints the `arena.obstacles` of configs/scenarios/arena-4x6-10.yaml
    python tools/openfoam/layout.py 10 -b      # of arena-4x6-10-b.yaml
"""

from __future__ import annotations

import sys

import numpy as np

CELL = 0.05  # m, of the mesh
SIZE = (6.0, 4.0, 0.5)  # m, of the arena
REGION = ((1.3, 0.4), (5.0, 3.6))  # m: obstacles stay inside; free: source and inlet on the left, starts on the right
SIDES = (0.30, 0.50)  # m, shortest and longest side of a box
CORRIDOR = 0.45  # m, free between two boxes: a robot keeps 0.15 m from either
CANDIDATES = 400  # for each box
SEEDS = {"": 4, "-b": 6, "-c": 7}  # by what the name of a preset ends with; 5 has no room for ten boxes


def _gap(a: np.ndarray, b: np.ndarray) -> float:
    """Distance, m, between two boxes (x0, y0, x1, y1)."""
    dx = max(a[0] - b[2], b[0] - a[2], 0.0)
    dy = max(a[1] - b[3], b[1] - a[3], 0.0)
    return float(np.hypot(dx, dy))


def boxes(number: int, seed: int) -> list[list[float]]:
    """The first `number` boxes (x0, y0, x1, y1), m."""
    rng = np.random.default_rng(seed)
    low, high = np.array(REGION[0]), np.array(REGION[1])
    placed: list[np.ndarray] = []
    while len(placed) < number:
        best, best_gap = None, CORRIDOR
        for _ in range(CANDIDATES):
            sides = rng.uniform(*SIDES, size=2)
            corner = rng.uniform(low, high - sides)
            box = np.round(np.concatenate([corner, corner + sides]) / CELL) * CELL
            gap = min((_gap(box, other) for other in placed), default=np.inf)
            if gap >= best_gap:
                best, best_gap = box, min(gap, 1.0)
                if gap > 1.0:
                    break
        if best is None:
            raise ValueError(f"number = {number}: only {len(placed)} boxes fit with corridors of {CORRIDOR} m")
        placed.append(best)
    return [[round(float(x), 3) for x in box] for box in placed]


if __name__ == "__main__":
    for x0, y0, x1, y1 in boxes(int(sys.argv[1]), SEEDS["".join(sys.argv[2:])]):
        print(f"    - {{kind: box, low: [{x0}, {y0}, 0], high: [{x1}, {y1}, {SIZE[2]}]}}")
