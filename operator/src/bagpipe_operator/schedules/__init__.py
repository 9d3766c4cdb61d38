"""SimulationSchedules: jobs by the clock.

`cron` says when, `decide` what to do now (both pure), `reconcile` does it with one status PATCH
(`job` and `status` say what it writes), `events` reports it, `view` holds what was seen, `alarms`
wakes a schedule when its next run is due, `watch` is kopf's part, and `loop` ties them together.
"""
