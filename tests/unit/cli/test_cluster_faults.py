"""What the API server refuses, in sentences that say what to do next."""

import json

import click
import pytest

from bagpipe.cli.cluster.faults import Asked, no_job, refused, unreachable

ASKED = Asked("get", "simulationjobs", "nightly", "robots", "lab")


def status(code: int, message: str, **details: object) -> str:
    document = {"kind": "Status", "code": code, "message": message, "details": details}
    return json.dumps(document)


def causes(*found: tuple[str, str]) -> dict[str, object]:
    return {"causes": [{"field": field, "message": message} for field, message in found]}


@pytest.mark.parametrize(
    ("code", "body", "sentence"),
    [
        (401, "Unauthorized", "does not know you: the credentials in the kubeconfig"),
        (
            403,
            status(403, 'User "ci" cannot get resource "simulationjobs"'),
            "kubectl auth can-i get simulationjobs.sim.bagpipe.io -n robots",
        ),
        (404, "404 page not found\n", "knows no SimulationJobs: Bagpipe is not installed there"),
        (404, status(404, "x", kind="namespaces"), "there is no namespace robots"),
        (404, status(404, "x", kind="simulationjobs"), "there is no job nightly in namespace"),
        (500, status(500, "etcd is slow"), "answered 500 when it was asked to get job nightly"),
        (0, "", "certificate-authority"),
    ],
)
def test_each_refusal_says_what_to_do(code: int, body: str, sentence: str) -> None:
    assert sentence in refused(code, "reason", body, ASKED).message


@pytest.mark.parametrize(
    ("code", "passing"), [(0, False), (401, False), (403, False), (404, False), (410, True),
                          (429, True), (500, True), (503, True)],
)  # fmt: skip
def test_what_may_pass_is_marked(code: int, passing: bool) -> None:
    error = refused(code, "reason", "", ASKED)
    assert (error.passing, error.exit_code) == (passing, 2)


def test_a_name_that_is_taken() -> None:
    create = Asked("create", "simulationjobs", "nightly", "robots", "lab")
    text = refused(409, "Conflict", status(409, "already exists"), create).message
    assert "is there already in namespace robots: give another name with --name" in text


def test_rules_are_sentences_without_the_value_that_they_judge() -> None:
    body = status(
        422,
        "SimulationJob ... is invalid: [a wall of text]",
        **causes(
            ("spec.source", 'Invalid value: "object": source needs either bags or files: write it'),
            ("spec.source.bags[0]", 'Invalid value: "dri\\"ve: x": write pvc://<claim>/<path>'),
            ("spec.spark.slots", "Invalid value: 0: spec.spark.slots should be at least 1"),
            ("spec", 'Invalid value: {"a":{"b":[1]}}: record is missing'),
            ("spec.stack.image", "Required value"),
            ("<nil>", "Invalid value: null: some validation rules were not checked because ..."),
        ),
    )
    create = Asked("create", "simulationjobs", "nightly", "robots", "lab")
    assert refused(422, "Invalid", body, create).message.splitlines() == [
        "job nightly is refused:",
        "  spec.source: source needs either bags or files: write it",
        "  spec.source.bags[0]: write pvc://<claim>/<path>",
        "  spec.spark.slots: spec.spark.slots should be at least 1",
        "  spec: record is missing",
        "  spec.stack.image: Required value",
        "  further rules are checked when these faults are mended",
    ]


def test_fields_that_do_not_exist_are_named() -> None:
    message = 'strict decoding error: unknown field "spec.sourc", duplicate field "spec.stack"'
    text = refused(400, "BadRequest", status(400, message), ASKED).message
    assert "  spec.sourc: there is no such field" in text
    assert "  spec.stack: this field is there twice" in text


def test_a_refusal_in_other_words_is_passed_on() -> None:
    text = refused(400, "BadRequest", status(400, "the body is odd"), ASKED).message
    assert text == "job nightly is refused:\n  the body is odd"


@pytest.mark.parametrize(
    ("near", "others", "sentence"),
    [
        (["nightly-2", "nightly-3"], 9, "did you mean nightly-2 or nightly-3?"),
        ([], 9, "`kubectl -n robots get simulationjobs` lists those there are"),
        ([], 0, "is it in another namespace (-n)?"),
    ],
)
def test_a_job_that_is_not_there(near: list[str], others: int, sentence: str) -> None:
    assert sentence in no_job(ASKED, near, others)


def test_kubectl_is_asked_in_the_context_that_was_given() -> None:
    with click.Context(click.Command("watch")) as context:
        context.params["context"] = "lab"
        unknown = refused(401, "Unauthorized", "", ASKED).message
        forbidden = refused(403, "Forbidden", status(403, "x cannot get y"), ASKED).message
        missing = no_job(ASKED, [], 9)
    assert "`kubectl --context lab -n robots get simulationjobs`" in unknown
    assert "`kubectl --context lab -n robots get simulationjobs`" in missing
    assert "simulationjobs.sim.bagpipe.io -n robots --context lab`" in forbidden


def test_a_server_that_is_not_there() -> None:
    try:
        try:
            raise ConnectionRefusedError(111, "Connection refused")
        except OSError as cause:
            raise OSError("HTTPSConnectionPool(host='h', port=1): Max retries") from cause
    except OSError as error:
        found = unreachable(error, ASKED)
    assert "does not answer ([Errno 111] Connection refused): is it up" in found.message
    assert found.passing
