"""Speed and memory. Timed by `make bench` alone (`--benchmark-only`); otherwise every workload runs once.

No time is asserted: machines differ. `compare.py` sets the figures against their targets and against others' code.
"""

from __future__ import annotations

from typing import Any

import pytest
from all_workloads import ALL_WORKLOADS
from workloads import bytes_per_agent
from workloads_filament import bytes_per_filament

SLOW = ("200 runs", "import", "PPO")  # measured once: a call takes seconds


@pytest.mark.parametrize("name", ALL_WORKLOADS)
def test_speed(benchmark: Any, name: str) -> None:
    workload = ALL_WORKLOADS[name]
    call = workload.prepare()
    if benchmark.enabled:
        call()  # compiles
    benchmark.extra_info |= {"unit": workload.unit, "count": workload.count, "target": workload.target}
    if name.startswith(SLOW):
        benchmark.pedantic(call, rounds=2)
    else:
        benchmark(call)
    if benchmark.enabled:
        benchmark.extra_info["figure"] = workload.figure(benchmark.stats.stats.min)


def test_memory_of_an_agent() -> None:
    assert bytes_per_agent() < 1000  # the limit; not a time, so it may be asserted


def test_memory_of_a_filament() -> None:
    assert bytes_per_filament() <= 40
