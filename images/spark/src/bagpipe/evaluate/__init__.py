"""Criteria over what a case recorded: each gives passed, failed or invalid, with a figure."""
