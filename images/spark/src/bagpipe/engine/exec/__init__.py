"""A program that reads a file, judges itself, and gives files back (docs/reference/binpipe.md)."""
