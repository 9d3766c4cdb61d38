"""Kueue: one Workload for a whole job, which gets its pods only when its queue has admitted it.

Layers, each importing only those below it:

    queueing                what is asked of the API server, and what that means for a job
    workload, placement     what a Workload says of a job, and a job of its pods (pure)
    workload_view           the Workloads that were seen (pure)
"""
