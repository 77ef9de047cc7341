"""Fits the rate plume that policies are told of to what a sensor counts in a scenario's own plume.

    python tools/told_plume.py puff-real-hits [--worlds 128] [--samples 20] [--sampling-time 0.5]

Policies that count hits understand one law of the plume (`osl_env.plumes.hit_rate`, MUC-OSL eqs 1 and 2), with

    R(u | s) = a Q / r exp( (u - s) . V / (2 D) - r / lambda ),   r = |u - s|

In another plume they are told of the one whose Poisson likelihood is greatest: over places drawn uniformly from the
arena outside the success radius, with sources, winds and plumes as the scenario draws them, a Q, D and tau minimise

    sum over places of  R - c log R,   c = concentration / count_unit                    (-log likelihood a second)

which depends on the concentrations by their mean alone, at each place relative to the source and the mean wind. It is
what a policy's own likelihood would find best if it could tune them.

`count_unit` itself is not fitted. It says how much noise a policy takes counts to have: a count of c dt / u has the
variance of Poisson's law if u = dt var c / mean c. That is printed for each distance, with the counts on the axis as
they are and as they are told, and how high the plume's mean height lies above the source (`plume.rise`), which the
rate plume does not know: a policy that trusts it believes in a source so much too high.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from osl_env import load_scenario
from osl_env.parameters import FloatArray
from osl_env.plumes.hit_rate import HitRatePlume
from osl_env.scenario import Scenario
from osl_env.state import IntArray
from osl_env.world import World

_STATIONS = np.array([2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, 25.0])  # m downwind
_ACROSS, _UP = np.linspace(-12.0, 12.0, 49), np.linspace(-10.0, 10.0, 41)  # m from the axis
_LEAST = 1e-12  # 1/s: a rate has a logarithm
_LONGEST = 1e4  # s: no decay; also the greatest of the other two numbers


@dataclass(frozen=True)
class Counts:
    """Concentrations c / count_unit, 1/s, of the plume at `places` (n, 3), m, from the source; x is downwind."""

    places: FloatArray
    rates: FloatArray  # (n,)
    axis_mean: FloatArray  # (stations,) of c / count_unit on the axis
    axis_variance: FloatArray
    across: FloatArray  # (stations, 49): means on the line across the wind
    up: FloatArray  # (stations, 41): and on the upright


def _relative(scenario: Scenario, seeds: IntArray) -> FloatArray:
    """(n, 3, 3): columns are downwind, crosswind and up in the episodes with `seeds`."""
    wind = scenario.wind.draw(seeds)
    along = wind / np.linalg.norm(wind, axis=1, keepdims=True)
    up = np.tile([0.0, 0.0, 1.0], (len(seeds), 1))
    return np.stack([along, np.cross(up, along), up], axis=2)


def measure(scenario: Scenario, worlds: int, samples: int, places: int = 1000, first_seed: int = 0) -> Counts:
    """What the plume of `scenario` would be counted at, over `worlds` episodes and `samples` moments 2.5 s apart.

    The sensor's noise and lag are left out; both leave the mean.
    """
    unit = float(getattr(scenario.gas_sensor, "count_unit", None) or 1.0)
    seeds = np.arange(first_seed, first_seed + worlds)
    world = World(scenario, worlds)
    world.reset(seeds)
    axes = _relative(scenario, seeds)
    rng = np.random.default_rng(first_seed)
    spread = rng.uniform(0.0, 1.0, (worlds, places, 3)) * np.array(scenario.arena.size)
    line = _STATIONS[:, None, None] * np.array([1.0, 0.0, 0.0])
    cross = line + _ACROSS[None, :, None] * np.array([0.0, 1.0, 0.0])
    upright = line + _UP[None, :, None] * np.array([0.0, 0.0, 1.0])
    relative = np.concatenate([line[:, 0], cross.reshape(-1, 3), upright.reshape(-1, 3)])
    total, axis = np.zeros((worlds, places + len(relative))), np.zeros((samples, worlds, len(_STATIONS)))
    for k in range(samples):
        for e in range(worlds):
            around = world.source_position[e, 0] + relative @ axes[e].T
            readings = world.concentration(e, np.concatenate([spread[e], around])) / unit
            total[e] += readings / samples
            axis[k, e] = readings[places : places + len(_STATIONS)]
        world.run_air(2.5)
    offsets = np.einsum("npi,nij->npj", spread - world.source_position[:, :1], axes)
    around = total[:, places + len(_STATIONS) :].mean(axis=0)
    outside = np.linalg.norm(offsets, axis=2) > scenario.ending.success_radius
    cut = len(_STATIONS) * len(_ACROSS)
    return Counts(
        offsets[outside],
        total[:, :places][outside],
        axis.mean(axis=(0, 1)),
        axis.var(axis=(0, 1)),
        around[:cut].reshape(len(_STATIONS), -1),
        around[cut:].reshape(len(_STATIONS), -1),
    )


def told_rate(plume: HitRatePlume, offsets: FloatArray, speed: float) -> FloatArray:
    """The rate, 1/s, of `plume` at `offsets` (.., 3), m, from the source, in a wind of `speed` m/s along x."""
    return plume.field(offsets, np.zeros((1, 3)), np.ones(1), np.array([speed, 0.0, 0.0]))


def fit(counts: Counts, speed: float) -> HitRatePlume:
    """The rate plume of greatest likelihood."""

    def plume(logs: FloatArray) -> HitRatePlume:
        strength, diffusivity, lifetime = np.exp(np.clip(logs, -9.0, math.log(_LONGEST)))
        return HitRatePlume(source_strength=strength, diffusivity=diffusivity, lifetime=lifetime)

    def loss(logs: FloatArray) -> float:
        told = np.maximum(told_rate(plume(logs), counts.places, speed), _LEAST)
        return float(np.mean(told - counts.rates * np.log(told)))

    first = np.log([max(counts.axis_mean[4] * _STATIONS[4], 1e-3), 1.0, 30.0])
    options = {"xatol": 1e-6, "fatol": 1e-12, "maxiter": 4000, "maxfev": 4000}
    return plume(minimize(loss, first, method="Nelder-Mead", options=options).x)


def explained(counts: Counts, plume: HitRatePlume, speed: float) -> float:
    """Share of the Poisson deviance of the rates about their mean over all places that `plume` explains."""

    def deviance(told: FloatArray) -> float:
        rates, told = np.maximum(counts.rates, _LEAST), np.maximum(told, _LEAST)
        return float(2.0 * np.sum(rates * np.log(rates / told) - (rates - told)))

    flat = np.full(len(counts.rates), counts.rates.mean())
    return 1.0 - deviance(told_rate(plume, counts.places, speed)) / deviance(flat)


def _report(counts: Counts, plume: HitRatePlume, speed: float, sampling_time: float, unit: float) -> None:
    print(f"{plume.summary}; explains {explained(counts, plume, speed):.1%} of the deviance")
    print("   x, m  counts/s   told  ratio   unit of Poisson's noise   width y, told   height, told (m)")
    for k, x in enumerate(_STATIONS):
        line = np.array([x, 0.0, 0.0])
        told = float(told_rate(plume, line, speed))
        across = told_rate(plume, line + np.outer(_ACROSS, [0.0, 1.0, 0.0]), speed)
        poisson = sampling_time * counts.axis_variance[k] / counts.axis_mean[k] * unit
        print(
            f"{x:7.0f}{counts.axis_mean[k]:10.3g}{told:7.3g}{told / counts.axis_mean[k]:7.2f}{poisson:26.3g}"
            f"{_width(_ACROSS, counts.across[k]):10.2f}{_width(_ACROSS, across):7.2f}"
            f"{np.average(_UP, weights=counts.up[k]):11.2f}   0"
        )


def _width(places: FloatArray, weights: FloatArray) -> float:
    mean = np.average(places, weights=weights)
    return float(np.sqrt(np.average((places - mean) ** 2, weights=weights)))


def main() -> None:
    """Measure, fit and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario")
    parser.add_argument("--worlds", type=int, default=128)
    parser.add_argument("--samples", type=int, default=20, help="moments of each world, 2.5 s apart")
    parser.add_argument("--sampling-time", type=float, default=None, help="s; default: the vehicle's hover_time")
    parser.add_argument("--length", type=float, default=float(_STATIONS[-1]), help="m, of the farthest station")
    given = parser.parse_args()
    scale = given.length / float(_STATIONS[-1])
    for lengths in (_STATIONS, _ACROSS, _UP):
        lengths *= scale
    scenario = load_scenario(given.scenario)
    sampling_time = given.sampling_time or scenario.vehicle.hover_time
    speed = float(np.linalg.norm(scenario.wind.draw(np.arange(1))))
    unit = float(getattr(scenario.gas_sensor, "count_unit", None) or 1.0)
    print(f"{scenario.name}: count_unit {unit:g}, wind {speed:g} m/s, samples of {sampling_time:g} s")
    counts = measure(scenario, given.worlds, given.samples)
    _report(counts, fit(counts, speed), speed, sampling_time, unit)
    still = scenario.override(**{"plume.rise": 0.0})
    print("without the plume's rise:")
    level = measure(still, given.worlds, given.samples)
    _report(level, fit(level, speed), speed, sampling_time, unit)
    if isinstance(scenario.advertised_plume, HitRatePlume):
        print("as the scenario tells it:")
        _report(counts, scenario.advertised_plume, speed, sampling_time, unit)


if __name__ == "__main__":
    main()
