"""The API server: calls with deadlines, the Lease, and the fence that every write passes."""
