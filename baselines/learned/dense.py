"""Layers in compiled code whose sums have one fixed order: a row's result does not depend on the other rows.

A library's matrix product picks its blocking, and so the order of its sums, by the number of rows; an action could then
depend on how many episodes are flown side by side. Here every output adds its terms one by one, in the order of the
inputs, whatever the batch; the loop over the outputs is what is vectorised. Single precision, without contraction.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from osl_env.numerics import exp

Float32Array = NDArray[np.float32]
MaskArray = NDArray[np.bool_]

NONE, TANH, RELU = 0, 1, 2  # activations


@njit(cache=True, error_model="numpy")
def dense(inputs: Float32Array, weights: Float32Array, outputs: Float32Array) -> None:
    """outputs (n, m) += inputs (n, k) weights (k, m)."""
    n_inputs, n_outputs = weights.shape
    for row in range(inputs.shape[0]):
        x, y = inputs[row], outputs[row]
        k = 0
        while k + 4 <= n_inputs:  # four inputs in one pass over the outputs: a quarter of the loads and stores
            x0, x1, x2, x3 = x[k], x[k + 1], x[k + 2], x[k + 3]
            w0, w1, w2, w3 = weights[k], weights[k + 1], weights[k + 2], weights[k + 3]
            for j in range(n_outputs):
                y[j] = (((y[j] + x0 * w0[j]) + x1 * w1[j]) + x2 * w2[j]) + x3 * w3[j]
            k += 4
        while k < n_inputs:
            x0, w0 = x[k], weights[k]
            for j in range(n_outputs):
                y[j] = y[j] + x0 * w0[j]
            k += 1


@njit(inline="always", error_model="numpy")
def _sigmoid(x: Any) -> Any:
    return 1.0 / (1.0 + exp(-x))


@njit(inline="always", error_model="numpy")
def _tanh(x: Any) -> Any:
    return 1.0 - 2.0 / (exp(2.0 * x) + 1.0)


@njit(cache=True, error_model="numpy")
def activate(values: Float32Array, activation: int) -> None:
    """Apply `activation` to each of `values` (n, m), in place."""
    flat = values.reshape(-1)
    if activation == TANH:
        for k in range(flat.size):
            flat[k] = _tanh(flat[k])
    elif activation == RELU:
        zero = np.float32(0.0)
        for k in range(flat.size):
            flat[k] = max(flat[k], zero)


@njit(cache=True, error_model="numpy")
def lstm_cell(gates: Float32Array, hidden: Float32Array, cell: Float32Array) -> None:
    """One step of an LSTM from its `gates` (n, 4 h) in torch's order (input, forget, cell, output).

    `hidden` and `cell` (n, h) are replaced by their next values.
    """
    n, size = hidden.shape
    for row in range(n):
        for j in range(size):
            into, keep = _sigmoid(gates[row, j]), _sigmoid(gates[row, size + j])
            fresh, out = _tanh(gates[row, 2 * size + j]), _sigmoid(gates[row, 3 * size + j])
            c = np.float32(keep * cell[row, j] + into * fresh)
            cell[row, j] = c
            hidden[row, j] = out * _tanh(c)


@njit(cache=True, error_model="numpy")
def attend(
    query: Float32Array, keys: Float32Array, values: Float32Array, present: MaskArray, pooled: Float32Array
) -> None:
    """Scaled dot-product attention of `query` (n, d) over the entries that are `present` (n, s); 0 if none is.

    `keys` and `values` (n s, d), `pooled` (n, d). Softmax of q k / sqrt(d) (Vaswani et al. 2017, eq 1).
    """
    n, slots = present.shape
    size = query.shape[1]
    scale = 1.0 / np.sqrt(size)
    weight = np.empty(slots)
    for row in range(n):
        highest = -np.inf
        for slot in range(slots):
            if present[row, slot]:
                product = 0.0
                for j in range(size):
                    product += query[row, j] * keys[row * slots + slot, j]
                weight[slot] = product * scale
                highest = max(highest, weight[slot])
        total = 0.0
        for slot in range(slots):
            if present[row, slot]:
                weight[slot] = exp(weight[slot] - highest)
                total += weight[slot]
        pooled[row] = 0.0
        for slot in range(slots):
            if present[row, slot]:
                share = weight[slot] / total
                for j in range(size):
                    pooled[row, j] += share * values[row * slots + slot, j]


@njit(cache=True, error_model="numpy")
def pool_mean(entries: Float32Array, present: MaskArray, pooled: Float32Array) -> None:
    """The mean of the `entries` (n s, d) that are `present` (n, s) into `pooled` (n, d); 0 if none is."""
    n, slots = present.shape
    for row in range(n):
        pooled[row] = 0.0
        count = 0
        for slot in range(slots):
            if present[row, slot]:
                count += 1
                for j in range(pooled.shape[1]):
                    pooled[row, j] += entries[row * slots + slot, j]
        for j in range(pooled.shape[1]):
            pooled[row, j] /= np.float32(max(count, 1))


@njit(cache=True, error_model="numpy")
def pool_max(entries: Float32Array, present: MaskArray, pooled: Float32Array) -> None:
    """The greatest of the `entries` (n s, d) that are `present` (n, s) into `pooled` (n, d); 0 if none is."""
    n, slots = present.shape
    for row in range(n):
        pooled[row] = 0.0
        first = True
        for slot in range(slots):
            if present[row, slot]:
                for j in range(pooled.shape[1]):
                    entry = entries[row * slots + slot, j]
                    pooled[row, j] = entry if first else max(pooled[row, j], entry)
                first = False
