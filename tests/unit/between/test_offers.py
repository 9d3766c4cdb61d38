"""The operator offers jobs to real drivers' servers, whose claims are looked up over HTTP."""

import contextlib
import hashlib
import http.client
import json
import logging
import socket
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from bagpipe.driver import __main__ as driver_main
from bagpipe.driver import own_claim
from bagpipe.driver.job import Interruption
from bagpipe.driver.offers import Offers
from bagpipe.driver.progress import Progress
from bagpipe.driver.progress_server import LARGEST_JOB_BYTES, serve_progress
from bagpipe.driver.seat import Claimed, Seat
from bagpipe.spec import JobFile
from bagpipe_operator.jobs.driver.offer import DriverOffers
from bagpipe_operator.jobs.driver.progress import parse
from bagpipe_operator.jobs.pods.job_config import job_file, read_spec
from bagpipe_operator.settings import Settings
from tests.unit.bagpipe.jobs import make_job as job_of_the_driver
from tests.unit.operator import builders
from tests.waiting import PATIENCE, wait_until

POD = "uid-of-the-pod"


class ApiServer:
    """Answers GETs of SimulationJobs; a declared fake, for what a real one can't be made to say."""

    def __init__(self) -> None:
        self.jobs: dict[str, Any] = {}
        self.status = 200
        self.paths: list[str] = []
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                outer.paths.append(self.path)
                assert self.headers["Authorization"] == "Bearer secret"
                found = outer.jobs.get(self.path.rpartition("/")[2])
                status = outer.status if found is not None or outer.status != 200 else 404
                self.send_response(status)
                self.end_headers()
                self.wfile.write(b"{" if found == "cut" else json.dumps(found or {}).encode())

            def log_message(self, *_args: Any) -> None: ...

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
        self.url = f"http://127.0.0.1:{self.server.server_address[1]}"

    def put(self, name: str, uid: str, **pool: Any) -> None:
        self.jobs[name] = {"metadata": {"name": name, "uid": uid}, "status": {"pool": pool}}


@pytest.fixture
def api(tmp_path: Path) -> Iterator[ApiServer]:
    (tmp_path / "token").write_text("secret\n")
    server = ApiServer()
    yield server
    server.server.shutdown()
    server.server.server_close()


def claim(api: ApiServer, name: str, account: Path) -> Claimed | None:
    return own_claim.claim_of("lanes", name, api.url, account)


def test_a_claim_is_read_from_the_job_s_own_status(api: ApiServer, tmp_path: Path) -> None:
    api.put("two", "u", state="Offered", driver=POD, digest="d")
    assert claim(api, "two", tmp_path) == Claimed("u", 1, POD, "d")
    assert api.paths == ["/apis/sim.bagpipe.io/v1alpha1/namespaces/lanes/simulationjobs/two"]
    api.put("two", "u", state="Taken", driver=POD, digest="d")
    api.jobs["two"]["status"]["attempt"] = 3
    assert claim(api, "two", tmp_path) == Claimed("u", 3, POD, "d")


@pytest.mark.parametrize("state", ["Fenced", "Cold", "", None])
def test_what_the_operator_has_given_up_is_no_claim(
    api: ApiServer, tmp_path: Path, state: object
) -> None:
    api.put("two", "u", state=state, driver=POD, digest="d")
    assert claim(api, "two", tmp_path) is None


def test_a_job_that_is_gone_or_going_claims_nobody(api: ApiServer, tmp_path: Path) -> None:
    assert claim(api, "two", tmp_path) is None
    api.put("two", "u", state="Taken", driver=POD, digest="d")
    api.jobs["two"]["metadata"]["deletionTimestamp"] = "2026-11-20T04:00:00Z"
    assert claim(api, "two", tmp_path) is None


@pytest.mark.parametrize(("status", "body"), [(500, None), (403, None), (200, "cut")])
def test_no_answer_is_no_claim_and_no_refusal(
    api: ApiServer, tmp_path: Path, status: int, body: object
) -> None:
    api.jobs["two"], api.status = body, status
    with pytest.raises(OSError, match=r"HTTP Error|simulationjobs/two"):
        claim(api, "two", tmp_path)


