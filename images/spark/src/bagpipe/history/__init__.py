"""Many runs of a job beside each other: what got worse, when, and what is not steady."""
