"""Criteria that the API server refuses, and criteria that the models refuse, are the same ones."""

import copy
import math
from typing import Any

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from bagpipe.evaluate.model import KINDS, RAN, Criterion
from tests.unit.crds.offline import refusals
from tests.unit.crds.test_crd import CRD, schema_of

Value = dict[str, Any]

_SPEC = schema_of(yaml.load(CRD.read_text(), Loader=yaml.CSafeLoader))["properties"]["spec"]
SCHEMA = _SPEC["properties"]["evaluate"]["items"]

GOOD: dict[str, Value] = {
    "presence": {"topic": "/a", "min": 2, "max": 3, "minCoverage": 0.2},
    "rate": {"topic": "/a/b_1", "min": 1, "max": 2.5, "over": "worst"},
    "latency": {"topic": "/a", "max": "1m30s", "percentile": 99.9},
    "bounds": {"topic": "/a", "field": "pose.covariance[35]", "min": -1.5},
    "expression": {"topic": "/a", "holds": "msg.data < 3.0", "share": 0.5, "finite": False},
    "error": {
        "topic": "/a", "fields": ["r", "y.z[0]"], "truth": "/b", "truthFields": ["u", "v"],
        "metric": "final", "max": 1, "stampTolerance": "50ms", "angle": True, "anyFrame": True,
        "minCoverage": 1,
    },
    "finalPose": {
        "topic": "/a", "position": [1, 2.5], "maxDistance": 0.1, "yaw": 3, "maxYawError": 0.1,
        "anyFrame": True,
    },
    "separation": {
        "ego": "/a", "obstacles": "/b", "radius": 1, "minDistance": 0.5, "maxAge": "500ms",
    },
    "resources": {"maxCpu": 1.5, "maxMemory": "500Ki"},
    "own": {
        "configMap": "a.b-c", "file": "x.py", "function": "judge", "topics": ["/a", "/b"],
        "timeout": "90s",
    },
}  # fmt: skip
# Texts that one of the fields takes and others don't, or that differ for one regular expression
# engine and not for another: ends of lines, digits and letters that are not ASCII's.
TEXTS = [
    "", "/", "a", "/a", "/a\n", "a\n", "//", "/a/", "/a//b", "/a b", "/ä", "/٣", "100", "100ms",
    "1.5s", "1.s", "5 s", "-1s", "0s", "0.000s", "٣s", "1s\n", "1h30m", "24h", "24h1s",
    "86400s", "9999999s", "1d", "1s1s1s1s1s", "x", "x.", "x..y", ".x", "x[1]", "x[]", "x[-1]",
    "x[1].y", "x[٣]", "1x", "é", "2Gi", "2gi", "500Mi", "1.5k", "1K", "1e3", "x.py", "x.py\n",
    ".py", "../x.py", "X-1.py", "f()", "judge", "a.b", "A", "-a", "a-", "window", "worst",
    "rmse", "/" + "a" * 255, "/" + "a" * 256, "s" * 40, "true",
]  # fmt: skip
NUMBERS = [-1, -0.5, 0, 0.0, 1, 1.0, 0.5, 2, 3, 99.5, 100, 100.5, 1e300]
VALUES = st.one_of(
    st.sampled_from([*TEXTS, *NUMBERS, True, False, [], {}]),
    st.sampled_from([["x"], ["/a"], [1.0, 2, 3], [1, 2, 3, 4]]),
    st.text(max_size=8),
    st.floats(allow_nan=False, allow_infinity=False),
    st.integers(-(2**40), 2**40),
    st.lists(st.sampled_from(TEXTS), max_size=3),
)  # fmt: skip


def taken_by_the_model(value: Value) -> bool:
    try:
        Criterion.model_validate(value)
    except ValidationError:
        return False
    return True


