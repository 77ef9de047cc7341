"""What "GaSLAM: an algorithm for simultaneous gas source localization and gas distribution mapping in 3D" prints.

Table II: means of ten simulated flights in each case, position errors in m. Of its cases A to D these pages hold the
rows A and D.
"""

from __future__ import annotations

import math

TABLE2: dict[str, dict[str, float]] = {
    "A": {"rmse": 0.0486, "rmse_ste": 0.0384, "sc": 0.7321, "pe": 0.3732, "m": 1.8663},
    "D": {"rmse": 0.0477, "rmse_ste": 0.0638, "sc": 0.8214, "pe": 0.3700, "m": 2.1141},
}
CASES = {  # wind speed and release rate
    "A": "0.2 m/s, low",
    "B": "0.2 m/s, high",
    "C": "0.7 m/s, low",
    "D": "0.7 m/s, high",
}
N_RUNS = 10  # a case
SUCCESS_RATE = 0.95  # about: an error along x of at most 5 m


def published(case: str, measure: str) -> float:
    """The paper's mean of `measure` in `case`; NaN where it is not known here."""
    return TABLE2.get(case, {}).get(measure, math.nan)
