"""Patterns of topics' names: regular expressions of users, matched in time linear in the name.

RE2 has nearly the syntax of Rust's regex, by which the agent records: no look-around, no references
back.
Python's own takes years over (a+)+b, and the operator serves others beside (issue 13).
"""

from functools import lru_cache

import re2

# For a compiled pattern and its cache, in bytes; one that needs more is left to the agent.
MOST_MEMORY = 1 << 20

# Set operations in classes and forms of \\b, which RE2 would read as something else.
_OF_RUST_ALONE = ("&&", "--", "~~", "\\b{")

_OPTIONS = re2.Options()
_OPTIONS.max_mem = MOST_MEMORY
_OPTIONS.log_errors = False


def records(pattern: str, topic: str) -> bool:
    """Whether a pattern of `record.topics` is for a topic.

    True for a pattern that can't be compiled here: the agent, which records, has the last word.
    """
    compiled = _compiled(pattern)
    return compiled is None or compiled.fullmatch(topic) is not None


@lru_cache(maxsize=256)
def _compiled(pattern: str) -> "re2._Regexp | None":
    if any(mark in pattern for mark in _OF_RUST_ALONE):
        return None
    try:
        return re2.compile(pattern, _OPTIONS)
    except re2.error:
        return None
