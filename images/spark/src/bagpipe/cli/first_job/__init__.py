"""`bagpipe init`: what recordings show by their indexes, and the job that follows from it."""
