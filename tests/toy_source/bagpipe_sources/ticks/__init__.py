"""A counter's ticks in place of a recording: the smallest source that makes its own bag."""