@st.composite
def criteria(draw: st.DrawFn) -> Value:
    """A good criterion with up to three of its fields changed, left out or made up."""
    kind = draw(st.sampled_from(KINDS))
    fields = copy.deepcopy(GOOD[kind])
    known = list(SCHEMA["properties"][kind]["properties"])
    for _ in range(draw(st.integers(0, 3))):
        name = draw(st.sampled_from([*known, "speed"]))
        if draw(st.integers(0, 4)) == 0:
            fields.pop(name, None)
        else:
            fields[name] = draw(VALUES)
    name = draw(
        st.sampled_from(["c", "lane rate", "1.b-c_d", "", "-a", " a", "a\n", "ä", "a" * 64])
    )
    return {"name": name, kind: fields}


@settings(max_examples=3000, deadline=None)
@given(criteria())
@example({"name": "c", "latency": {"topic": "/a", "max": "100"}})
@example({"name": "c", "bounds": {"topic": "/a", "field": "x", "min": 2, "max": 1}})
@example({"name": "c", "own": {"configMap": "a", "timeout": "0s"}})
def test_the_api_server_and_the_models_refuse_the_same(value: Value) -> None:
    refused = refusals(SCHEMA, value)
    assert (refused == []) == taken_by_the_model(value), (value, refused)


@pytest.mark.parametrize("kind", KINDS)
def test_a_good_criterion_is_taken(kind: str) -> None:
    value = {"name": "c", kind: GOOD[kind]}
    assert (refusals(SCHEMA, value), taken_by_the_model(value)) == ([], True)


REFUSED: list[tuple[str, Value, str]] = [
    ("latency", {"max": "100"}, "latency.max must be a duration with its unit: write for"),
    ("latency", {"topic": "imu"}, "this is no topic's name"),
    ("presence", {"max": 1}, "presence has a max below its min: write min: 0 as well"),
    ("presence", {"min": 0, "max": ...}, "presence.min: 0 alone holds for every stack"),
    ("rate", {"min": 0, "max": ...}, "rate.min of 0 or less alone holds for every stack"),
    ("rate", {"min": -1, "max": ...}, "rate.min of 0 or less alone holds for every stack"),
    ("rate", {"max": 0.5}, "rate has a max below its min"),
    ("bounds", {"field": "pose..x"}, "a field is a path of names"),
    ("expression", {"holds": ""}, "expression.holds is empty"),
    ("error", {"fields": [], "truthFields": []}, "error.fields is empty"),
    ("error", {"truthFields": ["u"]}, "error.truthFields and fields differ in number"),
    ("error", {"stampTolerance": "50"}, "error.stampTolerance must be a duration with its unit"),
    ("error", {"truth": "/a", "truthFields": []}, "error compares a topic with itself"),
    ("error", {"truth": "/a", "truthFields": ["r", "y.z[0]"]}, "error compares a topic with"),
    ("error", {"fields": ["x", "theta"]}, "error.angle is for all fields, of which one is x, y"),
    ("error", {"truthFields": ["a.z", "theta"]}, "error.angle is for all fields, of which one"),
    ("finalPose", {"maxYawError": 3.1415}, "finalPose.yaw and maxYawError go together"),
    ("separation", {"maxAge": "0s"}, "separation.maxAge must be a duration above zero"),
    ("resources", {"maxMemory": "2 GB"}, "resources.maxMemory is no quantity"),
    ("own", {"timeout": "25h"}, "own.timeout must be a duration above zero and of at most 24h"),
    ("own", {"file": "../x.py"}, "own.file is a ConfigMap's key that ends with .py"),
    ("own", {"function": "f()"}, "own.function is the name of a Python function"),
    ("own", {"configMap": "Lane"}, "a ConfigMap's name holds lower-case letters"),
    ("own", {"topics": ["odom"]}, "this is no topic's name"),
]


@pytest.mark.parametrize(("kind", "changed", "sentence"), REFUSED)
def test_a_refusal_says_what_to_write(kind: str, changed: Value, sentence: str) -> None:
    fields = {name: given for name, given in (GOOD[kind] | changed).items() if given is not ...}
    [refused] = refusals(SCHEMA, {"name": "c", kind: fields})
    assert sentence in refused
    assert "write " in refused
    assert not taken_by_the_model({"name": "c", kind: fields})


