"""The pods and the ConfigMap of a job's attempt."""
