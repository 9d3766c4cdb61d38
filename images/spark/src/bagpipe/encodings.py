"""How messages are serialised, by the names that recordings have for it (MCAP's registry)."""

ROS1, CDR = "ros1", "cdr"

# What every frame of zstd begins with, and no CDR, whose first byte is 0.
_ZSTD = b"\x28\xb5\x2f\xfd"


def is_packed(encoding: str, data: bytes) -> bool:
    """Whether a message is a frame of zstd in place of CDR, as rosbag2 stores it with
    `--compression-mode message`, which stands in metadata.yaml alone.
    """
    return encoding == CDR and data.startswith(_ZSTD)
