"""One try, against a real HTTP server that does what receivers do when they are not well."""

import asyncio
import base64
import json
import socket
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from bagpipe_operator.notify.letter import Answer, Letter
from bagpipe_operator.notify.sender import LARGEST_ANSWER, Sender
from bagpipe_operator.notify.signature import signed
from bagpipe_operator.receivers import Receiver
from tests.unit.operator.builders import START
from tests.unit.operator.notify.receiver_server import ENDLESS_BYTES, receiver_server

KEY = bytes(range(32))
LETTER = Letter("u", "lanes/x", "team", "u-ended", b'{"specversion":"1.0"}')


@asynccontextmanager
async def sending(url: str, folder: Path, deadline: float = 20.0) -> AsyncIterator[Sender]:
    keys = folder / "key"
    keys.write_bytes(b"whsec_" + base64.b64encode(KEY) + b"\n")
    made = Sender(Receiver("team", url), keys, lambda: START, deadline)
    yield made
    await made.close()


async def answered(what: str, folder: Path, deadline: float = 20.0) -> Answer:
    with receiver_server(what) as (url, _):
        async with sending(url, folder, deadline) as made:
            return await made.post(LETTER)


async def test_an_event_arrives_whole_and_signed(tmp_path: Path) -> None:
    with receiver_server() as (url, server):
        async with sending(url, tmp_path) as made:
            assert await made.post(LETTER) == Answer(True)
    (got,) = server.received
    assert (got.path, got.body) == ("/bagpipe", LETTER.body)
    assert got.headers["content-type"] == "application/cloudevents+json; charset=utf-8"
    expected = signed((KEY,), "u-ended", int(START.timestamp()), LETTER.body)
    assert {key: got.headers[key] for key in expected} == expected


@pytest.mark.parametrize("status", [200, 201, 202, 204])
async def test_every_success_is_one(status: int, tmp_path: Path) -> None:
    assert await answered(str(status), tmp_path) == Answer(True)


@pytest.mark.parametrize(
    ("what", "answer"),
    [
        ("500", Answer(False, "it answered 500")),
        ("404", Answer(False, "it answered 404")),
        ("429", Answer(False, "it answered 429", wait_seconds=77.0)),
        ("410", Answer(False, "it answered 410: it wants no notifications any more", final=True)),
        ("closed", Answer(False, "it can't be reached (ServerDisconnectedError)")),
    ],
)
async def test_a_refusal_says_which(what: str, answer: Answer, tmp_path: Path) -> None:
    assert await answered(what, tmp_path) == answer


async def test_a_redirect_is_not_followed(tmp_path: Path) -> None:
    for status in ("301", "302", "307", "308"):
        with receiver_server(status) as (url, server):
            async with sending(url, tmp_path) as made:
                answer = await made.post(LETTER)
        assert (answer.accepted, [got.path for got in server.received]) == (False, ["/bagpipe"])
        assert answer.words.startswith(f"it answered {status}, a redirect")


async def test_silence_ends_by_the_deadline(tmp_path: Path) -> None:
    answer = await answered("silent", tmp_path, deadline=0.2)
    assert answer == Answer(False, "it did not answer within 0.2 s")


async def test_a_body_that_does_not_come_changes_no_success(tmp_path: Path) -> None:
    for deadline in (0.5, 5.0, 50.0):  # a slow machine needs longer to get as far as the status
        answer = await answered("late", tmp_path, deadline)
        if answer != Answer(False, f"it did not answer within {deadline:g} s"):
            break
    assert answer == Answer(True)


async def test_a_body_of_ten_gigabytes_is_not_read(tmp_path: Path) -> None:
    with receiver_server("endless") as (url, server):
        async with sending(url, tmp_path) as made:
            assert await made.post(LETTER) == Answer(False, "it answered 500")
            # The server learns that nobody reads: what lies between are sockets' buffers.
            assert await asyncio.to_thread(server.closed.wait, 60)
    assert server.sent_bytes < ENDLESS_BYTES // 100
    assert LARGEST_ANSWER == 16384


async def test_headers_without_an_end_are_no_answer(tmp_path: Path) -> None:
    answer = await answered("headers", tmp_path)
    assert (answer.accepted, answer.final) == (False, False)


async def test_who_is_not_there_is_not_reached_and_its_address_not_shown(tmp_path: Path) -> None:
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))  # and does not listen
        async with sending(f"http://127.0.0.1:{held.getsockname()[1]}/s3cr3t", tmp_path) as made:
            answer = await made.post(LETTER)
    assert answer == Answer(False, "it can't be reached (ClientConnectorError)")


async def test_nothing_is_sent_unsigned(tmp_path: Path) -> None:
    with receiver_server() as (url, server):
        async with sending(url, tmp_path) as made:
            made.keys.write_bytes(b"whsec_c2hvcnQ=")
            short = await made.post(LETTER)
            made.keys.unlink()
            gone = await made.post(LETTER)
            made.keys.write_bytes(b"whsec_" + base64.b64encode(KEY))
            mended = await made.post(LETTER)
    assert short.words == "its key can't be used: a key has 5 bytes: make it of 24 to 64"
    assert gone.words.startswith("its key can't be used: the Secret's key `key` is not there")
    assert (mended, len(server.received)) == (Answer(True), 1)


async def test_a_name_server_that_hangs_holds_up_nobody_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looking, over = threading.Event(), threading.Event()
    threads: list[str] = []
    asked = socket.getaddrinfo

    def hangs(host: str, *rest: object, **more: object) -> object:
        if host != "slow.example":
            return asked(host, *rest, **more)  # type: ignore[arg-type]
        threads.append(threading.current_thread().name)
        looking.set()
        over.wait()
        raise socket.gaierror(-2)

    monkeypatch.setattr(socket, "getaddrinfo", hangs)
    with receiver_server() as (url, _):
        by_name = url.replace("127.0.0.1", "localhost")
        async with (
            sending("http://slow.example/", tmp_path, 60) as slow,
            sending(by_name, tmp_path) as quick,
        ):
            held = asyncio.create_task(slow.post(LETTER))
            assert await asyncio.to_thread(looking.wait, 60)
            assert await quick.post(LETTER) == Answer(True)
            over.set()
            assert (await held).words == "it can't be reached (ClientConnectorDNSError)"
    # Of the receiver's own, of which there is one: not one of those that all calls share.
    assert threads == ["notify-team_0"]


def test_the_letter_of_these_tests_is_json() -> None:
    assert json.loads(LETTER.body)["specversion"] == "1.0"
