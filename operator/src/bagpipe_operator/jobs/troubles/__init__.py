"""What keeps pods from their work: recognized in statuses and Events, or asked for."""