@pytest.mark.parametrize(
    "then",
    [
        None,
        Claimed("another-uid", 1, POD, "d"),
        Claimed("u", 2, POD, "d"),
        Claimed("u", 1, "another-pod", "d"),
    ],
)
def test_a_driver_ends_when_its_job_no_longer_claims_it(then: Claimed | None) -> None:
    """The job was deleted, or made again under its name, or has another driver by now."""
    answers: list[Claimed | OSError | None] = [Claimed("u", 1, POD, "d"), OSError("away"), then]
    ended = threading.Event()

    def look_up(_name: str) -> Claimed | None:
        answer = answers.pop(0)
        if isinstance(answer, OSError):
            raise answer
        return answer

    job = job_of_the_driver({}).model_copy(update={"uid": "u", "attempt": 1})
    with own_claim.StillClaimed(job, POD, look_up, ended.set, every_seconds=0.01):
        assert ended.wait(PATIENCE)
    assert answers == []


def test_a_job_that_ends_while_its_claim_is_looked_up_is_not_interrupted() -> None:
    """It may be deleted by then: its own end is no reason to end the driver."""
    asked, interrupted = threading.Event(), threading.Event()

    def look_up(_name: str) -> None:
        asked.set()
        wait_until(lambda: looking.is_over, PATIENCE, "the job's end")

    job = job_of_the_driver({}).model_copy(update={"uid": "u", "attempt": 1})
    looking = own_claim.StillClaimed(job, POD, look_up, interrupted.set, every_seconds=0.01)
    with looking:
        assert asked.wait(PATIENCE)
    assert not interrupted.is_set()


def test_a_driver_whose_job_claims_it_goes_on() -> None:
    looks: list[str] = []
    enough = threading.Event()

    def look_up(name: str) -> Claimed:
        looks.append(name)
        if len(looks) == 3:
            enough.set()
        return Claimed("u", 1, POD, "another digest")

    job = job_of_the_driver({}).model_copy(update={"uid": "u", "attempt": 1})
    ended = threading.Event()
    with own_claim.StillClaimed(job, POD, look_up, ended.set, every_seconds=0.01):
        assert enough.wait(PATIENCE)
    assert not ended.is_set()


def description(name: str) -> bytes:
    view = builders.make_job(name).with_spec("spark.pool", "lane").view()
    return json.dumps(job_file(view, read_spec(view), 1, Settings()), sort_keys=True).encode()


@pytest.mark.parametrize(
    "answer", [b"", b"not HTTP\r\n\r\n", b"HTTP/1.1 200 OK\r\nContent-Length: 100\r\n\r\n{"]
)
def test_an_answer_that_is_cut_off_is_no_answer(tmp_path: Path, answer: bytes) -> None:
    """Python raises what is no OSError for it, which would end whoever looks."""
    (tmp_path / "token").write_text("secret\n")
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answers() -> None:
            connection, _ = server.accept()
            with connection:
                connection.recv(65536)
                connection.sendall(answer)

        thread = threading.Thread(target=answers, daemon=True)
        thread.start()
        with pytest.raises(OSError):  # noqa: PT011  of whatever kind
            own_claim.claim_of(
                "lanes", "two", f"http://127.0.0.1:{server.getsockname()[1]}", tmp_path
            )
        thread.join(PATIENCE)


class Pod:
    """A driver's pod in this process: the real server, seat and turns; `run` does no case."""

    def __init__(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, idle: str = "60") -> None:
        self.word = tmp_path / "termination-log"
        self.word.touch()
        monkeypatch.setattr(driver_main, "_TERMINATION_LOG", self.word)
        monkeypatch.setattr(driver_main, "run", self._run)
        monkeypatch.setattr(driver_main, "claim_of", self._claim_of)
        self.forbidden = False
        self.claims: dict[str, Claimed] = {}
        self.ran: list[str] = []
        self.words: list[str] = []
        self.phases = ["Complete"]
        self.goes_on = threading.Event()
        self.goes_on.set()
        job = JobFile.model_validate_json(description("one"))
        self.driver = driver_main.Driver(
            job, {"BAGPIPE_POD_UID": POD, "BAGPIPE_POOL_IDLE_SECONDS": idle}
        )
        self.server = serve_progress(self.driver.account, "127.0.0.1", 0)
        self.port = self.server.server_address[1]
        self.thread = threading.Thread(target=self.driver.work, daemon=True)

    def _claim_of(self, _namespace: str, name: str) -> Claimed | None:
        if self.forbidden:
            raise OSError("HTTP Error 403: Forbidden")
        return self.claims.get(name)

    def _run(
        self, job: JobFile, progress: Progress, _place: object, _i: Interruption, _count: object
    ) -> bool:
        self.ran.append(job.name)
        self.words.append(self.word.read_text())
        assert self.goes_on.wait(PATIENCE)
        phase = self.phases.pop(0) if len(self.phases) > 1 else self.phases[0]
        progress.phase = phase  # type: ignore[assignment]
        return phase == "Complete"

    def claims_it(self, name: str, body: bytes) -> None:
        uid = json.loads(body)["uid"]
        self.claims[name] = Claimed(uid, 1, POD, hashlib.sha256(body).hexdigest())

    def account(self) -> Any:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE)
        with contextlib.closing(connection):
            connection.request("GET", "/progress")
            return parse(connection.getresponse().read())

    def waits(self, job: str) -> None:
        def has_ended() -> bool:
            account = self.account()
            return bool(account.ended) and account.uid == f"uid-of-{job}"

        wait_until(has_ended, PATIENCE, f"the account of {job}")


