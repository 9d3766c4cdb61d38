"""The native module `bagpipe_bag`, which reads bags; not every installation has it."""

import importlib
from typing import Any

_MODULE = "bagpipe_bag"
_HOW = (
    "`make wheels` in a checkout builds it for pip, `make venv` into .venv, and the Spark image"
    " has it"
)


class NativeModuleError(ImportError):
    """The native module is missing or too old; the sentence says how to get it."""


def native(name: str, user: str) -> Any:
    """What the native module calls `name`; `user` begins the sentence where that is not there.

    It is loaded when it is first asked for: the operator's image has no such module. Raises
    NativeModuleError.
    """
    try:
        return getattr(importlib.import_module(_MODULE), name)
    except ModuleNotFoundError as missing:
        raise NativeModuleError(
            f"{user} needs the native module {_MODULE}, which is not installed here: {_HOW}",
            name=_MODULE,
        ) from missing
    except AttributeError as missing:
        raise NativeModuleError(
            f"{user} needs a newer native module {_MODULE} than is installed here: {_HOW}",
            name=_MODULE,
        ) from missing
