"""Which parts of a message an expression reads."""

import math
from typing import Any

import pytest

from bagpipe.evaluate.reads import Path, never_equal, paths_of
from tests.unit.evaluate.drives import INPUTS, answer, case, found
from tests.unit.evaluate.recordings import STORE, number


@pytest.mark.parametrize(
    ("text", "paths"),
    [
        ("msg.a.b < 3.0", [("a", "b")]),
        ("msg . a [ 3 ].b == msg['c'][\"d\"]", [("a", 3, "b"), ("c", "d")]),
        ("msg.a.size() > 0 && msg.a[case.n] < 1.0", [("a",)]),
        ("msg", [()]),
        ("[msg].exists(m, m.a < 1.0)", [()]),
        # What a text says, a comment, and what is called like it elsewhere is no message.
        ("msg.a != 'no msg'", [("a",)]),
        ("msg.a != \"a 'msg' of it\" && msg.b < 1.0", [("a",), ("b",)]),
        (r"msg.a != 'it\'s msg' && msg.b == r'\' && msg.c == 'msg'", [("a",), ("b",), ("c",)]),
        ("msg.a != '''a 'msg' b''' && msg.b == ''", [("a",), ("b",)]),
        ("msg.a < 1.0 // isn't msg\n&& msg.b != 'x'", [("a",), ("b",)]),
        ("msg.a == '// msg' && msg.b < 1.0", [("a",), ("b",)]),
        ("msg.a in ['msg', 'none']", [("a",)]),
        ("case.msg == 1 && msg.a < 1.0", [("a",)]),
        ("amsg.a == 1", []),
        # In doubt all of it.
        (".msg.a < 1.0", [("a",)]),
        (r"msg['\x61'] < 1.0", [()]),
        ("case . msg < 1.0", [()]),
    ],
)
def test_what_an_expression_reads(text: str, paths: list[Path]) -> None:
    assert paths_of(text) == paths


@pytest.mark.parametrize(
    ("holds", "outcome"),
    [
        ("msg.header.frame_id != 'no msg'", "passed"),
        ("msg.header.frame_id != 'none' // as msg says", "passed"),
        ("msg.header.frame_id != 'none' && msg['pose'].position.x != 3.0", "failed"),
    ],
)
def test_a_word_in_a_text_reads_nothing(holds: str, outcome: str) -> None:
    entries = [*(answer(at) for at in INPUTS[:-1]), answer(14.9, x=math.inf)]
    wanted: dict[str, Any] = {"expression": {"topic": "/pose", "holds": holds}}
    finding = found(case(entries), wanted)
    assert finding.outcome == outcome, finding


MESSAGE: dict[str, Any] = {
    "flag": False, "text": "5", "size": 3, "ratio": 0.5, "list": [1.0], "raw": b"ab",
    "inner": {"flag": True},
}  # fmt: skip


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("msg.flag != 0", "compares msg.flag, which is true or false, with a number: never equal"),
        ("msg.size > 2 && msg.inner.flag == 1.0", "compares msg.inner.flag, which is true or"),
        ("1 == msg.flag", "compares msg.flag, which is true or false, with a number"),
        ("msg.text != -5", "compares msg.text, which is a text, with a number"),
        ("msg.text == .5", "compares msg.text, which is a text, with a number"),
        ("'3' != msg.size", "compares msg.size, which is a number, with a text"),
        ("msg.ratio != false", "compares msg.ratio, which is a number, with true or false"),
        ("msg.list[0] == '1'", "compares msg.list[0], which is a number, with a text"),
        ("msg.flag == true && msg.text == '5' && msg.size == 3.0 && msg.ratio != 1", ""),
        ("msg.size == 3u && 0x3 == msg.size && msg.ratio == 5e-1", ""),
        ("3 == msg.text.size() && msg.text.size() != 3 && size(msg.text) == 3", ""),
        ("int(msg.text) == 5 && 5 == int(msg.text)", ""),
        ("msg.flag == (1 < 2) && msg.flag != msg.inner.flag && msg.size == case.n", ""),
        ("msg.flag == 'abc'.startsWith('a') && 'abc'.contains('b') == msg.flag", ""),
        ("msg.raw == b'ab' && msg.none == 1 && msg.list == [1]", ""),
        ("msg.text != 'msg.flag != 0' // msg.flag != 0", ""),
        ("msg.list[0] == 1 && msg.list[9] == '1'", ""),
        # A relation is taken with what is on its left: (msg.size > 2) == msg.flag.
        ("msg.size > 2 == msg.flag", ""),
        ("msg.size >= -2 == msg.flag && msg.size < size(msg.list) + 2 != msg.flag", ""),
        ("msg.ratio < msg.size == true && 1 in msg.list == msg.flag", ""),
        ("msg.size in [2, 3] == msg.flag && msg.size in msg.list == true", ""),
        ("msg.flag == msg.size == msg.flag == true", ""),
        ("msg.size > 2 && 2 == msg.flag", "compares msg.flag, which is true or false, with a num"),
        ("[msg.size > 2, 2 == msg.flag][0]", "compares msg.flag, which is true or false, with a"),
        ("msg.size > 2 ? 2 == msg.flag : msg.flag == 3", "compares msg.flag, which is true or fal"),
        ("(msg.size > 2) != (2 == msg.flag)", "compares msg.flag, which is true or false, with a"),
        ("msg.list[0 < 1 ? 0 : 1] + 2.0 == msg.flag", "compares msg.flag, which is true or false"),
        ("!(msg.size > 2) || !msg.flag == 2", "compares msg.flag, which is true or false, with a"),
    ],
)
def test_what_is_never_equal_is_named(text: str, sentence: str) -> None:
    found = never_equal(text, MESSAGE, lambda _: False)
    assert found[: len(sentence) or None] == sentence


def test_a_comparison_that_always_holds_is_no_evidence() -> None:
    flags = [("/flag", at, STORE.types["std_msgs/msg/Bool"](False)) for at in INPUTS]
    for holds, outcome in (("msg.data != 0", "invalid"), ("!msg.data", "passed")):
        finding = found(case(flags), {"expression": {"topic": "/flag", "holds": holds}})
        assert finding.outcome == outcome, finding


@pytest.mark.parametrize(
    ("holds", "outcome"),
    [
        ("msg.data != 0.6", "invalid"),
        ("0.6 == msg.data", "invalid"),
        ("msg.data != 0.5", "passed"),
        ("msg.data != 1", "passed"),
        ("msg.data < 0.7 && msg.data > 0.6", "passed"),
    ],
)
def test_a_number_of_32_bits_never_equals_a_fraction_that_it_does_not_have(
    holds: str, outcome: str
) -> None:
    numbers = [("/number", at, STORE.types["std_msgs/msg/Float32"](0.6)) for at in INPUTS]
    finding = found(case(numbers), {"expression": {"topic": "/number", "holds": holds}})
    assert finding.outcome == outcome, finding
    if outcome == "invalid":
        assert "compares msg.data, which has 32 bits, with 0.6, which these" in finding.message
    numbers = [("/number", at, number(0.7)) for at in INPUTS]
    finding = found(case(numbers), {"expression": {"topic": "/number", "holds": "msg.data != 0.6"}})
    assert finding.outcome == "passed"
