"""Chunks of MCAP that are left out, since by their index they have none of the wanted messages.

Statistics count the messages of each channel, so that a chunk index that names another channel is
found out. Where they don't, messages would be in no fragment, and no one would know: so the message
indexes behind the chunks that are left out are read.
"""

from collections.abc import Callable, Collection

from bagpipe.plan.bag_tail import BagError, BagTail, Chunk
from bagpipe.plan.fragments import Window, holding

# Each is a read of its own, which object storage answers within some 20 ms.
_MOST_LOOKS = 10_000


def check_left_out(
    tail: BagTail,
    topics: Collection[str],
    times: Callable[[Chunk], object],
    window: Window | None = None,
) -> None:
    """Looks at the chunks without a message of the topics (none: nothing is left out), of the whole
    recording or of a window, where nothing else proves that they have none.

    `times` reads a chunk's message indexes, and raises BagError where they are not what the chunk
    index says. Raises BagError also where there are more than 10,000 such chunks.
    """
    if tail.counted or not topics:
        return
    wanted = {connection.id for connection in tail.connections if connection.topic in topics}
    left_out = [
        chunk
        for chunk in tail.chunks
        if not wanted & holding(chunk) and (window is None or _reaches_into(chunk, window))
    ]
    if len(left_out) > _MOST_LOOKS:
        raise BagError(
            "BagNotIndexed",
            f"its statistics don't count the messages of each channel, so that {len(left_out):,}"
            f" chunks would have to be looked at, and at most {_MOST_LOOKS:,} are: write it again"
            " with statistics (`bagpipe bag reindex BAG --to NEW`), or choose all topics",
        )
    for chunk in left_out:
        times(chunk)


def _reaches_into(chunk: Chunk, window: Window) -> bool:
    return chunk.start_time < window.end and chunk.end_time >= window.lead_in_start
