"""What runs reconcilers: queue, workers, pauses, probes, metrics. It knows no jobs."""
