"""zscan against its twin: whole numbers until the end, so the floats are the same bits."""

import numpy as np
import pytest

from clfur.stages.zscan import zscan
from clfur.twin import zscan as twin


@pytest.mark.small
@pytest.mark.parametrize("shape", [(1, 4, 4), (2, 24, 2), (7, 3, 16), (33, 6, 8), (16, 16, 16)])
@pytest.mark.parametrize("crossing_unit", [1, 256, 65536])
def test_sums_equal_the_twin(gpu, shape, crossing_unit):
    # Up to 2^32 - 1 in all: sums beyond 2^24 must be rounded once, from the whole number.
    cells = np.random.default_rng(1).integers(0, 2**32 // shape[0], shape).astype(np.uint32)
    cells[0, 0, :2] = 0, 2**32 - 1
    cells[1:, 0, 1] = 0
    sums = zscan(gpu, gpu.upload(cells), crossing_unit).get()
    assert sums.shape == (shape[0] + 1, *shape[1:]) and sums.dtype == np.float32
    assert not sums[0].any()                                 # nothing lies before the first layer
    np.testing.assert_array_equal(sums, twin.zscan(cells, crossing_unit))
    assert (np.diff(sums, axis=0) >= 0).all()


@pytest.mark.small
def test_a_column_knows_no_other(gpu):
    cells = np.zeros((5, 8, 6), np.uint32)
    cells[2, 3, 4] = 7
    sums = zscan(gpu, gpu.upload(cells), 1).get()
    expected = np.zeros((6, 8, 6))
    expected[3:, 3, 4] = 7
    np.testing.assert_array_equal(sums, expected)


def test_two_runs_give_the_same_bits(gpu):
    cells = gpu.upload(np.random.default_rng(2).integers(0, 2**20, (48, 32, 48)).astype(np.uint32))
    assert zscan(gpu, cells, 4096).get().tobytes() == zscan(gpu, cells, 4096).get().tobytes()
