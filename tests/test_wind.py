"""wind against its twin."""

import numpy as np
import pytest
from support.hair import Hair, uneven

from clfur.stages import wind
from clfur.twin import wind as twin


@pytest.mark.small
def test_wind_is_the_twins(gpu):
    hair = Hair(gpu, uneven(np.random.default_rng(10), (4, 2, 6, 3, 3)), 0.5)
    mean, gust, size, time = (1.5, -0.5, 3), 2.0, 0.7, 12.3
    winds = gpu.download(wind.blow(gpu, hair.state, hair.roots, mean, gust, size, time, 5)).reshape(3, -1)[:, :hair.n]
    there = twin.wind_at(hair.root[0, :, :hair.n].T, mean, gust, size, time, 5)
    np.testing.assert_allclose(winds.T, there, rtol=0, atol=3e-4)   # cells away from 0 are in float32
    assert np.ptp(there, axis=0).min() > 0.1
