"""How messages are serialised, by the names that recordings have for it (MCAP's registry)."""

ROS1, CDR = "ros1", "cdr"
