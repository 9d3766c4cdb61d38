"""What `stack.engine: loopback` reads of a spec."""

from bagpipe.engine_fields import EngineFields

FIELDS = EngineFields(
    agent="exec",
    unmarked_lines="stack",
    sources=("bags",),
    reasons=frozenset({"BytesMissing"}),
    needed={"record": "record is missing: write for example record: {topics: [/tf]}"},
    meaningless={
        ("evaluate",): (
            "evaluate has no meaning with stack.engine: loopback, which counts bytes: leave it out"
        ),
        ("playback.mode", "playback.rate"): (
            "playback.mode and rate have no meaning with stack.engine: loopback: leave them out"
        ),
    },
)
