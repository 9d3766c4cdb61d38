"""Where a job's inputs come from: one folder for each kind of `source` in the spec.

`chosen.source_of` gives the one that a job names, found as `bagpipe.installed` says, and
`planning.plan` its cases. A folder's `fields` is what the source declares to the spec, its `source`
plans, gives a case's input to the agent, and knows what its recordings hold
(docs/tasks/add-an-engine.md).
"""
