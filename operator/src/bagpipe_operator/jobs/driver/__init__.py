"""A job's Spark driver: what it reports, how it ended, when it is looked for."""
