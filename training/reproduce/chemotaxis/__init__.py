"""The experiments of the chemotaxis paper (3-dimensional gas source localization via chemotaxis): tables 1 to 3 of
flight times, one a source, its parameter study on Source 1, and its pictures of trajectories."""

from training.reproduce.chemotaxis import parameters, tables_of_paper, trajectories
from training.reproduce.report import Reproducible

_ALL: tuple[Reproducible, ...] = (*tables_of_paper.EXPERIMENTS, parameters.EXPERIMENT, trajectories.EXPERIMENT)
EXPERIMENTS = {experiment.name: experiment for experiment in _ALL}
