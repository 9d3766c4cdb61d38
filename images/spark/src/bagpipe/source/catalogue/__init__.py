"""Recordings that a catalogue's rows name, selected by an expression over its columns."""
