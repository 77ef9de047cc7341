"""Speed of the Gaussian puffs. Timed by `make bench` alone (`--benchmark-only`); otherwise every workload runs once."""

from __future__ import annotations

from typing import Any

import pytest
from workloads_puff import WORKLOADS


@pytest.mark.parametrize("name", WORKLOADS)
def test_speed(benchmark: Any, name: str) -> None:
    workload = WORKLOADS[name]
    call = workload.prepare()
    if benchmark.enabled:
        call()  # compiles
    benchmark.extra_info |= {"unit": workload.unit, "count": workload.count, "target": workload.target}
    benchmark(call)
    if benchmark.enabled:
        benchmark.extra_info["figure"] = workload.figure(benchmark.stats.stats.min)