@pytest.mark.parametrize(
    ("kind", "changed"),
    [
        ("presence", {"min": 0}),
        ("rate", {"min": 0}),
        ("rate", {"min": -1.5, "max": 0.0}),
        ("rate", {"min": 1e-9}),
        ("separation", {"minDistance": 1e-9}),
    ],
)
def test_what_may_fail_is_taken(kind: str, changed: Value) -> None:
    value = {"name": "c", kind: GOOD[kind] | changed}
    assert (refusals(SCHEMA, value), taken_by_the_model(value)) == ([], True)


def test_a_distance_of_nothing_is_refused() -> None:
    value = {"name": "c", "separation": GOOD["separation"] | {"minDistance": 0}}
    assert refusals(SCHEMA, value)
    assert not taken_by_the_model(value)
    assert Criterion.model_validate(value, context={RAN: True}).name == "c"


@pytest.mark.parametrize(
    ("kind", "field"),
    [
        ("finalPose", "maxDistance"), ("finalPose", "maxYawError"), ("separation", "radius"),
        ("separation", "minDistance"), ("separation", "minTimeToCollision"),
        ("resources", "maxCpu"), ("bounds", "min"), ("rate", "max"), ("error", "max"),
    ],
)  # fmt: skip
def test_a_bound_that_is_infinite_is_none(kind: str, field: str) -> None:
    """YAML has such numbers, and JSON, in which the API server takes a manifest, has not."""
    value = {"name": "c", kind: GOOD[kind] | {field: math.inf}}
    assert not taken_by_the_model(value)
    assert Criterion.model_validate(value, context={RAN: True}).name == "c"


@pytest.mark.parametrize("half", ["yaw", "maxYawError"])
def test_a_heading_has_a_bound_and_a_bound_a_heading(half: str) -> None:
    value = {"name": "c", "finalPose": {k: v for k, v in GOOD["finalPose"].items() if k != half}}
    [refused] = refusals(SCHEMA, value)
    assert "write both, the error below 3.1415, or neither" in refused
    assert not taken_by_the_model(value)


@pytest.mark.parametrize(
    ("kind", "changed"),
    [
        ("error", {"truth": "/a"}),  # in other fields
        ("error", {"truth": "/a", "truthFields": [], "recording": True}),
        ("error", {"fields": ["x", "theta"], "angle": False}),
        ("error", {"fields": ["rpy.z"], "truthFields": ["z"]}),
        ("error", {"fields": ["roll", "max"]}),
    ],
)
def test_what_can_be_meant_is_taken(kind: str, changed: Value) -> None:
    value = {"name": "c", kind: GOOD[kind] | changed}
    assert (refusals(SCHEMA, value), taken_by_the_model(value)) == ([], True)


def test_what_an_earlier_release_took_is_read_with_its_results() -> None:
    """The API server had put the bound in that no heading exceeds."""
    pose = {k: v for k, v in GOOD["finalPose"].items() if k not in {"yaw", "maxYawError"}}
    stored = {"name": "c", "finalPose": pose | {"maxYawError": 3.141592653589793}}
    assert (refusals(SCHEMA, stored), taken_by_the_model(stored)) == ([], True)
    itself = {"name": "c", "error": GOOD["error"] | {"truth": "/a", "truthFields": []}}
    places = {"name": "c", "error": GOOD["error"] | {"fields": ["x", "theta"]}}
    turned = pose | {"maxYawError": 3.141592653589793, "yaw": 1}
    nothing = [
        {"name": "c", "presence": {"topic": "/a", "min": 0}},
        {"name": "c", "rate": {"topic": "/a", "min": 0}},
    ]
    for value in (*nothing, itself, places, {"name": "c", "finalPose": turned}):
        assert not taken_by_the_model(value)
        assert Criterion.model_validate(value, context={RAN: True}).name == "c"
