"""Bags on storage, cut into fragments."""
