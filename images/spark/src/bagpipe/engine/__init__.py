"""What runs a case's stack: one folder for each `stack.engine`.

`chosen.engine_of` gives the one that a job names. An engine says what the agent is sent, keeps what
comes back, and judges it. What still asks elsewhere which engine it is stands in docs/limits.md.
"""
