"""How `bagpipe pull` copies the results of a job from where they lie to this machine."""
