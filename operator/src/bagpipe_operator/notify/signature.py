"""How a notification is signed, as Standard Webhooks has it: HMAC-SHA256. Pure.

Who receives it knows by the signature that it is the operator's, and by the moment in it that it
is no old one that somebody sends again.
"""

import base64
import binascii
import hashlib
import hmac

# Standard Webhooks' own bounds for a key's bytes.
SHORTEST_KEY, LONGEST_KEY = 24, 64
# The new one and the one before, while receivers change over.
MOST_KEYS = 2
LARGEST_FILE = 1024
PREFIX = "whsec_"


class UnusableKeyError(ValueError):
    """What should be a key is none; the message never repeats it."""


def read_keys(text: bytes) -> tuple[bytes, ...]:
    """The keys of a Secret: a line each, `whsec_` and base64, the newest first.

    Raises UnusableKeyError.
    """
    if len(text) > LARGEST_FILE:
        raise UnusableKeyError(f"it has more than {LARGEST_FILE} bytes")
    lines = text.split()
    if not 0 < len(lines) <= MOST_KEYS:
        raise UnusableKeyError(f"it has {len(lines)} lines: write one key, or two to change it")
    return tuple(_key(line) for line in lines)


def _key(line: bytes) -> bytes:
    if not line.startswith(PREFIX.encode()):
        raise UnusableKeyError(f"a key does not begin with {PREFIX}")
    try:
        key = base64.b64decode(line.removeprefix(PREFIX.encode()), validate=True)
    except binascii.Error:
        raise UnusableKeyError(f"what follows {PREFIX} is no base64") from None
    if not SHORTEST_KEY <= len(key) <= LONGEST_KEY:
        raise UnusableKeyError(
            f"a key has {len(key)} bytes: make it of {SHORTEST_KEY} to {LONGEST_KEY}"
        )
    return key


def signed(keys: tuple[bytes, ...], identity: str, seconds: int, body: bytes) -> dict[str, str]:
    """The headers that sign a body sent at that moment, in seconds since 1970."""
    message = f"{identity}.{seconds}.".encode() + body
    digests = [hmac.new(key, message, hashlib.sha256).digest() for key in keys]
    return {
        "webhook-id": identity,
        "webhook-timestamp": str(seconds),
        "webhook-signature": " ".join(f"v1,{base64.b64encode(d).decode()}" for d in digests),
    }
