"""What runs a case's stack: one folder for each `stack.engine`.

`chosen.engine_of` gives the one that a job names, found as `bagpipe.installed` says. A folder's
`fields` is what the engine declares to the spec, its `engine` says what the agent is sent, keeps
what comes back, and judges it (docs/tasks/add-an-engine.md). What lies beside the folders is what
engines share: `replay` is how nodes of any middleware are played to and judged.
"""
