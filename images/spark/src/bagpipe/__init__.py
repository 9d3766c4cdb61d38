"""Bagpipe's data plane: from a job's spec to judged cases."""

__version__ = "0.1.0"
