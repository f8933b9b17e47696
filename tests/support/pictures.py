"""What two frames have in common."""

import numpy as np


def same(one, other):
    """Two frames hold the same bits."""
    assert one.hashes == other.hashes and set(one.hashes) == {"visibility", "voxels", "shadow_map"}
    assert (one.triangles, one.strands, one.segments) == (other.triangles, other.strands, other.segments)
    for name in one.images:
        np.testing.assert_array_equal(one.images[name], other.images[name], err_msg=name)
