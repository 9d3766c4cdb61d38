"""The worker's end of the pipe: frames, slots and sessions (docs/reference/binpipe.md)."""
