"""What a program of the exec engine reads: a fragment of a bag, or a file of any kind, whole.

It gets the file's own name and not its URI, so that it may give a file back under that name.
"""

import dataclasses
import posixpath

from bagpipe.pipe.frames import MAX_PAYLOAD_BYTES
from bagpipe.pipe.session import InputFile
from bagpipe.plan.cases import Case
from bagpipe.run.fragment_stream import fragment_file
from bagpipe.run.pieces import sequence_file
from bagpipe.spec import Source
from bagpipe.storage import Storage


def program_file(case: Case, source: Source, storage: Storage) -> InputFile:
    """The case's file, streamed: its size does not matter to memory, but for a sequence's."""
    name = posixpath.basename(case.bag)
    if case.parts:
        return sequence_file(case, storage, f"{name}.bag")
    if source.bags:
        return dataclasses.replace(fragment_file(case, storage), name=name)
    return InputFile(
        name,
        case.bytes,
        [(0, offset, length) for offset, length in case.ranges],
        lambda: storage.pieces(case.bag, case.ranges, MAX_PAYLOAD_BYTES, case.bag_version),
    )
