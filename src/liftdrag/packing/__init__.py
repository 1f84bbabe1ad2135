"""The initial beds: packed at random, never poured."""

from liftdrag.packing.tank import Container, random_bed, square_layer

__all__ = ["Container", "random_bed", "square_layer"]
