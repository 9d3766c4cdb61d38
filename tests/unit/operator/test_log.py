"""The operator's log: as JSON every line about a job names it."""

import asyncio
import io
import json
import logging
from collections.abc import Iterator
from typing import Any

import pytest

from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime import log
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.runtime.work import work
from bagpipe_operator.settings import SettingError
from tests.unit.operator.builders import make_job

logger = logging.getLogger("bagpipe_operator.test")


@pytest.fixture(autouse=True)
def _root_as_it_was() -> Iterator[None]:
    root, kopf = logging.getLogger(), logging.getLogger("kopf")
    before = (root.handlers[:], root.level, kopf.level)
    yield
    root.handlers[:], level, kopf_s = before
    root.setLevel(level)
    kopf.setLevel(kopf_s)


@pytest.fixture
def stream() -> io.StringIO:
    """Where the log goes, as JSON."""
    found = io.StringIO()
    log.set_up("INFO", "json", found)
    return found


def lines(stream: io.StringIO) -> list[dict[str, Any]]:
    return [json.loads(line) for line in stream.getvalue().splitlines()]


@pytest.mark.looptime
async def test_a_fault_met_with_a_job_names_the_job(stream: io.StringIO) -> None:
    view = View()
    job = make_job("lane").view()
    view.put_job(job)
    queue = WorkQueue()

    async def reconcile(_: str) -> None:
        logger.info("looks at it")
        await asyncio.create_task(deeper())
        raise ApiError(500, "InternalError", "no")

    async def deeper() -> None:
        logger.warning("in a task of its own")

    queue.add(job.uid)
    worker = asyncio.create_task(
        work(queue, reconcile, JobMetrics(view, queue), called=view.called)
    )
    await asyncio.sleep(0.05)
    worker.cancel()
    await asyncio.gather(worker, return_exceptions=True)
    logger.info("afterwards")
    *about, last = lines(stream)
    assert [line["message"] for line in about][:2] == ["looks at it", "in a task of its own"]
    assert about[2]["message"].startswith(f"job {job.namespace}/lane: ")
    assert {(line["namespace"], line["job"]) for line in about} == {(job.namespace, "lane")}
    assert (last["message"], "job" in last) == ("afterwards", False)


def test_a_line_is_an_object_with_its_fields(stream: io.StringIO) -> None:
    with log.about("schedule", "lanes", "nightly"):
        try:
            raise KeyError("status")
        except KeyError:
            logger.exception("an unexpected\nfault")
    (line,) = lines(stream)
    assert line.pop("time").endswith("+00:00")
    assert "KeyError: 'status'" in line.pop("exc_info")
    assert line == {
        "level": "ERROR", "logger": "bagpipe_operator.test", "message": "an unexpected\nfault",
        "namespace": "lanes", "schedule": "nightly",
    }  # fmt: skip


def test_kopf_s_lines_name_their_object_and_hold_no_settings(stream: io.StringIO) -> None:
    extra = {
        "k8s_ref": {"namespace": "lanes", "name": "lane", "uid": "1"},
        "k8s_skip": True,
        "settings": object(),
    }
    logging.getLogger("kopf.test").warning("something", extra=extra)
    (line,) = lines(stream)
    assert set(line) == {"time", "level", "logger", "message", "namespace", "name"}


def test_text_is_for_people() -> None:
    stream = io.StringIO()
    log.set_up("INFO", "text", stream)
    logger.info("watching %s", "lanes")
    assert stream.getvalue().endswith(" INFO bagpipe_operator.test: watching lanes\n")


def test_another_format_is_refused() -> None:
    with pytest.raises(SettingError, match="BAGPIPE_LOG_FORMAT is 'xml': write text or json"):
        log.set_up("INFO", "xml", io.StringIO())
