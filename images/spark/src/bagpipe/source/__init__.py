"""Where a job's inputs come from: one folder for each kind of `source` in the spec.

`chosen.source_of` gives the one that a job names, `planning.plan` its cases. A source plans, gives
a case's input to the agent, and knows what its recordings hold. What still asks elsewhere which
source it is stands in docs/limits.md.
"""
