"""What lies at places of a scene's strands and body, in float64."""

import numpy as np

from ..twin import shade


def on_strand(hair, fibre, share):
    """(strand [n], unit tangent [n, 3], colour [n, 3]) a share of the way along segments."""
    first, strand = hair.first[fibre], hair.owner[fibre]
    t = hair.tangents[first] + share[:, None] * (hair.tangents[first + 1] - hair.tangents[first])
    length = np.linalg.norm(t, axis=1, keepdims=True)
    t = np.where(length > 1e-15, t / np.where(length > 1e-15, length, 1), hair.tangents[first])
    return strand, t, shade.strand_color(hair, first, strand, share)


def on_body(scene, body, triangle, p, v):
    """(unit normals on the side that v sees, colours) [n, 3] of places p of triangles."""
    n, weights = shade.on_body(body, triangle, p, v)
    if not isinstance(scene.body_color, tuple):
        return n, np.broadcast_to(np.asarray(scene.body_color, float), n.shape)
    return n, shade.painted(body, scene.body_color, scene.mesh and scene.mesh.material_of, triangle, weights)