@pytest.fixture
def pod(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Pod]:
    made = Pod(tmp_path, monkeypatch)
    yield made
    made.goes_on.set()
    made.driver._seat.leave(stays=False)
    if made.thread.ident is not None:
        made.thread.join(PATIENCE)
    made.server.shutdown()
    made.server.server_close()


async def offered(pod: Pod, body: bytes) -> str:
    async with aiohttp.ClientSession() as session:
        return await DriverOffers(session, PATIENCE, pod.port).offer("127.0.0.1", body)


async def test_one_driver_runs_two_jobs_each_with_an_account_of_its_own(pod: Pod) -> None:
    pod.thread.start()
    pod.waits("one")
    assert json.loads(pod.word.read_text())["uid"] == "uid-of-one"
    body = description("two")
    pod.goes_on.clear()
    pod.claims_it("two", body)
    assert await offered(pod, body) == "taken"
    assert await offered(pod, body) == "taken"
    wait_until(lambda: pod.ran == ["one", "two"], PATIENCE, "the second job")
    account = pod.account()
    assert (account.uid, account.ended, account.phase) == ("uid-of-two", False, "Planning")
    # Whatever ends the pod now, the word of the first job is not the second's.
    assert pod.words == ["", ""]
    pod.goes_on.set()
    pod.waits("two")
    assert await offered(pod, body) == "ended"
    assert json.loads(pod.word.read_text())["uid"] == "uid-of-two"
    assert pod.driver.complete


async def test_a_job_that_does_not_claim_the_driver_is_refused_until_it_does(pod: Pod) -> None:
    pod.thread.start()
    pod.waits("one")
    body = description("two")
    assert await offered(pod, body) == "refused"
    pod.claims_it("two", body)
    assert await offered(pod, body) == "taken"  # who offered it before its operator was nobody
    wait_until(lambda: pod.ran == ["one", "two"], PATIENCE, "the second job")


async def test_what_is_no_job_is_refused_and_a_driver_at_work_too(pod: Pod) -> None:
    pod.goes_on.clear()
    pod.thread.start()
    wait_until(lambda: pod.ran == ["one"], PATIENCE, "the first job")
    body = description("two")
    pod.claims_it("two", body)
    assert await offered(pod, b'{"name": "two"}') == "refused"
    assert await offered(pod, body) == "refused"


class Nobody(Seat):
    """A seat whose driver no job claims."""

    def __init__(self) -> None:
        super().__init__(POD, "lanes", 60.0, lambda _name: None)


@pytest.mark.parametrize("name", ["..", ".", ".two", "two-", "", "../pods"])
def test_a_name_that_is_another_path_of_the_api_is_not_looked_up(name: str) -> None:
    """An error would be no refusal, and its sender asked for again as one who was never refused."""
    looked_up: list[str] = []
    seat = Seat(POD, "lanes", 60.0, looked_up.append)
    head = {"name": name, "namespace": "lanes", "uid": "u", "attempt": 1}
    assert Offers(seat).offered(json.dumps(head).encode(), "10.0.0.1") == "refused"
    assert looked_up == []


