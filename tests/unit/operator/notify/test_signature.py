"""Signatures as Standard Webhooks has them, checked by OpenSSL and by the page for receivers."""

import base64
import re
import subprocess
from pathlib import Path

import pytest

from bagpipe_operator.notify.signature import UnusableKeyError, read_keys, signed

KEY = bytes(range(32))
OLD = bytes(range(100, 124))
BODY = b'{"verdict":"Passed"}'
PAGE = Path(__file__).parents[4] / "docs/tasks/notifications.md"


def line(key: bytes) -> bytes:
    return b"whsec_" + base64.b64encode(key)


def by_openssl(key: bytes, message: bytes) -> str:
    done = subprocess.run(
        ["openssl", "dgst", "-sha256", "-mac", "HMAC", "-macopt", f"hexkey:{key.hex()}", "-binary"],
        input=message, capture_output=True, timeout=60, check=True,
    )  # fmt: skip
    return "v1," + base64.b64encode(done.stdout).decode()


def test_a_body_is_signed_with_its_identity_and_its_moment() -> None:
    headers = signed((KEY,), "u-ended", 1795147200, BODY)
    assert headers == {
        "webhook-id": "u-ended",
        "webhook-timestamp": "1795147200",
        "webhook-signature": by_openssl(KEY, b"u-ended.1795147200." + BODY),
    }


def test_while_a_key_changes_both_sign() -> None:
    keys = read_keys(line(KEY) + b"\n" + line(OLD) + b"\n")
    assert keys == (KEY, OLD)
    message = b"i.5." + BODY
    both = f"{by_openssl(KEY, message)} {by_openssl(OLD, message)}"
    assert signed(keys, "i", 5, BODY)["webhook-signature"] == both


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"", "0 lines"),
        (b"\n".join([line(KEY)] * 3), "3 lines"),
        (b"c2VjcmV0IG9mIG5vYm9keSwgdHJ1c3QgbWU=", "does not begin with whsec_"),
        (b"whsec_!!!!", "no base64"),
        (line(KEY[:23]), "23 bytes"),
        (line(bytes(65)), "65 bytes"),
        (b"x" * 1025, "more than 1024"),
    ],
)
def test_what_is_no_key_signs_nothing_and_is_not_repeated(text: bytes, words: str) -> None:
    with pytest.raises(UnusableKeyError, match=words) as refused:
        read_keys(text)
    assert text.decode() not in str(refused.value) or not text


def test_the_page_s_lines_for_receivers_distinguish_true_from_forged() -> None:
    """The Python of docs/tasks/notifications.md, run as it stands there."""
    [code] = re.findall(r"```python\n(.*?def verified.*?)```", PAGE.read_text(), re.DOTALL)
    there: dict[str, object] = {}
    exec(code, there)  # noqa: S102
    verified = there["verified"]
    assert callable(verified)
    secret, now = line(KEY).decode(), 1795147200
    headers = signed((OLD, KEY), "u-ended", now, BODY)
    assert verified(secret, headers, BODY, now) is True
    assert verified(secret, headers, BODY + b" ", now) is False
    assert verified(secret, headers | {"webhook-id": "v"}, BODY, now) is False
    assert verified(secret, signed((OLD,), "u-ended", now, BODY), BODY, now) is False
    assert verified(secret, headers, BODY, now + 301) is False
