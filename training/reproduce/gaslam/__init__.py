"""The experiments of the GaSLAM paper: table II beside trivial answers, the same with meander and lag, the maps of
single runs, and ablations."""

from training.reproduce.gaslam import ablation, map_pictures, table2
from training.reproduce.report import Reproducible

_ALL: tuple[Reproducible, ...] = (table2.IDEAL, table2.REAL, map_pictures.EXPERIMENT, ablation.EXPERIMENT)
EXPERIMENTS = {experiment.name: experiment for experiment in _ALL}
