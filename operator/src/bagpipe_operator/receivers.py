"""Whom the operator may notify: receivers that an administrator allows, by name. Pure.

A job names a receiver and never an address: the operator reaches what its users may not.
"""

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

# What a receiver can ask for; a job's end may be several of them.
EVENTS = ("passed", "failed", "invalid", "errored", "regressed")
# Each has a queue and a task of its own.
MOST_RECEIVERS = 16
# What spec.notify may name.
MOST_NAMED = 8
_NAME = re.compile(r"[a-z0-9]([-a-z0-9]{0,38}[a-z0-9])?")
# Nobody's name or password before the host, which errors and logs of others would repeat.
_URL = re.compile(r"https?://[^\s/@?#]+(/\S*)?")


@dataclass(frozen=True)
class Receiver:
    """One receiver of notifications."""

    name: str
    # Such an address may be a secret in itself, so it is never shown.
    url: str = field(repr=False)
    events: frozenset[str] = frozenset(EVENTS)
    namespaces: frozenset[str] = frozenset()  # whose jobs may name it; none means any
    always: frozenset[str] = frozenset()  # of whose jobs it gets all, named or not

    def takes_from(self, namespace: str) -> bool:
        """Whether jobs of a namespace may name it."""
        return not self.namespaces or namespace in self.namespaces | self.always


class Receivers:
    """All receivers, by name."""

    def __init__(self, receivers: Iterable[Receiver] = ()) -> None:
        self._receivers: Mapping[str, Receiver] = {each.name: each for each in receivers}

    def named(self, name: str, namespace: str) -> Receiver | None:
        """The receiver of that name, if jobs of the namespace may name it."""
        found = self._receivers.get(name)
        return found if found is not None and found.takes_from(namespace) else None

    def of_all(self, namespace: str) -> list[Receiver]:
        """Those that get every job of a namespace."""
        return [each for each in self._receivers.values() if namespace in each.always]


def read_receivers(text: str) -> tuple[Receiver, ...]:
    """The receivers of a JSON list, as the chart writes it; raises ValueError with what to write.

    An address is not repeated in an error.
    """
    if not text:
        return ()
    try:
        listed = json.loads(text)
    except ValueError:
        raise ValueError("it is no JSON: write a list of receivers") from None
    if not isinstance(listed, list) or len(listed) > MOST_RECEIVERS:
        raise ValueError(f"write a list of at most {MOST_RECEIVERS} receivers")
    read = tuple(_receiver(each) for each in listed)
    names = [each.name for each in read]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"two receivers are called {name}: give each a name of its own")
    return read


def _receiver(value: Any) -> Receiver:
    found = value if isinstance(value, dict) else {}
    name, url = found.get("name"), found.get("url")
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise ValueError(
            "a receiver's name has at most 40 lower-case letters, digits and hyphens: write for"
            " example team-slack"
        )
    if not isinstance(url, str) or not _URL.fullmatch(url):
        raise ValueError(
            f"the url of {name} is no http:// or https:// address without a user's name: write for"
            " example https://notify.example.com/bagpipe"
        )
    events = _texts(found, "events", name) or frozenset(EVENTS)
    if not events <= set(EVENTS):
        raise ValueError(f"the events of {name} may be {', '.join(EVENTS)}: write some of them")
    named, always = _texts(found, "namespaces", name), _texts(found, "always", name)
    return Receiver(name, url, events, named, always)


def _texts(found: dict[str, Any], key: str, name: str) -> frozenset[str]:
    value = found.get(key) or []
    if not isinstance(value, list) or not all(isinstance(each, str) for each in value):
        raise ValueError(f"{key} of {name} is no list of words: write for example [lanes]")
    return frozenset(value)
