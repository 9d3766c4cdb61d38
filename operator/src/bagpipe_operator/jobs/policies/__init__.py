"""The rules of a job's life: suspension, deadlines, replacement, resumption, removal. Pure."""
