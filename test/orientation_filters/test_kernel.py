# SPDX-License-Identifier: Apache-2.0
"""Kernels divide by zero as IEEE 754 says; inlined functions stay plain Python elsewhere."""

from __future__ import annotations

from math import inf
from types import FunctionType

from orientation_filters.kernel import inline, kernel


@inline
def half(value: float) -> float:
    return 0.5 * value


@kernel
def half_ratio(a: float, b: float) -> float:
    return half(a) / b


def test_a_kernel_divides_without_a_check() -> None:
    assert half_ratio(3.0, 2.0) == 0.75
    assert half_ratio(-1.0, 0.0) == -inf


def test_an_inlined_function_is_plain_python_outside_kernels() -> None:
    assert isinstance(half, FunctionType)
    assert half(3.0) == 1.5
    assert half_ratio.overloads  # compiled, unlike `half`
