"""Composable observation features of learned agents, by batched kernels; no learning library is needed."""

from baselines.features.bank import FeatureBank, SoloFeatures
from baselines.features.spec import (
    DEFAULT_FEATURES,
    BeliefFeatures,
    Feature,
    FeatureSpec,
    HitsFeatures,
    RawFeatures,
    TeamFeatures,
    make_spec,
    spec_hash,
    spec_names,
    spec_size,
    spec_slices,
)

__all__ = [
    "DEFAULT_FEATURES",
    "BeliefFeatures",
    "Feature",
    "FeatureBank",
    "FeatureSpec",
    "HitsFeatures",
    "RawFeatures",
    "SoloFeatures",
    "TeamFeatures",
    "make_spec",
    "spec_hash",
    "spec_names",
    "spec_size",
    "spec_slices",
]
