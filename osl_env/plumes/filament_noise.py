"""Single-precision mathematics for blocks of filaments: standard normal draws by the block, and an exponential.

Normals are the cost of a filament plume, so they are drawn for a whole block in loops that LLVM vectorises. Word k of
a block is SplitMix64's output at counter k of the world's stream; its upper half gives a radius, its lower half an
angle (Box and Muller 1958): two normals a word. The radius sqrt(-2 ln u) has u = (h + 1/2) / 2^32, so draws reach 6.8
standard deviations; of the angle, two bits choose the quarter circle and the others the place within it. Logarithm,
sine and cosine are the Cephes library's single-precision polynomials (Moshier 1989; relative error 2e-7). Everything
is elementwise and without contraction: a draw depends on the stream and its place alone, not on the width of vectors.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
from numba import njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from osl_env.numerics import GAMMA, mix

SingleArray: TypeAlias = NDArray[np.float32]

BLOCK = 64  # filaments that are kept, moved, drawn for and read together
WORDS = 3 * BLOCK // 2  # random words a block: three normals a filament

_F = np.float32
_HALF, _ONE, _ZERO = _F(0.5), _F(1.0), _F(0.0)
_TO_UNIT = _F(2.0**-32)
_TO_ANGLE = _F(math.pi / 4.0 * 2.0**-31)
_ROOT_HALF_BITS = np.int32(0x3F3504F3)
_ONE_BITS = np.int32(0x3F800000)
_MANTISSA_BITS = np.int32(23)
_MINUS_TWO_LN2, _MINUS_TWO = _F(-2.0 * math.log(2.0)), _F(-2.0)
_LN2_HIGH, _LN2_LOW, _LOG2_E = _F(0.693359375), _F(-2.12194440e-4), _F(math.log2(math.e))
_ROUND = _F(12582912.0)  # 1.5 * 2^23: adding it rounds to the nearest integer
_LOWEST = _F(-87.0)
_L0, _L1, _L2 = _F(7.0376836292e-2), _F(-1.1514610310e-1), _F(1.1676998740e-1)
_L3, _L4, _L5 = _F(-1.2420140846e-1), _F(1.4249322787e-1), _F(-1.6668057665e-1)
_L6, _L7, _L8 = _F(2.0000714765e-1), _F(-2.4999993993e-1), _F(3.3333331174e-1)
_S0, _S1, _S2 = _F(-1.9515295891e-4), _F(8.3321608736e-3), _F(-1.6666654611e-1)
_C0, _C1, _C2 = _F(2.443315711809948e-5), _F(-1.388731625493765e-3), _F(4.166664568298827e-2)
_E0, _E1, _E2 = _F(1.9875691500e-4), _F(1.3981999507e-3), _F(8.3334519073e-3)
_E3, _E4 = _F(4.1665795894e-2), _F(1.6666665459e-1)
_U32 = np.uint64(32)


@intrinsic
def bits_to_single(typing_context: Any, bits: Any) -> Any:  # pragma: no cover - compiled
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], context.get_value_type(types.float32))

    return types.float32(types.int32), codegen


@intrinsic
def single_to_bits(typing_context: Any, value: Any) -> Any:  # pragma: no cover - compiled
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], context.get_value_type(types.int32))

    return types.int32(types.float32), codegen


@njit(inline="always", error_model="numpy")
def exp_single(x: Any) -> Any:
    """e**x in single precision for -87 <= x <= 0, to 1e-7; clamped from below. Vectorises."""
    x = max(x, _LOWEST)
    shifted = x * _LOG2_E + _ROUND
    k = shifted - _ROUND
    r = (x - k * _LN2_HIGH) - k * _LN2_LOW
    p = ((((_E0 * r + _E1) * r + _E2) * r + _E3) * r + _E4) * r + _HALF
    p = p * r * r + r + _ONE
    bits: Any = single_to_bits(shifted)  # type: ignore[call-arg]
    return p * bits_to_single(np.int32(np.int32(bits << _MANTISSA_BITS) + _ONE_BITS))


@njit(inline="always", error_model="numpy")
def _minus_two_log(u: Any) -> Any:
    """-2 ln(u) for 0 < u <= 1 (Cephes logf)."""
    bits: Any = single_to_bits(u)  # type: ignore[call-arg]
    exponent = np.int32(np.int32(bits - _ROOT_HALF_BITS) >> _MANTISSA_BITS)
    f = bits_to_single(np.int32(bits - np.int32(exponent << _MANTISSA_BITS))) - _ONE
    square = f * f
    p = ((((_L0 * f + _L1) * f + _L2) * f + _L3) * f + _L4) * f + _L5
    p = ((p * f + _L6) * f + _L7) * f + _L8
    log_mantissa = f * square * p - _HALF * square + f
    return max(_F(exponent) * _MINUS_TWO_LN2 + log_mantissa * _MINUS_TWO, _ZERO)


@njit(error_model="numpy")
def draw_normals(state: Any, radii: Any, angles: Any, out: Any) -> Any:
    """Fill `out` (3 * BLOCK,) with standard normals of the stream `state` (uint64); the stream's new state.

    `radii` and `angles` (WORDS,) int32 are working space.
    """
    for k in range(WORDS):
        word = mix(state + np.uint64(k + 1) * GAMMA)
        radii[k] = np.int32(word >> _U32)
        angles[k] = np.int32(word)
    first, second = out[:WORDS], out[WORDS:]
    for k in range(WORDS):
        u = (_F(np.uint32(radii[k])) + _HALF) * _TO_UNIT
        radius = math.sqrt(_minus_two_log(u))
        bits = angles[k]
        angle = _F(bits) * _TO_ANGLE
        square = angle * angle
        sine = angle + angle * square * ((_S0 * square + _S1) * square + _S2)
        cosine = _ONE - _HALF * square + square * square * ((_C0 * square + _C1) * square + _C2)
        radius = radius if bits & np.int32(2) == 0 else -radius
        upright = bits & np.int32(1) == 0
        first[k] = radius * (cosine if upright else sine)
        second[k] = radius * (sine if upright else cosine)
    return state + np.uint64(WORDS) * GAMMA


@njit(cache=True, error_model="numpy")
def normals(state: np.uint64, n_blocks: int) -> SingleArray:
    """The normals of `n_blocks` successive blocks from the stream `state`; shape (n_blocks, 3, BLOCK)."""
    out = np.empty((n_blocks, 3 * BLOCK), np.float32)
    radii, angles = np.empty(WORDS, np.int32), np.empty(WORDS, np.int32)
    for b in range(n_blocks):
        state = draw_normals(state, radii, angles, out[b])
    return out.reshape(n_blocks, 3, BLOCK)
