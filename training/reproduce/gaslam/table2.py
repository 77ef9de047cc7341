"""Table II of the paper: cases A to D in an ideal plume; and the same in a meandering wind with a lagging sensor."""

from training.reproduce.gaslam.averages import EMPTY, MEASURES
from training.reproduce.gaslam.claims import (
    AsGoodAsPublished,
    ErrorBelow,
    GasClaim,
    MapsBetterThanNothing,
    Places,
    RunsSucceed,
)
from training.reproduce.gaslam.experiment import GasExperiment
from training.reproduce.gaslam.published import TABLE2

_RIVALS = ("rahbar-ste", "boustrophedon-ste", "kernel-peak")
_CLAIMS: tuple[GasClaim, ...] = (
    RunsSucceed(),
    *(AsGoodAsPublished(case, measure) for case in TABLE2 for measure in MEASURES),
    ErrorBelow(0.6),
    *(Places(rival) for rival in _RIVALS),
    *(MapsBetterThanNothing(measure) for measure in EMPTY),
)

IDEAL = GasExperiment(
    name="table2",
    title="GaSLAM, table II: cases A to D in an ideal plume",
    summary="The source in y and z drawn anew for each of ten runs a case; a constant wind and a sensor without lag.",
    benchmark="gaslam_table2",
    claims=_CLAIMS,
)
REAL = GasExperiment(
    name="real",
    title="GaSLAM, table II with meander and lag",
    summary="Table II again in a wind that meanders and with a sensor that lags by 1 s.",
    benchmark="gaslam_real",
    claims=_CLAIMS,
)
