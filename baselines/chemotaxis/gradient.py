"""The gradient of the chemotaxis paper's SEARCH: least squares over the last N positions and concentrations.

    (p_i - mean p)^T g = c_i - mean c                                              (chemotaxis eq 6)
    g = (A^T A)^-1 A^T b                                                           (chemotaxis eq 7)

solved by the singular values of A (one-sided Jacobi), which keeps small spreads of the positions exact: the normal
equations square them, and lose a spread of 1e-9 m beside one of 1 m. Singular values that do not count are left out,
which gives the solution of least norm; how many count is the rank.

On a straight flight A has no full rank, and at rest it is zero. What is done about it is the `Rule`:

    jitter        buffered positions have seeded noise (1e-9 m): A has full rank, and the missing components of g are
                  random and large: the UAV tries a random direction across its line
    probe         directions over which the positions spread by less than `probe_spread` (standard deviation) are
                  missing, and the UAV moves along one that is until none is
    minimum_norm  the missing components of g are zero (what lstsq gives): the UAV never leaves its line
    printed       no g where A^T A is singular in double precision: the UAV holds its position

A window of equal concentrations has no gradient. Eq 8 then divides by zero: `printed` holds the position, the others
go on in the last direction.
"""

from __future__ import annotations

import math
from typing import Literal, TypeAlias

import numpy as np
from numba import njit

from baselines.steering import Direction
from osl_env.parameters import FloatArray

Rule: TypeAlias = Literal["jitter", "probe", "minimum_norm", "printed"]

_EPSILON = float(np.finfo(np.float64).eps)
_SWEEPS = 40  # of Jacobi at most; it takes four to six
_DRAWN = 384  # normal numbers at once


@njit(cache=True, error_model="numpy")
def least_squares(window: FloatArray, relative: float, absolute: float, out: FloatArray) -> int:
    """Fit the plane c = g p + constant to the rows x, y, z (m), c of `window` (n, 4); gives the rank, 0 to 3.

    `out` (2, 3) gets g, in c per metre, and the direction over which the positions spread least. Singular values up to
    `relative` times the largest, or up to `absolute` m, do not count.
    """
    n = window.shape[0]
    a, v, b = np.empty((3, n)), np.eye(3), np.empty(n)
    for axis in range(4):  # relative to the first row: the mean of equal numbers is then exact
        total, first = 0.0, window[0, axis]
        for i in range(n):
            total += window[i, axis] - first
        mean = total / n
        for i in range(n):
            centred = (window[i, axis] - first) - mean
            if axis < 3:
                a[axis, i] = centred
            else:
                b[i] = centred
    for _ in range(_SWEEPS):
        if not (_turn(a, v, 0, 1) | _turn(a, v, 0, 2) | _turn(a, v, 1, 2)):
            break
    largest, smallest, weakest = 0.0, np.inf, 2
    values = np.empty(3)
    for j in range(3):
        values[j] = math.sqrt(_dot(a[j], a[j]))
        largest = max(largest, values[j])
        if values[j] <= smallest:
            smallest, weakest = values[j], j
    rank = 0
    for axis in range(3):
        out[0, axis], out[1, axis] = 0.0, v[weakest, axis]
    for j in range(3):
        if values[j] > max(relative * largest, absolute):
            rank += 1
            share = _dot(a[j], b) / values[j] / values[j]
            for axis in range(3):
                out[0, axis] += share * v[j, axis]
    return rank


@njit(error_model="numpy")
def _dot(a: FloatArray, b: FloatArray) -> float:
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@njit(error_model="numpy")
def _turn(a: FloatArray, v: FloatArray, j: int, k: int) -> bool:
    """Make rows `j` and `k` of `a` (3, n) orthogonal by a rotation, done to `v` (3, 3) too; whether it took one."""
    squared, other, mixed = _dot(a[j], a[j]), _dot(a[k], a[k]), _dot(a[j], a[k])
    if abs(mixed) <= _EPSILON * math.sqrt(squared) * math.sqrt(other):
        return False
    zeta = (other - squared) / (2.0 * mixed)
    tangent = math.copysign(1.0, zeta) / (abs(zeta) + math.sqrt(1.0 + zeta * zeta))
    cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
    sine = cosine * tangent
    for i in range(a.shape[1]):
        a[j, i], a[k, i] = cosine * a[j, i] - sine * a[k, i], sine * a[j, i] + cosine * a[k, i]
    for i in range(3):
        v[j, i], v[k, i] = cosine * v[j, i] - sine * v[k, i], sine * v[j, i] + cosine * v[k, i]
    return True


