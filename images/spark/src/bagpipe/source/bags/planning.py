"""The cases of bags: every fragment of every bag, as often as it is to be played."""

from collections import Counter
from collections.abc import Mapping

from bagpipe.plan.bag_tail import BagError, BagTail
from bagpipe.plan.case import Case, crossed
from bagpipe.plan.conditions import Crossing
from bagpipe.plan.fragments import check_encoding, cut, holding
from bagpipe.plan.in_force import Late, as_wanted
from bagpipe.plan.left_out import check_left_out
from bagpipe.plan.made import Plan, Unplanned, mark_of
from bagpipe.source.bags.opening import opened
from bagpipe.source.naming import stem
from bagpipe.source_spec import Source
from bagpipe.storage import Storage, StorageError
from bagpipe.texts import duration_nanoseconds


def fragments(
    bags: list[str],
    spec: Source,
    encoding: str | None,
    conditions: Crossing,
    storage: Storage,
    late: Mapping[str, Late],
) -> Plan:
    """The fragments of bags under every condition; a bag that yields none has a sentence.

    `encoding` is what their messages must be; None: anything. `late` says of recorded topics what
    late subscribers get.
    """
    cases: list[Case] = []
    unplanned: list[Unplanned] = []
    for uri, name in zip(bags, _names(bags), strict=True):
        try:
            cases += crossed(_fragments_of(uri, name, spec, encoding, storage, late), conditions)
        except (BagError, StorageError) as error:
            reason = error.reason if isinstance(error, BagError) else "BagUnreadable"
            unplanned.append(Unplanned(name, uri, reason, f"{uri}: {error}"))
    return Plan(cases, unplanned)


def _fragments_of(
    uri: str,
    name: str,
    spec: Source,
    encoding: str | None,
    storage: Storage,
    late: Mapping[str, Late],
) -> list[Case]:
    recording = opened(uri, storage)
    tail = as_wanted(recording.tail, late)
    if encoding is not None:
        check_encoding(tail, spec.topics, encoding)
    check_left_out(tail, spec.topics, recording.times)
    length = duration_nanoseconds(spec.fragment.length)
    warm_up = duration_nanoseconds(spec.fragment.warm_up)
    fragments = cut(tail, spec.topics, length, warm_up, recording.times)
    if not fragments:
        raise BagError("NoMatchingTopics", _without_messages(tail, spec.topics))
    return [
        recording.case(f"{name}-{fragment.number:04d}", fragment, spec.topics)
        for fragment in fragments
    ]


def _without_messages(tail: BagTail, topics: list[str]) -> str:
    """A publisher is in the bag's index even if it never published anything."""
    named = {connection.id: connection.topic for connection in tail.connections}
    published = {named.get(each, "") for chunk in tail.chunks for each in holding(chunk)} - {""}
    what = f"none of the topics {', '.join(topics)} is in the bag"
    if silent := [topic for topic in topics if topic in named.values()]:
        what = f"{', '.join(silent)} is in the bag without a message"
    return f"{what}; it has {', '.join(sorted(published)[:10])}"


def _names(bags: list[str]) -> list[str]:
    """A readable name per bag, with a mark where two bags would share one.

    A number would be another bag's as soon as one more is there, and a comparison with an earlier
    job, or a quarantine, would take the one for the other.
    """
    stems = [stem(uri) for uri in bags]
    counts = Counter(stems)
    return [
        stem if counts[stem] == 1 else f"{stem}-{mark_of(uri)}"
        for stem, uri in zip(stems, bags, strict=True)
    ]
