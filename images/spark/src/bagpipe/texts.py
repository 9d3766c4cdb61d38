"""Texts of a spec that several of its parts have: durations, names of topics, URIs of files."""

import re
from typing import Annotated

from pydantic import AfterValidator

_DURATION = re.compile(r"([0-9]{1,6})(?:\.([0-9]{1,6}))?(ms|s|m|h)")
# A millionth of each, which is the least that a number can say, in nanoseconds.
_MILLIONTHS = {"ms": 1, "s": 1_000, "m": 60_000, "h": 3_600_000}
# The API server counts in nanoseconds, in an int64, which holds 292 years.
_LONGEST = 2**63 - 1


def duration_nanoseconds(text: str) -> int:
    """Nanoseconds of a duration such as `20s`, `1m30s` or `500ms`: one to four numbers with units,
    of at most six digits before and behind the point. None is rounded.

    Raises ValueError for anything else, and for more than 292 years.
    """
    if not re.fullmatch(rf"(?:{_DURATION.pattern}){{1,4}}", text):
        raise ValueError(f"{text!r} is not a duration: write for example 20s, 1m30s or 500ms")
    parts = _DURATION.findall(text)
    whole = sum(int(f"{n}{part:0<6}") * _MILLIONTHS[unit] for n, part, unit in parts)
    if whole > _LONGEST:
        raise ValueError(f"{text!r} is longer than 292 years: write for example 20s or 1h30m")
    return whole


def duration_seconds(text: str) -> float:
    """The same in seconds, the float that is nearest. Raises ValueError."""
    return duration_nanoseconds(text) / 10**9


_KNOWN_URI = re.compile(
    r"(s3|gs|az)://[a-z0-9][a-z0-9._-]*/"
    r"|(hdfs|https)://[A-Za-z0-9.-]+(:[0-9]+)?/"
    r"|pvc://[a-z0-9]([-a-z0-9.]*[a-z0-9])?/"
    r"|file:///"
)
_CREDENTIAL = re.compile(
    r"^[a-z0-9]+://[^/]*@|[?&]([Xx]-[A-Za-z]+-|sig=|AWSAccessKeyId=|[Tt]oken=)"
)


def _known_uri(uri: str) -> str:
    if _CREDENTIAL.search(uri):
        # The URI itself is not repeated: this message ends up in a status and in logs.
        raise ValueError(
            "a URI must hold no credential: put it into a Secret and write that Secret's name in"
            " storage.secrets"
        )
    if not _KNOWN_URI.match(uri):
        raise ValueError(
            f"{uri!r} has no known scheme: write pvc://<claim>/<path>, s3://<bucket>/<path>,"
            " hdfs://<namenode>:<port>/<path>, gs://, az://, https:// or file:///<path>"
        )
    if ".." in uri.split("/"):
        raise ValueError(f"{uri!r} leaves its volume: write the path without '..'")
    return uri


def _bag_uri(uri: str) -> str:
    if uri.startswith("https://") and re.search(r"[*?#]", uri):
        raise ValueError(
            f"{uri!r}: a web server has no list of its files: write each bag's URI without"
            " wildcards and without a query"
        )
    return uri


def bag_uri(uri: str) -> str:
    """The URI as it is. Raises ValueError for one that no job may read a recording from."""
    return _bag_uri(_known_uri(uri))


def _writable_uri(uri: str) -> str:
    if uri.startswith("https://"):
        raise ValueError(
            f"{uri!r} is a web server, which can only be read from: write the URI of a volume, a"
            " bucket or HDFS"
        )
    if re.search(r"[*?]", uri):
        raise ValueError(f"{uri!r} has a wildcard, and results go to one folder: write its name")
    return uri


def _topic_pattern(pattern: str) -> str:
    if not pattern or re.match(r"[A-Za-z0-9_~]", pattern):
        raise ValueError(
            f"{pattern!r} can't match a topic, whose name begins with a slash: write /{pattern}"
        )
    return pattern


def each_once(texts: list[str]) -> list[str]:
    """The texts as they are. Raises ValueError if one is there twice."""
    if len(set(texts)) != len(texts):
        twice = next(text for text in texts if texts.count(text) > 1)
        raise ValueError(f"{twice!r} is there twice: write it once")
    return texts


def _node_name(name: str) -> str:
    if not re.fullmatch(r"(/[A-Za-z][A-Za-z0-9_]*)+", name):
        raise ValueError(f"{name!r} is no node's name: write for example /lane_detector")
    return name


def _secret_name(name: str) -> str:
    if not re.fullmatch(r"[a-z0-9]([-a-z0-9.]*[a-z0-9])?", name):
        raise ValueError(f"{name!r} can't be the name of a Secret")
    return name


def _positive_duration(text: str) -> str:
    if duration_seconds(text) <= 0:
        raise ValueError(f"{text!r} must be above zero")
    return text


def _any_duration(text: str) -> str:
    duration_seconds(text)
    return text


def _receiver_name(name: str) -> str:
    if not re.fullmatch(r"[a-z0-9]([-a-z0-9]{0,38}[a-z0-9])?", name):
        # It may be an address by mistake, and such an address a secret.
        raise ValueError(
            "notify names receivers, never addresses: write a name of lower-case letters, digits"
            " and hyphens, for example team-slack"
        )
    return name


def _absolute_name(name: str) -> str:
    if not name.startswith("/"):
        raise ValueError(f"{name!r} must begin with a slash: write /{name}")
    return name


BagUri = Annotated[str, AfterValidator(_known_uri), AfterValidator(_bag_uri)]
OutputUri = Annotated[str, AfterValidator(_known_uri), AfterValidator(_writable_uri)]
ReceiverName = Annotated[str, AfterValidator(_receiver_name)]
SecretName = Annotated[str, AfterValidator(_secret_name)]
TopicPattern = Annotated[str, AfterValidator(_topic_pattern)]
NodeName = Annotated[str, AfterValidator(_node_name)]
Name = Annotated[str, AfterValidator(_absolute_name)]
Duration = Annotated[str, AfterValidator(_any_duration)]
PositiveDuration = Annotated[str, AfterValidator(_positive_duration)]
