"""What slots' processes are forked off imports this before all else."""

from bagpipe.own_packages import before_others

before_others()
