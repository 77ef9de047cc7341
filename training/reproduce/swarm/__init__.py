"""The experiments of the swarm paper (Swarm robotic plume tracking for intermittent and time-variant odor dispersion):
search times in a small and a large arena, its force fields, and snapshots of flights."""

from training.reproduce.report import Reproducible
from training.reproduce.swarm import forces, search_time, snapshots

_ALL: tuple[Reproducible, ...] = (*search_time.EXPERIMENTS, forces.EXPERIMENT, snapshots.EXPERIMENT)
EXPERIMENTS = {experiment.name: experiment for experiment in _ALL}
