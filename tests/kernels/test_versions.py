"""How often a kernel is compiled: once for all numbers that are written down, and not by itself where it is a part of another."""

from typing import Any

import numpy as np
import pytest

from uavcover.kernels import jit
from uavcover.kernels.arrays import read_only

pytestmark = pytest.mark.skipif(bool(jit.SETTINGS.DISABLE_JIT), reason="nothing is compiled")


def test_numbers_share_a_version_and_a_part_of_another_kernel_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jit, "keep_compiled", lambda _: None)

    @jit.kernel
    def twice(x: int, minus: bool) -> int:
        return -2 * x if minus else 2 * x

    @jit.inlined_kernel
    def thrice(x: int) -> int:
        if x < 0:
            return 0
        return 3 * x

    @jit.kernel
    def of_both(x: int) -> int:
        return twice(3, False) + twice(x, True) + twice(4, minus=x > 0) + thrice(x)

    kernels: list[Any] = [of_both, twice, thrice]
    assert of_both(5) == 6 - 10 - 8 + 15
    assert [len(each.signatures) for each in kernels] == [1, 1, 0]


def test_read_only_numbers_leave_the_callers_array_as_it_is() -> None:
    mine = np.zeros((3, 2))
    given = read_only(mine[:, 0])
    assert (given.flags.writeable, given.flags.c_contiguous, mine.flags.writeable) == (False, True, True)
    assert not read_only(mine).flags.writeable
    assert mine.flags.writeable
