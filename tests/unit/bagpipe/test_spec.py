"""The spec's models: durations, URIs and claims."""

from typing import Any

import pytest
from pydantic import ValidationError

from bagpipe.spec import claims, duration_seconds
from tests.unit.bagpipe.jobs import make_spec


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
        ({"source": {"bags": ["s3://fleet/a.bag"]}}, "pvc://<claim>/<path>"),
        ({"source": {"bags": ["pvc://a/../b.bag"]}}, "leaves its volume"),
        ({"source": {"bags": []}}, "at least 1 item"),
        ({"source": {"bags": ["pvc://a/b"], "topics": ["scan"]}}, "write /scan"),
        ({"playback": {"rate": 0}}, "greater than 0"),
        ({"playback": {"caseTimeout": "0s"}}, "above zero"),
        ({"playback": {"mode": "lockstep"}}, "belong together"),
        ({"playback": {"steps": [{"trigger": "/a", "answer": "/b"}]}}, "belong together"),
        ({"playback": {"mode": "lockstep", "steps": [{"trigger": "a", "answer": "/b"}]}}, "/a"),
        ({"stack": {"image": "x", "command": []}}, "at least 1 item"),
    ],
)
def test_refusals_say_what_to_write(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        make_spec(**changed)


def test_claims_are_read_only_unless_they_take_the_output() -> None:
    bags = {"bags": ["pvc://recordings/a.bag", "pvc://results/b.bag", "file:///c.bag"]}
    assert claims(make_spec(source=bags)) == {"recordings": True, "results": False}
