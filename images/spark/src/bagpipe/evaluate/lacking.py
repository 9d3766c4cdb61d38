"""Whether answers to the lead-in make up for some that the window lacks, by the inputs' own stamps.

Which answers are the window's is guessed by their stamps alone (window.py), as a sensor's message
may be stamped a while before it is recorded. Where a pass depends on that guess, the inputs are
asked: each was recorded in the window or before it, and what copies its stamp answers it.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

from bagpipe.evaluate.evidence import Evidence, Received
from bagpipe.evaluate.window import ROUNDING, TopicMessages, most_behind

# Of the answers' stamps, from which on they are taken for copies of a topic's.
_FOLLOWED = 0.75


@dataclass(frozen=True)
class _Inputs:
    """The stamps of one topic's inputs around the window's start, in ns."""

    before: set[int]  # of those that were recorded before the window
    inside: set[int]
    longest: int  # from a stamp to its recording
    last: int  # stamp, where none counts as later than its recording

    @classmethod
    def of(cls, inputs: Sequence[tuple[int, int]], start: int) -> "_Inputs":
        """Of (time, stamp) of each; there is one."""
        before = {stamp for time, stamp in inputs if time < start}
        inside = {stamp for time, stamp in inputs if time >= start}
        longest = max(time - stamp for time, stamp in inputs)
        return cls(before, inside, longest, max(map(min, inputs)))

    @classmethod
    def of_all(cls, topics: Collection["_Inputs"]) -> "_Inputs":
        """Of several topics together; there is one."""
        return cls(
            set[int]().union(*(each.before for each in topics)),
            set[int]().union(*(each.inside for each in topics)),
            max(each.longest for each in topics),
            max(each.last for each in topics),
        )

    @property
    def known(self) -> set[int]:
        """All."""
        return self.before | self.inside

    def shared(self, stamps: set[int], begin: int) -> float:
        """The share of the answers' stamps that these inputs have, from a time to their last."""
        compared = {each for each in stamps if begin <= each <= self.last}
        return len(compared & self.known) / max(1, len(compared))


def lacking(
    found: TopicMessages,
    counted: Sequence[Received],
    enough: Callable[[int], bool],
    evidence: Evidence,
) -> str:
    """A sentence where by the inputs' stamps too few of the `counted` answers are the window's.

    Nothing where `enough` holds without any that is stamped before the window, or where no topic
    has the answers' stamps. Raises what reading inputs raises.
    """
    oldest = evidence.start - found.behind - ROUNDING
    doubted = {id(each) for each in counted if _within(each, oldest, evidence.start)}
    sure = [each for each in counted if id(each) not in doubted]
    if not evidence.led_in or enough(_different(sure)):
        return ""
    stamps = {each.stamp for each in found.early + found.answers if each.stamp is not None}
    topics = _answered(stamps, oldest, evidence)
    if not topics:
        return ""
    together = _Inputs.of_all(topics.values())
    names, before = _followed(topics, together, lambda each: each.shared(stamps, oldest))
    if not names or together.longest > most_behind(evidence):
        return ""
    # A stamp that both sides have, of whatever topics, may be the window's.
    others = before - together.inside
    kept = [each for each in counted if id(each) not in doubted or each.stamp not in others]
    least = _different(kept + [each for each in found.early if each.stamp in together.inside])
    if enough(least):
        return ""
    return (
        f"by the stamps of the inputs on {' and '.join(names)} no more than {least} of"
        f" {_different(counted)} messages answer the window, and the others inputs from before it:"
        f" look for the answers that lack, or demand no more than these {least}"
    )


def _followed(
    topics: Mapping[str, _Inputs], together: _Inputs, share: Callable[[_Inputs], float]
) -> tuple[list[str], set[int]]:
    """The topics whose inputs are answered, and the stamps of these that came before the window.

    None where neither one of them nor all together have the answers' stamps.
    """
    alone = sorted(name for name, each in topics.items() if share(each) >= _FOLLOWED)
    if alone:
        # What comes too late on one of them to be seen may be the window's.
        return alone, set.intersection(*(topics[name].before for name in alone))
    if share(together) >= _FOLLOWED:
        # Each answer is to one of them, as to two cameras that take turns.
        return sorted(topics), together.before
    return [], set()


def _within(each: Received, begin: int, end: int) -> bool:
    return each.stamp is not None and begin <= each.stamp < end


def _different(messages: Sequence[Received]) -> int:
    return len({each.identity for each in messages})


def _answered(stamps: set[int], oldest: int, evidence: Evidence) -> dict[str, _Inputs]:
    """The topics of which some of the inputs around the window's start have one of the stamps."""
    if evidence.input_stamps is None:
        return {}
    most = max(1, most_behind(evidence))
    # A whole number of times as far back, so that the recording is read once for all criteria.
    begin = evidence.start - most * math.ceil((evidence.start - oldest) / most)
    inputs = evidence.input_stamps(begin, evidence.start + most)
    topics = {name: _Inputs.of(each, evidence.start) for name, each in inputs.items() if each}
    return {name: each for name, each in topics.items() if stamps & each.known}
