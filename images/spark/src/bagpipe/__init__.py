"""Bagpipe's data plane: from a job's spec to judged cases.

`MemoryBag` is the agent's bag in memory, `MemoryMcap` its MCAP. They come from a native module of
their own, which is loaded when it is first asked for: the operator's image knows the spec and has
no such module. So is what a Spark program uses, `bin_piped` and its kin: the operator and the SDK
know no Spark.
"""

import importlib
from typing import TYPE_CHECKING, Any

from bagpipe.native import native

if TYPE_CHECKING:
    from bagpipe_bag import BagError, MemoryBag, MemoryBagWriter, MemoryMcap, MemoryMcapWriter

__all__ = [
    "BagError",
    "MemoryBag",
    "MemoryBagWriter",
    "MemoryMcap",
    "MemoryMcapWriter",
    "__version__",
]
__version__ = "0.2.0"

_NATIVE = frozenset({"BagError", "MemoryBag", "MemoryBagWriter", "MemoryMcap", "MemoryMcapWriter"})
_ON_SPARK = {
    "BinPipedError": "bagpipe.binpiped",
    "BinPipedRDD": "bagpipe.binpiped",
    "CollectTooLargeError": "bagpipe.binpiped",
    "bin_piped": "bagpipe.binpiped",
    "read_manifest": "bagpipe.binpiped",
    "RosbagDataSource": "bagpipe.rosbag_source",
}


def __getattr__(name: str) -> Any:
    """The public names of the data plane. Raises ImportError where their module is missing."""
    if name in _ON_SPARK:
        return getattr(importlib.import_module(_ON_SPARK[name]), name)
    if name not in _NATIVE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return native(name, f"bagpipe.{name}")
