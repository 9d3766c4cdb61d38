"""Pieces of recordings, one after the other, as one case."""
