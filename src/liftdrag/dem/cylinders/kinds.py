"""The contact types of two flat-ended cylinders, by number."""

from __future__ import annotations

FACE_FACE, FACE_BAND, FACE_EDGE, PARALLEL_BANDS, SKEWED_BANDS, BAND_EDGE, EDGE_EDGE = range(7)

APART = -1

KINDS = (
    "face-face",
    "face-band",
    "face-edge",
    "parallel bands",
    "skewed bands",
    "band-edge",
    "edge-edge",
)
"""Names in the order of the numbers."""
