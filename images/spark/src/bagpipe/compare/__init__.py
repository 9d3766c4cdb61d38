"""Is this version better or worse than that one, on the same cases, and where?"""
