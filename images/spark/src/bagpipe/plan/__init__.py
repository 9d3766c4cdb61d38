"""From a job's spec to its cases: bags' tails are read, fragments cut, nothing is played."""
