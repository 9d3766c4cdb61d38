"""Executors at the end of their driver: deleted in seconds, and before Spark does it in minutes."""

import json
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any, ClassVar
from urllib.parse import parse_qs, urlsplit

import pytest

from bagpipe.driver.executor_removal import stop_with_executors
from bagpipe.driver.kept_spark import KeptSpark
from tests.unit.bagpipe.serving import serving


class ApiServer(BaseHTTPRequestHandler):
    """It keeps what is asked of it by whoever has the token."""

    asked: ClassVar[list[Any]] = []
    answer: ClassVar[bytes] = b'{"kind": "PodList", "items": []}'

    def do_DELETE(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        if self.headers["Authorization"] != "Bearer the-token":
            self.send_error(403)
            return
        url = urlsplit(self.path)
        self.asked.append((url.path, parse_qs(url.query), self.headers["Content-Type"], body))
        self.send_response(200)
        self.end_headers()
        self.wfile.write(self.answer)


@pytest.fixture
def api() -> Iterator[str]:
    ApiServer.asked.clear()
    with serving(ApiServer) as address:
        yield address


class Spark:
    """As much of a SparkContext as its end needs."""

    applicationId = "spark-1a2b"  # noqa: N815  Spark's own name

    def __init__(self) -> None:
        self.asked_before: int | None = None

    def stop(self) -> None:
        self.asked_before = len(ApiServer.asked)


class Gone(Spark):
    @property
    def applicationId(self) -> str:  # type: ignore[override]  # noqa: N802
        raise ConnectionRefusedError("the JVM is gone")


def ended(spark: Spark, api: str, account: Path) -> Spark:
    kept = KeptSpark(
        lambda _settings: spark,  # type: ignore[arg-type, return-value]
        lambda given: stop_with_executors(given, "lab", api, account),
    )
    kept.of({})
    kept.end()
    kept.end()  # the driver's last word, after its job's
    return spark


# Promise: executors-have-10-s
def test_they_have_seconds_and_not_the_time_of_a_case(api: str, tmp_path: Path) -> None:
    (tmp_path / "token").write_text("the-token\n")
    # Once more for those that Spark has asked for in the place of the first ones.
    assert (ended(Spark(), api, tmp_path).asked_before, len(ApiServer.asked)) == (1, 2)
    selected = {"labelSelector": ["spark-app-selector=spark-1a2b,spark-role=executor"]}
    options = {"apiVersion": "v1", "kind": "DeleteOptions", "gracePeriodSeconds": 10}
    path = "/api/v1/namespaces/lab/pods"
    assert ApiServer.asked == [(path, selected, "application/json", options)] * 2


@pytest.mark.parametrize("answer", [b"<html>", b""])
def test_an_answer_that_is_none_ends_no_driver(
    answer: bytes, api: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "token").write_text("the-token")
    monkeypatch.setattr(ApiServer, "answer", answer)
    assert ended(Spark(), api, tmp_path).asked_before == 1


class Silent(BaseHTTPRequestHandler):
    """It takes what is asked and answers nothing, as long as it is not let go."""

    let_go = threading.Event()

    def do_DELETE(self) -> None:
        assert self.let_go.wait(60)


def test_an_api_server_that_hangs_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "token").write_text("the-token")
    monkeypatch.setattr("bagpipe.driver.api_server._DELETE_SECONDS", 0.05)
    with serving(Silent) as address:
        stopped = ended(Spark(), address, tmp_path)
        Silent.let_go.set()
    assert stopped.asked_before is not None
    assert caplog.text.count("the executors have the grace period of their pods: timed out") == 2


@pytest.mark.parametrize(
    ("kind", "why"),
    [
        (Spark, "the executors have the grace period of their pods: HTTP Error 403"),
        (Gone, "the executors can not be found without Spark: the JVM is gone"),
    ],
)
def test_where_it_can_t_be_done_spark_stops_in_its_own_way(
    kind: type[Spark], why: str, api: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "token").write_text("another")
    assert ended(kind(), api, tmp_path).asked_before == 0
    assert why in caplog.text
