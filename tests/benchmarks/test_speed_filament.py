"""Speed and memory of the filament plume; see `test_speed`."""

from __future__ import annotations

from typing import Any

import pytest
from workloads_filament import WORKLOADS_FILAMENT, bytes_per_filament


@pytest.mark.parametrize("name", WORKLOADS_FILAMENT)
def test_speed_of_filaments(benchmark: Any, name: str) -> None:
    workload = WORKLOADS_FILAMENT[name]
    call = workload.prepare()
    benchmark.extra_info |= {"unit": workload.unit, "count": workload.count, "target": workload.target}
    benchmark(call)
    if benchmark.enabled:
        benchmark.extra_info["figure"] = workload.figure(benchmark.stats.stats.min)


def test_memory_of_a_filament() -> None:
    assert bytes_per_filament() <= 40  # the limit; not a time, so it may be asserted
