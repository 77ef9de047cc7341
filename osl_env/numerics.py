"""Scalar mathematics for the kernels: exponential, random numbers and Poisson draws that numba can inline.

`exp` is written out so that LLVM vectorises loops over it and so that a result never depends on the C library, on
the position in a batch or on a remainder loop: row i of a batch equals a batch of one, bit for bit.

Random numbers are SplitMix64 (Steele, Lea and Flood 2014): a stream is one unsigned 64-bit state, so a world can
keep one for every UAV and purpose. Streams are made in `osl_env.streams` and nowhere else; the functions here take
the state and give back the new state with the draw.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

GAMMA = np.uint64(0x9E3779B97F4A7C15)  # SplitMix64's increment (the golden ratio times 2^64)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_U30, _U27, _U31, _U11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
_TO_UNIT = 2.0**-53

_LOG2_E = 1.4426950408889634
_LN2_HIGH = 6.93147180369123816490e-01  # ln 2 in two parts (Cody and Waite), so that k ln 2 is subtracted exactly
_LN2_LOW = 1.90821492927058770002e-10
_ROUND = 6755399441055744.0  # 1.5 * 2^52: adding it rounds a double to the nearest integer
_ONE_BITS = np.int64(0x3FF0000000000000)
_MANTISSA_BITS = np.int64(52)
POISSON_INVERSION_LIMIT = 10.0  # below: sequential search of the distribution; above: transformed rejection


@intrinsic
def _bits_to_float(typing_context: Any, bits: Any) -> Any:  # pragma: no cover - compiled
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], context.get_value_type(types.float64))

    return types.float64(types.int64), codegen


@intrinsic
def float_to_bits(typing_context: Any, value: Any) -> Any:  # pragma: no cover - compiled
    """The 64 bits of a double, as an integer: of numbers that are not negative, they order as the numbers do."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], context.get_value_type(types.int64))

    return types.int64(types.float64), codegen


@njit(inline="always", error_model="numpy")
def exp(x: float) -> float:
    """e**x to 1 unit in the last place for -708 <= x <= 709; clamped to that range outside it. Vectorises."""
    x = min(max(x, -708.0), 709.0)
    shifted = x * _LOG2_E + _ROUND
    k = shifted - _ROUND
    r = (x - k * _LN2_HIGH) - k * _LN2_LOW
    p = 1.6059043836821613e-10  # Taylor coefficients 1/13! .. 1/0! on |r| <= ln(2) / 2
    p = p * r + 2.08767569878681e-09
    p = p * r + 2.505210838544172e-08
    p = p * r + 2.755731922398589e-07
    p = p * r + 2.7557319223985893e-06
    p = p * r + 2.48015873015873e-05
    p = p * r + 0.0001984126984126984
    p = p * r + 0.001388888888888889
    p = p * r + 0.008333333333333333
    p = p * r + 0.041666666666666664
    p = p * r + 0.16666666666666666
    p = p * r + 0.5
    p = p * r + 1.0
    p = p * r + 1.0
    return float(p * _bits_to_float((float_to_bits(shifted) << _MANTISSA_BITS) + _ONE_BITS))  # type: ignore[call-arg]


@njit(inline="always")
def mix(z: np.uint64) -> np.uint64:
    """SplitMix64's output function: a bijection of 64-bit words whose outputs look independent."""
    z = (z ^ (z >> _U30)) * _MIX_1
    z = (z ^ (z >> _U27)) * _MIX_2
    return z ^ (z >> _U31)


@njit(inline="always")
def uniform(state: np.uint64) -> tuple[np.uint64, float]:
    """The stream's new state and a draw from [0, 1)."""
    state = state + GAMMA
    return state, float(mix(state) >> _U11) * _TO_UNIT


@njit(error_model="numpy", cache=True)
def normal(state: np.uint64) -> tuple[np.uint64, float]:
    """The stream's new state and a standard normal draw (Box and Muller; two uniforms a draw, so no hidden state)."""
    state, first = uniform(state)
    state, second = uniform(state)
    return state, math.sqrt(-2.0 * math.log(1.0 - first)) * math.cos(2.0 * math.pi * second)


@njit(error_model="numpy", cache=True)
def _poisson_by_rejection(state: np.uint64, mean: float) -> tuple[np.uint64, int]:
    """Transformed rejection with squeeze (Hoermann 1993, PTRS), for means of 10 and above."""
    log_mean = math.log(mean)
    b = 0.931 + 2.53 * math.sqrt(mean)
    a = -0.059 + 0.02483 * b
    inverse_alpha = 1.1239 + 1.1328 / (b - 3.4)
    v_r = 0.9277 - 3.6224 / (b - 2.0)
    while True:
        state, first = uniform(state)
        state, v = uniform(state)
        u = first - 0.5
        us = 0.5 - abs(u)
        k = math.floor((2.0 * a / us + b) * u + mean + 0.43) if us > 0.0 else -1.0
        if us >= 0.07 and v <= v_r:
            return state, int(k)
        if k < 0.0 or (us < 0.013 and v > us):
            continue
        left = math.log(max(v, 1e-300)) + math.log(inverse_alpha) - math.log(a / (us * us) + b)
        if left <= -mean + k * log_mean - math.lgamma(k + 1.0):
            return state, int(k)


@njit(error_model="numpy", cache=True)
def poisson(state: np.uint64, mean: float) -> tuple[np.uint64, int]:
    """The stream's new state and a Poisson draw with the given mean >= 0 (the method is chosen by the mean)."""
    if mean >= POISSON_INVERSION_LIMIT:
        return _poisson_by_rejection(state, mean)
    state, u = uniform(state)
    if u < 1.0 - mean:  # 1 - mean <= exp(-mean): no hit, without an exponential; the common case far from a source
        return state, 0
    probability = exp(-mean)
    cumulative = probability
    k = 0
    while u >= cumulative and k < 200:
        k += 1
        probability *= mean / k
        cumulative += probability
    return state, k
