"""The Spark driver of one job: plan, schedule, collect, commit, report."""
