"""Objects of the cluster, each kept once by namespace and name, and found by whose it is.

Whose an object is stands in labels and owners, which anybody may write again without end: each word
of it would stay in memory, were the one before not taken out.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Generic, Protocol, TypeVar

Key = tuple[str, str]


class Named(Protocol):
    """What has a place in the cluster."""

    @property
    def namespace(self) -> str: ...
    @property
    def name(self) -> str: ...


Kept = TypeVar("Kept", bound=Named)


class KeptOnce(Generic[Kept]):
    """Objects by the UID of their owner, and by namespace and name."""

    def __init__(self, owner_of: Callable[[Kept], str]) -> None:
        self._owner_of = owner_of
        self._owned: dict[str, dict[str, dict[Key, Kept]]] = {}  # by owner and namespace
        self._owners: dict[Key, str] = {}

    def __len__(self) -> int:
        return len(self._owners)

    def __iter__(self) -> Iterator[Kept]:
        return (
            each
            for places in list(self._owned.values())
            for owned in list(places.values())
            for each in owned.values()
        )

    def owners(self) -> list[str]:
        """The UIDs of all that have some."""
        return list(self._owned)

    def of(self, owner: str) -> Mapping[Key, Kept]:
        """An owner's, by namespace and name."""
        places = self._owned.get(owner, {})
        if len(places) == 1:
            return next(iter(places.values()))
        return {key: each for owned in places.values() for key, each in owned.items()}

    def within(self, namespace: str, owner: str) -> Mapping[Key, Kept]:
        """Those of one namespace; what others claim to be the owner's costs nothing."""
        return self._owned.get(owner, {}).get(namespace, {})

    def namespaces(self, owner: str) -> set[str]:
        """Where an owner has some."""
        return set(self._owned.get(owner, {}))

    def known(self, one: Kept) -> Kept | None:
        """What is kept of that namespace and name, whosever it is."""
        key = _key(one)
        return self.within(one.namespace, self._owners.get(key, "")).get(key)

    def put(self, one: Kept) -> None:
        """Keeps an object in place of what is kept of its namespace and name."""
        known, owner, key = self.known(one), self._owner_of(one), _key(one)
        if known is not None and self._owner_of(known) != owner:
            self.take_out(known)
        self._owned.setdefault(owner, {}).setdefault(one.namespace, {})[key] = one
        self._owners[key] = owner

    def take_out(self, one: Kept) -> None:
        """Takes out what is kept of that namespace and name, if anything is."""
        key = _key(one)
        owner = self._owners.pop(key, None)
        if owner is None:
            return
        places = self._owned[owner]
        del places[one.namespace][key]
        if not places[one.namespace]:
            del places[one.namespace]
        if not places:
            del self._owned[owner]

    def take_out_all(self, owner: str) -> None:
        """Takes out all that an owner has."""
        for owned in self._owned.pop(owner, {}).values():
            for key in owned:
                del self._owners[key]


def _key(one: Named) -> Key:
    return one.namespace, one.name
