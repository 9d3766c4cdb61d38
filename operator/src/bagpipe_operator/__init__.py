"""Bagpipe's operator: watches SimulationJobs, runs one Spark driver for each, reports on the rest.

Each folder imports only those below it (import-linter's contracts in pyproject.toml):

    main, acceptance    wires the parts together; `helm test`
    schedules           SimulationSchedules: jobs by the clock
    jobs                SimulationJobs: what was seen, what to do, what to write
    runtime             what runs reconcilers: queue, workers, probes, metrics
    cluster             the API server: calls with deadlines, the Lease, the fence before each write
    api, settings       names, reasons, conditions; the operator's settings

And of jobs:

    reconcile, watch, sweep     the loop: observe, decide, write, report; and what wakes it
    kueue, event_recorder       a job's place in its queue; its Events
    metrics                     what is counted
    status, policies            what to write, and by which rules (pure, but for resume)
    observation                 what a status is decided on
    driver, troubles, pods      what the driver reports, what pods wait for, how pods look
    view                        what the watches delivered
"""