@pytest.mark.parametrize(
    "body",
    [
        {"spec": {"source": {"bags": [1] * 300_000}}},
        {"name": "two", "namespace": "lanes", "uid": "u", "attempt": 1, "x": [{}] * 200_000},
        {"name": "x" * 900_000, "namespace": "lanes", "uid": "u", "attempt": 1},
    ],
    ids=["no job", "no claim", "name"],
)
def test_a_forged_offer_is_a_short_line_and_nobody_reads_the_rest(
    body: object, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(JobFile, "model_validate_json", None)
    caplog.set_level(logging.INFO)
    sent = json.dumps(body).encode()
    assert len(sent) < LARGEST_JOB_BYTES
    assert Offers(Nobody()).offered(sent, "10.0.0.9") == "refused"
    [record] = caplog.records
    assert len(record.getMessage()) < 300


@pytest.mark.parametrize("field", ["name", "namespace", "uid", "key"])
def test_a_forged_offer_writes_no_line_of_its_own(
    field: str, caplog: pytest.LogCaptureFixture
) -> None:
    """`bagpipe logs` finds a case's lines by their form."""
    caplog.set_level(logging.INFO)
    line = "2026-11-26 03:00:00,000 bagpipe.driver.keep case night-0001: passed, attempts 1"
    job: dict[str, object] = {"name": "two", "namespace": "lanes", "uid": "u", "attempt": 1}
    where = f"x\n{line}\n" if field == "key" else field
    body = json.dumps(job | {where: f"x\n{line}\n"}).encode()
    assert Offers(Nobody()).offered(body, "10.0.0.9") == "refused"
    assert [record.getMessage().count("\n") for record in caplog.records] == [0]


def test_who_offers_without_end_writes_so_many_lines_a_minute(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO)
    now = 0.0
    offers = Offers(Nobody(), lambda: now)
    for lines in (31, 62):
        for _ in range(500):
            assert offers.offered(b"[]", "10.0.0.9") == "refused"
            assert offers.offered(description("two"), "10.0.0.9") == "refused"
        assert len(caplog.records) == lines
        now += 60.0


async def test_a_job_that_this_driver_can_not_read_is_refused_for_ever_in_a_short_line(
    pod: Pod, caplog: pytest.LogCaptureFixture
) -> None:
    """Its operator is of another version, and makes other pods for it."""
    pod.thread.start()
    pod.waits("one")
    job = json.loads(description("two"))
    job["spec"]["source"]["bags"] = [1] * 10_000
    body = json.dumps(job).encode()
    pod.claims_it("two", body)
    assert await offered(pod, body) == "refused"
    [message] = [r.getMessage() for r in caplog.records if r.levelno == logging.WARNING]
    assert "can't be read" in message
    assert "\n" not in message
    assert len(message) < 600
    pod.claims_it("two", description("two"))
    assert await offered(pod, description("two")) == "refused"


async def test_a_driver_whose_job_failed_ends(pod: Pod) -> None:
    pod.phases = ["Failed"]
    pod.thread.start()
    pod.thread.join(PATIENCE)
    assert not pod.thread.is_alive()
    assert (pod.driver.complete, pod.account().ended) == (False, False)


async def test_a_driver_that_may_not_look_claims_up_waits_for_none(pod: Pod) -> None:
    pod.forbidden = True
    pod.thread.start()
    pod.thread.join(PATIENCE)
    assert not pod.thread.is_alive()
    assert (pod.driver.complete, pod.account().ended) == (True, False)


async def test_a_driver_of_no_pool_ends_and_takes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pod = Pod(tmp_path, monkeypatch, idle="")
    try:
        pod.thread.start()
        pod.thread.join(PATIENCE)
        assert (pod.thread.is_alive(), pod.driver.complete) == (False, True)
        assert not pod.account().ended
        assert await offered(pod, description("two")) == "silent"
    finally:
        pod.server.shutdown()
        pod.server.server_close()


@pytest.mark.parametrize(
    ("length", "body", "status"),
    [(str(LARGEST_JOB_BYTES + 1), b"", 413), ("-1", b"", 413), ("", b"", 413), ("3", b"{}", None)],
)
def test_a_body_that_is_too_large_or_does_not_come_is_not_waited_for(
    pod: Pod, monkeypatch: pytest.MonkeyPatch, length: str, body: bytes, status: int | None
) -> None:
    monkeypatch.setattr("bagpipe.driver.progress_server._BODY_SECONDS", 0.05)
    monkeypatch.setattr("bagpipe.driver.progress_server._Handler.timeout", 0.05)
    connection = http.client.HTTPConnection("127.0.0.1", pod.port, timeout=PATIENCE)
    with contextlib.closing(connection):
        connection.putrequest("POST", "/job")
        if length:
            connection.putheader("Content-Length", length)
        connection.endheaders(body)
        if status is None:
            with pytest.raises(http.client.RemoteDisconnected):
                connection.getresponse()
        else:
            assert connection.getresponse().status == status
