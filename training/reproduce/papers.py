"""The papers that `osl reproduce` knows, by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from training.reproduce import chemotaxis, gaslam, muc_osl, swarm
from training.reproduce.report import Reproducible


@dataclass(frozen=True)
class Paper:
    """Experiments by name, in the order of `all`."""

    experiments: Mapping[str, Reproducible]
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # name -> the experiments that it means

    def chosen(self, name: str) -> list[Reproducible]:
        """What `name` means: `all`, a group or an experiment. Raises LookupError for another."""
        if name == "all":
            return list(self.experiments.values())
        return [self.experiments[member] for member in self.groups.get(name, (name,))]

    @property
    def names(self) -> list[str]:
        """What can be chosen."""
        return [*self.experiments, *self.groups, "all"]


PAPERS = {
    "muc-osl": Paper(muc_osl.EXPERIMENTS, muc_osl.GROUPS),
    "chemotaxis": Paper(chemotaxis.EXPERIMENTS),
    "gaslam": Paper(gaslam.EXPERIMENTS),
    "swarm": Paper(swarm.EXPERIMENTS),
}
