"""Binary files through any program, on Spark: BinPipedRDD and its DataFrame twin.

Only descriptors pass through the JVM on the way in. Each Python worker reads its files itself,
sends them through a pipe to the user's program in the frames of docs/reference/binpipe.md, and
hands over what comes back.

Not for: the program's side, which is bagpipe.binpipe, or cases with ROS, which are bagpipe.run.
"""

from bagpipe.binpiped.failure import BinPipedError, CollectTooLargeError
from bagpipe.binpiped.rdd import BinPipedRDD, bin_piped
from bagpipe.binpiped.record import Record
from bagpipe.binpiped.saving import Manifest, SavedRecord, read_manifest

__all__ = [
    "BinPipedError",
    "BinPipedRDD",
    "CollectTooLargeError",
    "Manifest",
    "Record",
    "SavedRecord",
    "bin_piped",
    "read_manifest",
]
