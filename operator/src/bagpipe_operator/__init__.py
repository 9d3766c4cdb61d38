"""Bagpipe's operator: watches SimulationJobs, runs one Spark driver for each, tells the rest.

Layers, each importing only those below it:

    main                    wires the parts together
    watch, serve, sweep     what wakes the loop, and what others ask of it
    reconcile               the loop: observe, decide, write, tell
    kueue                   a job's place in its queue, if Kueue is there
    children, api           what is asked of the API server
    status, events          what to write and to tell (pure)
    diagnose, patience, ending, progress, driver_pod, executor_template, job_config (pure)
    view, queue             what is known, and what is to be done
    conditions, names, reasons, settings, quantities
"""
