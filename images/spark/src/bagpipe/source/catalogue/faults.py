"""What is wrong with a catalogue, its expression, or what the two select."""

from bagpipe.matrix.faults import MatrixError


class CatalogueError(MatrixError):
    """The recordings can't be selected; the sentence names file, line, column and what to write."""
