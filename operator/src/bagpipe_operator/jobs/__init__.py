"""SimulationJobs: what was seen of them, what to do, and what to write."""
