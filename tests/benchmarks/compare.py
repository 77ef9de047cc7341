"""One table of speed and memory: figure, target, and ratios. `python tests/benchmarks/compare.py` (some minutes).

A ratio above 1 is better than the target (or than the other code). Times are the least of many on one core, measured
in one run; compare ratios, not machines.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

from all_workloads import ALL_WORKLOADS
from workloads import RIVALS, Workload, bytes_per_agent, seconds_a_call
from workloads_filament import LONG, SHORT, bytes_per_filament

SCALE = ((1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n"))
OTHERS = {  # ours -> the other code that does the comparable thing
    "world step, 1024 worlds": "naive numpy, 1024 worlds",
    "vector view, 1024 worlds": "Gymnasium CartPole, 1024 worlds",
    "SB3 collection, 1024 worlds": "SB3's loop of CartPoles, 256 worlds",
}


def written(value: float | None, unit: str) -> str:
    """`value` with an engineering prefix."""
    if value is None:
        return ""
    factor, prefix = next(((f, p) for f, p in SCALE if abs(value) >= f), SCALE[-1])
    return f"{value / factor:.3g} {prefix}{unit.removeprefix('1')}"


def ratio(value: float, other: float | None, unit: str) -> str:
    """How many times `value` is better than `other`."""
    if other is None:
        return ""
    return f"{value / other if unit == '1/s' else other / value:.2f}"


def line(*cells: str) -> None:
    print("{:<40} {:>12} {:>12} {:>7} {:>9}".format(*cells).rstrip())


def measured(workload: Workload) -> float:
    return workload.figure(seconds_a_call(workload.prepare()))


def show(name: str, value: float, unit: str, target: float | None, other: float | None = None) -> None:
    line(name, written(value, unit), written(target, unit), ratio(value, target, unit), ratio(value, other, unit))


def main() -> None:
    """Measure everything and print the table as it grows. Throughputs count UAVs' steps."""
    line("", "figure", "target", "ratio", "x others")
    rivals: dict[str, float] = {}
    for name, workload in RIVALS.items():
        rivals[name] = measured(workload)
        show(name, rivals[name], workload.unit, None)
    values: dict[str, float] = {}
    for name, workload in ALL_WORKLOADS.items():
        values[name] = value = measured(workload)
        if name.startswith("200 runs"):
            value *= 10  # 20 runs were timed
        show(name, value, workload.unit, workload.target, rivals.get(OTHERS.get(name, "")))
    show("a reading, 10 x filaments and length", values[LONG] / values[SHORT], "", 10.0)  # times the time: below 10
    show("memory of an agent", bytes_per_agent(), "B", 1000.0)
    show("memory of a filament", bytes_per_filament(), "B", 40.0)


if __name__ == "__main__":
    main()
