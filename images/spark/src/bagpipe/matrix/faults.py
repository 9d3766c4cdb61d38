"""What is wrong with a matrix, its rules, its templates, or the variants that use them."""


class MatrixError(ValueError):
    """The spec can't be expanded into cases; the sentence names the place and what to write."""
