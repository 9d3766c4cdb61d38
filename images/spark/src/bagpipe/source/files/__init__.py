"""Files of any kind, each of them a case."""
