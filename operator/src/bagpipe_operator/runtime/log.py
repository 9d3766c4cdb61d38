"""The operator's log: lines for people, or JSON for what collects logs, with what each is about."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, TextIO

from pythonjsonlogger.json import JsonFormatter

from bagpipe_operator.settings import SettingError

TEXT_FORMAT = "%(asctime)s %(levelname)s %(name)s: %(message)s"
FORMATS = ("text", "json")

_about: ContextVar[dict[str, str] | None] = ContextVar("about", default=None)


@contextmanager
def about(kind: str, namespace: str, name: str) -> Iterator[None]:
    """What is logged in this block, and in what it awaits, is about that job or schedule."""
    token = _about.set({"namespace": namespace, kind: name} if name else None)
    try:
        yield
    finally:
        _about.reset(token)


class _Lines(JsonFormatter):
    """An object a line: time (UTC), level, logger, message, and what the line is about."""

    def __init__(self) -> None:
        super().__init__(
            "{levelname}{name}{message}",
            style="{",
            timestamp="time",
            rename_fields={"levelname": "level", "name": "logger"},
        )

    def add_fields(
        self, log_data: dict[str, Any], record: logging.LogRecord, message_dict: dict[str, Any]
    ) -> None:
        """Adds the job or schedule; of kopf's own extras only what names an object."""
        super().add_fields(log_data, record, message_dict)
        kopf_s = {key: log_data.pop(key, None) for key in ("k8s_ref", "k8s_skip", "settings")}
        found = kopf_s["k8s_ref"] or {}
        log_data |= {key: found[key] for key in ("namespace", "name") if found.get(key)}
        log_data |= _about.get() or {}


def set_up(level: str, form: str, stream: TextIO) -> None:
    """Logs to a stream from now on; raises SettingError."""
    if form not in FORMATS:
        raise SettingError(f"BAGPIPE_LOG_FORMAT is {form!r}: write {' or '.join(FORMATS)}")
    handler = logging.StreamHandler(stream)
    handler.setFormatter(_Lines() if form == "json" else logging.Formatter(TEXT_FORMAT))
    logging.basicConfig(level=level.upper(), handlers=[handler], force=True)
    logging.getLogger("kopf").setLevel(logging.WARNING)
