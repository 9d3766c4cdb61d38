"""The rules of a job's life: what its spec, the clock and its pods make of it.

`halt` says whether a job may have pods (`suspend`, `deadlines`), `places` which pods hold one,
`replacement` whether a lost driver has a successor, `stuck` when nobody will help, `resume` what
may be taken over from an earlier job, `ttl` when a job goes, `verdict` what Passed says.
Pure, but for `resume`, which asks for the earlier job.
"""
