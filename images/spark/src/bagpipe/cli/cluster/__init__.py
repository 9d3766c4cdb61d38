"""What the program does in a cluster: jobs as the API server tells them, and how they are shown."""
