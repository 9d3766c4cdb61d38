"""A case as viewers of recordings show it: one MCAP file with layouts for them."""
