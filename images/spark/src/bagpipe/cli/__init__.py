"""`bagpipe`, the program for people: what a job would run, and what became of it."""

from bagpipe.own_packages import before_others

before_others()
