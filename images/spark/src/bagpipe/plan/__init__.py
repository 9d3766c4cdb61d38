"""From a job's spec to its cases: bags' indexes are read, fragments cut, nothing is played."""
