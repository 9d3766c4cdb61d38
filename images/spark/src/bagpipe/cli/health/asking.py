"""Asks the API server several things at once, each with a deadline of its own, by rights that a
user has. Nothing is changed, and of Secrets no value is read.
"""

import json
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor

import urllib3
from kubernetes.client.exceptions import ApiException

from bagpipe.cli.cluster.api import Cluster
from bagpipe.cli.health.replies import Answer, Question

_MOST_BYTES = 16 << 20
_PIECE_BYTES = 64 << 10
_AT_ONCE = 6
# Names and labels of an object without what is in it.
_METADATA = "application/json;as=PartialObjectMetadata;g=meta.k8s.io;v=v1"


def ask(cluster: Cluster, questions: Mapping[str, Question], seconds: float) -> dict[str, Answer]:
    """The answers by the questions' names; each comes within `seconds` or has the status 0."""
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        asked = {
            name: pool.submit(_answer, cluster, question, seconds)
            for name, question in questions.items()
        }
        return {name: each.result() for name, each in asked.items()}


def _answer(cluster: Cluster, question: Question, seconds: float) -> Answer:
    client = cluster.core.api_client
    until = time.monotonic() + seconds
    headers = {"Accept": _METADATA if question.metadata else "application/json"}
    method = "GET" if question.body is None else "POST"
    if question.body is not None:
        headers["Content-Type"] = "application/json"
    try:
        request = client.param_serialize(
            method, question.path, header_params=headers, body=question.body,
            auth_settings=["BearerToken"],
        )  # fmt: skip
        response = client.call_api(*request, _request_timeout=seconds)
        data = bytearray()
        for piece in response.response.stream(_PIECE_BYTES):
            data += piece
            if len(data) > _MOST_BYTES:
                return Answer(0, why=f"an answer of more than {_MOST_BYTES >> 20} MiB")
            if time.monotonic() > until:
                return Answer(0, why=f"no whole answer within {seconds:g} s")
        return _read(response.status, bytes(data))
    except ApiException as error:
        body = error.body if isinstance(error.body, str) else ""
        return _read(error.status or 0, body.encode()) if body else Answer(0, why=str(error.reason))
    except (urllib3.exceptions.HTTPError, OSError, ValueError) as error:
        return Answer(0, why=str(error).rpartition(": ")[2][:200] or type(error).__name__)


def _read(status: int, data: bytes) -> Answer:
    try:
        body = json.loads(data)
    except (ValueError, RecursionError):
        body = None
    if not isinstance(body, dict):
        why = data[:200].decode(errors="replace")
        return Answer(status if status >= 400 else 0, why=why or "an empty answer")
    if status >= 400:
        return Answer(status, body, str(body.get("message") or status)[:500])
    return Answer(status, body)
