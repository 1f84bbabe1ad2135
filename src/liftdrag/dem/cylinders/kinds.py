"""The contact types of flat-ended cylinders and of spheres, by number."""

from __future__ import annotations

FACE_FACE, FACE_BAND, FACE_EDGE, PARALLEL_BANDS, SKEWED_BANDS, BAND_EDGE, EDGE_EDGE = range(7)
SPHERES, FACE_SPHERE, BAND_SPHERE, EDGE_SPHERE = range(7, 11)

APART = -1

KINDS = (
    "face-face",
    "face-band",
    "face-edge",
    "parallel bands",
    "skewed bands",
    "band-edge",
    "edge-edge",
    "spheres",
    "face-sphere",
    "band-sphere",
    "edge-sphere",
)
"""Names in the order of the numbers."""
