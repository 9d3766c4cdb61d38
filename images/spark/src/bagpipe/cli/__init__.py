"""`bagpipe`, the program for people: what a job would run, and what became of it."""
