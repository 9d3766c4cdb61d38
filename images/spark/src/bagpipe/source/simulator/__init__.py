"""A simulated drive in place of a recording, with recorded topics beside it."""
