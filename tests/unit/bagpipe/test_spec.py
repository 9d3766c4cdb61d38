"""The spec's models: durations, URIs and claims."""

import json
from typing import Any

import pytest
from pydantic import ValidationError

from bagpipe.spec import claims
from bagpipe.texts import duration_seconds
from tests.unit.bagpipe.jobs import make_spec

EXEC = {"image": "x", "command": ["run"], "engine": "exec"}


@pytest.mark.parametrize(
    ("text", "seconds"), [("20s", 20), ("1m30s", 90), ("500ms", 0.5), ("2h", 7200), ("1.5s", 1.5)]
)
def test_durations(text: str, seconds: float) -> None:
    assert duration_seconds(text) == seconds


@pytest.mark.parametrize("text", ["", "20", "s", "1d", "-1s", "1 s"])
def test_what_is_no_duration_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(ValueError, match="write for example 20s"):
        duration_seconds(text)


def test_defaults() -> None:
    spec = make_spec()
    assert (spec.playback.mode, spec.playback.rate) == ("realtime", 1.0)
    assert (spec.source.fragment.length, spec.source.fragment.warm_up) == ("60s", "0s")
    assert (spec.spark.executors, spec.spark.slots) == (1, 1)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"source": {"bags": ["ftp://fleet/a.bag"]}}, "pvc://<claim>/<path>, s3://<bucket>/"),
        ({"source": {"bags": ["s3://fleet"]}}, "has no known scheme"),
        (
            {"variants": [{"name": "a", "env": [{"name": "X"}, {"name": "X", "value": "1"}]}]},
            "'X' is there twice: write it once",
        ),
        ({"source": {"bags": ["https://fleet.example/*.bag"]}}, "without wildcards"),
        ({"output": {"uri": "https://fleet.example/r"}}, "only be read from"),
        ({"storage": {"secrets": ["S3_Login"]}}, "can't be the name of a Secret"),
        ({"storage": {"secrets": list("abcdefghi")}}, "at most 8 items"),
        ({"source": {"bags": ["pvc://a/../b.bag"]}}, "leaves its volume"),
        ({"source": {"bags": []}}, "source.sequence and source.files, with at least one"),
        ({"source": {"bags": ["pvc://a/b"], "files": ["pvc://a/c"]}}, "write one of source.bags"),
        ({"source": {"files": ["pvc://a/c"], "topics": ["/t"]}}, "leave them out"),
        ({"source": {"files": ["pvc://a/c"]}}, "need stack.engine: exec"),
        ({"record": None}, "write for example record"),
        ({"stack": EXEC}, "record has no meaning"),
        ({"stack": EXEC | {"remap": {"/a": "/b"}}, "record": None}, "stack.env"),
        ({"stack": EXEC | {"parameters": {"/a": 1}}, "record": None}, "stack.env"),
        ({"stack": EXEC, "record": None, "playback": {"mode": "max"}}, "caseTimeout"),
        ({"stack": EXEC, "record": None, "playback": {"rate": 2}}, "caseTimeout"),
        ({"source": {"bags": ["pvc://a/b"], "topics": ["scan"]}}, "write /scan"),
        ({"spark": {"executors": 0}}, "greater than or equal to 1"),
        ({"spark": {"executors": 1001}}, "less than or equal to 1000"),
        ({"spark": {"executors": "4"}}, "such as 4, or {min: 1, max: 4}"),
        ({"spark": {"executors": True}}, "such as 4, or {min: 1, max: 4}"),
        ({"spark": {"executors": {"min": 0, "max": 3}}}, "greater than or equal to 1"),
        ({"spark": {"executors": {"min": 1, "max": 1001}}}, "less than or equal to 1000"),
        ({"spark": {"executors": {"min": 4, "max": 3}}}, "write a max that is at least min"),
        ({"spark": {"executors": {"min": 1}}}, "executors.range.max\n.*Field required"),
        ({"spark": {"executors": {"min": 1, "max": 2, "most": 3}}}, "Extra inputs"),
        ({"playback": {"rate": 0}}, "greater than 0"),
        ({"playback": {"rounds": 0}}, "greater than or equal to 1"),
        ({"playback": {"rounds": 101}}, "less than or equal to 100"),
        ({"playback": {"caseTimeout": "0s"}}, "above zero"),
        ({"playback": {"mode": "lockstep"}}, "playback.steps are missing"),
        (
            {
                "playback": {"mode": "lockstep", "steps": [{"trigger": "/a", "answer": "/b"}]},
                "record": {"topics": ["/b"]},
                "evaluate": [{"name": "fast", "latency": {"topic": "/b", "max": "1s"}}],
            },
            r"evaluate\[fast\] has latency, and in lock-step an answer has the time of its input",
        ),
        (
            {
                "playback": {"mode": "max"},
                "record": {"topics": ["/b"]},
                "evaluate": [{"name": "fast", "latency": {"topic": "/b", "max": "1s"}}],
            },
            r"evaluate\[fast\] has latency, and in max an answer has the time of the last input",
        ),
        ({"playback": {"steps": [{"trigger": "/a", "answer": "/b"}]}}, "write that as well"),
        ({"playback": {"mode": "lockstep", "steps": [{"trigger": "a", "answer": "/b"}]}}, "/a"),
        ({"stack": {"image": "x", "command": []}}, "at least 1 item"),
    ],
)
def test_refusals_say_what_to_write(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        make_spec(**changed)


@pytest.mark.parametrize(
    ("executors", "of_cases", "slots"),
    [
        (3, {0: 3, 1: 3, 100: 3}, 6),
        ({"min": 1, "max": 3}, {0: 1, 1: 1, 2: 1, 3: 2, 4: 2, 5: 3, 100: 3}, 6),
        ({"min": 2, "max": 2}, {0: 2, 100: 2}, 4),
    ],
)
def test_executors_are_a_number_or_as_many_as_have_cases(
    executors: Any, of_cases: dict[int, int], slots: int
) -> None:
    spark = make_spec(spark={"executors": executors, "slots": 2}).spark
    assert {cases: spark.executors_for(cases) for cases in of_cases} == of_cases
    assert (spark.most_slots, spark.is_elastic) == (slots, isinstance(executors, dict))
    # As the operator hands it to the driver.
    passed_on = make_spec(spark=json.loads(spark.model_dump_json(by_alias=True))).spark
    assert passed_on == spark


@pytest.mark.parametrize(
    "uri",
    [
        "s3://key:hidden@fleet/a.bag",
        "hdfs://user:hidden@namenode:8020/a.bag",
        "https://fleet.example/a.bag?X-Amz-Signature=hidden",
        "az://fleet/a.bag?sig=hidden",
    ],
)
def test_a_uri_with_a_credential_is_refused_without_repeating_it(uri: str) -> None:
    with pytest.raises(ValidationError, match="put it into a Secret") as refused:
        make_spec(source={"bags": [uri]})
    assert all("hidden" not in error["msg"] for error in refused.value.errors())
    assert "hidden" not in str(refused.value)


@pytest.mark.parametrize(
    "uri",
    ["s3://b/x/*.bag", "gs://b_1/x", "az://c/x", "hdfs://nn.lab:8020/x", "hdfs://nn/x",
     "https://h.example:8443/x.bag", "file:///x"],
)  # fmt: skip
def test_all_schemes_are_known(uri: str) -> None:
    assert make_spec(source={"bags": [uri]}).source.own == [uri]


def test_claims_are_read_only_unless_they_take_the_output() -> None:
    bags = {"bags": ["pvc://recordings/a.bag", "pvc://results/b.bag", "file:///c.bag"]}
    assert claims(make_spec(source=bags)) == {"recordings": True, "results": False}


def test_a_program_of_another_engine_reads_bags_or_files() -> None:
    bags = make_spec(stack=EXEC, record=None)
    assert (bags.stack.engine, bags.source.uris) == ("exec", ["pvc://recordings/*.bag"])
    source = {"files": ["pvc://scenarios/*.json"]}
    files = make_spec(stack=EXEC, record=None, source=source, playback={"caseTimeout": "1m"})
    assert files.source.uris == ["pvc://scenarios/*.json"]
    assert claims(files) == {"scenarios": True, "results": False}