class Window:
    """The last `size` positions and concentrations of one UAV, and the direction (8) that they point to."""

    __slots__ = (
        "_absolute",
        "_count",
        "_heading",
        "_jitter",
        "_noise",
        "_out",
        "_probe",
        "_relative",
        "_rng",
        "_rows",
        "_rule",
        "_size",
    )

    def __init__(self, size: int, rule: Rule, jitter: float, probe_spread: float, rng: np.random.Generator) -> None:
        """`jitter` m is for the rule `jitter`, `probe_spread` m for `probe`; each draws from `rng` only if it must."""
        self._rows = np.zeros((size, 4))
        self._out = np.zeros((2, 3))
        self._size, self._rule, self._rng = size, rule, rng
        self._jitter = jitter if rule == "jitter" else 0.0
        self._relative = math.sqrt(_EPSILON) if rule == "printed" else size * _EPSILON
        self._absolute = probe_spread * math.sqrt(size) if rule == "probe" else 0.0
        self._noise: list[float] = []  # m, drawn ahead
        self.clear()

    def clear(self) -> None:
        """Forget everything, the last direction too."""
        self._count = 0
        self._heading: Direction | None = None
        self._probe: Direction | None = None

    @property
    def full(self) -> bool:
        """Whether there are enough readings for a gradient."""
        return self._count >= self._size

    def head(self, x: float, y: float, z: float) -> None:
        """Take (x, y, z) for the last direction; a null vector for none."""
        self._heading = _unit(x, y, z)

    def add(self, x: float, y: float, z: float, c: float) -> None:
        """Put a position, m, and its concentration in place of the oldest."""
        if self._jitter > 0.0:
            if not self._noise:
                self._noise = (self._jitter * self._rng.standard_normal(_DRAWN)).tolist()
            draw = self._noise.pop
            x, y, z = x + draw(), y + draw(), z + draw()
        self._rows[self._count % self._size] = x, y, z, c
        self._count += 1

    def direction(self) -> Direction | None:
        """Where to go, a unit vector; None: stay. The window must be full."""
        rank = least_squares(self._rows, self._relative, self._absolute, self._out)
        slope, weakest = self._out.tolist()
        if rank < 3 and self._rule == "printed":
            return None
        if rank < 3 and self._rule == "probe":
            return self._across(weakest[0], weakest[1], weakest[2])
        self._probe = None
        uphill = _unit(slope[0], slope[1], slope[2])
        if uphill is None:
            if self._rule == "printed":
                return None
            uphill = self._heading or self._any()
        self._heading = uphill
        return uphill

    @property
    def probing(self) -> bool:
        """Whether the last direction was that of a probe."""
        return self._probe is not None

    def turn_back(self) -> Direction:
        """Probe the other way, for the last one is closed."""
        x, y, z = self._probe or (0.0, 0.0, 0.0)
        self._probe = (-x, -y, -z)
        return self._probe

    def _across(self, x: float, y: float, z: float) -> Direction:
        """A probe along (x, y, z), to the side that the last one went to; to either side at first."""
        before = self._probe
        same = self._rng.random() < 0.5 if before is None else x * before[0] + y * before[1] + z * before[2] >= 0.0
        self._probe = (x, y, z) if same else (-x, -y, -z)
        return self._probe

    def _any(self) -> Direction:
        """A random direction."""
        u, v, w = self._rng.standard_normal(3).tolist()
        return _unit(u, v, w) or (1.0, 0.0, 0.0)


def _unit(x: float, y: float, z: float) -> Direction | None:
    """(x, y, z) of length 1; None for a null vector, or one that is not finite."""
    length = math.hypot(x, y, z)
    return (x / length, y / length, z / length) if 0.0 < length < math.inf else None
