"""What the ledger of a case of ROS 2 does not prove. Pure.

Messages wait in the middleware until a node takes them, and what is overwritten before is gone
without a trace there. So only who counts the node's own takes knows what it got.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from bagpipe.judgement import Judgement

_PROOFS = frozenset({"taken", "called"})
# A sentence names a few nodes; the ledger has all.
_MOST_NAMED = 5


def unproved(result: Mapping[str, Any]) -> Iterator[Judgement]:
    """One judgement where nodes were sent messages of the window and nobody saw them take these."""
    found = {
        line["node"]: (topic["topic"], line["strength"])
        for topic in reversed(result["ledger"]["topics"])
        for line in topic["subscribers"]
        if topic["sent"] and line["strength"] not in _PROOFS
    }
    if not found:
        return
    named = sorted(found)
    topic, strength = found[named[0]]
    rest = named[1 : _MOST_NAMED + 1]
    more = f" and {len(named) - 1 - len(rest)} more" if len(named) - 1 > len(rest) else ""
    others = f"; so are {', '.join(rest)}{more}" if rest else ""
    yield Judgement(
        "invalid",
        "DeliveryUnproved",
        f"what {named[0]} got on {topic} is proved no further than `{strength}`{others}: the"
        " ledger's library is not in its process, as the loader leaves it out of programs that are"
        " setuid or have capabilities, were started with a cleared environment, or have ROS 2"
        " linked statically. Start the node without that, or write {cause: DeliveryUnproved,"
        " action: allow} into faultPolicy",
    )
