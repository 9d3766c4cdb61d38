"""What the program does in a cluster: jobs as the API server has them, and how they are shown."""
