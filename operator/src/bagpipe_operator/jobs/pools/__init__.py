"""Warm drivers: which job may take one over, how it is handed over, and what ends it."""
