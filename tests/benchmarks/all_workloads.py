"""All that is measured: the workloads of every part of the package."""

from __future__ import annotations

from workloads import WORKLOADS
from workloads_fields import WORKLOADS_FIELDS
from workloads_filament import WORKLOADS_FILAMENT
from workloads_gaslam import WORKLOADS_GASLAM
from workloads_puff import WORKLOADS_PUFF
from workloads_quadrotor import WORKLOADS_QUADROTOR
from workloads_source_term import WORKLOADS_SOURCE_TERM
from workloads_swarm import WORKLOADS_SWARM
from workloads_world import WORKLOADS_WORLD

ALL_WORKLOADS = (
    WORKLOADS
    | WORKLOADS_FILAMENT
    | WORKLOADS_PUFF
    | WORKLOADS_FIELDS
    | WORKLOADS_WORLD
    | WORKLOADS_QUADROTOR
    | WORKLOADS_GASLAM
    | WORKLOADS_SOURCE_TERM
    | WORKLOADS_SWARM
)
