"""Which parts of a message an expression reads."""

import math
from typing import Any

import pytest

from bagpipe.evaluate.reads import Path, paths_of
from tests.unit.evaluate.drives import INPUTS, answer, case, found


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
