"""Tables 1 to 3 of the paper: five starts for each of three sources; and all fifteen cells together."""

from training.reproduce.chemotaxis.cells import Part
from training.reproduce.chemotaxis.claims import (
    CellsAlwaysSucceed,
    DetectsAfterClimb,
    DetectsAtPublishedTime,
    FlightsSucceed,
    MostDetectWithin,
    PinnedFlightsSucceed,
    SourcesInOrder,
)
from training.reproduce.chemotaxis.experiment import CellExperiment

_HEIGHTS = {1: 2, 2: 6, 3: 10}  # m above the ground
_SUCCESS_RATE = 0.95
_SOON = 20.0  # s
_CLIMB = (DetectsAfterClimb(), DetectsAtPublishedTime())
PARTS = {source: Part(f"chemotaxis_table{source}", source) for source in _HEIGHTS}


def _table(source: int) -> CellExperiment:
    return CellExperiment(
        name=f"table{source}",
        title=f"Chemotaxis, table {source}: Source {source}",
        summary=f"Flight times of chemotaxis from five starts to a source {_HEIGHTS[source]} m above the ground.",
        parts=(PARTS[source],),
        claims=(
            PinnedFlightsSucceed(),
            FlightsSucceed(_SUCCESS_RATE),
            MostDetectWithin(_SOON),
            *(_CLIMB if source == 3 else ()),
        ),
    )


ALL = CellExperiment(
    name="tables",
    title="Chemotaxis, tables 1 to 3: all fifteen cells",
    summary="Flight times of chemotaxis from five starts to sources 2, 6 and 10 m above the ground.",
    parts=tuple(PARTS.values()),
    claims=(
        PinnedFlightsSucceed(),
        CellsAlwaysSucceed(13),
        FlightsSucceed(_SUCCESS_RATE),
        SourcesInOrder(),
        MostDetectWithin(_SOON),
        *_CLIMB,
    ),
)
EXPERIMENTS = (*(_table(source) for source in PARTS), ALL)
