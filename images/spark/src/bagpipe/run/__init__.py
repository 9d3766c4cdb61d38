"""What runs in an executor: one case at a time through a leased slot, judged and kept."""
