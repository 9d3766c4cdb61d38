"""Durations of a spec are whole nanoseconds, to the last one."""

from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from bagpipe.plan.conditions import Conditions, Crossing
from bagpipe.source.bags.planning import fragments
from bagpipe.storage import Storage
from bagpipe.texts import duration_nanoseconds, duration_seconds
from tests.unit.bagpipe.bags import Recorded, write_bag
from tests.unit.bagpipe.jobs import make_spec

SECOND = 1_000_000_000
UNITS = {"ms": 1_000_000, "s": SECOND, "m": 60 * SECOND, "h": 3600 * SECOND}
DIGITS = st.text("0123456789", min_size=1, max_size=6)
NUMBERS = st.builds("{}.{}".format, DIGITS, DIGITS) | DIGITS
LONGEST = 2**63 - 1


@given(st.lists(st.tuples(NUMBERS, st.sampled_from(sorted(UNITS))), min_size=1, max_size=4))
@example([("1.001", "s")])
@example([("0.000001", "ms")])
@example([("0.1", "s"), ("0.2", "s")])
def test_no_duration_is_rounded(parts: list[tuple[str, str]]) -> None:
    text = "".join(number + unit for number, unit in parts)
    exact = sum(Fraction(number) * UNITS[unit] for number, unit in parts)
    if exact > LONGEST:
        with pytest.raises(ValueError, match="is longer than 292 years"):
            duration_nanoseconds(text)
        return
    assert duration_nanoseconds(text) == exact
    assert duration_seconds(text) == float(Fraction(exact, SECOND))


def test_the_longest_is_the_api_server_s() -> None:
    most = "999999h999999h562049h46m"  # 2,562,047 hours and 47 minutes, less 43.1 s, are 292 years
    assert duration_nanoseconds("854015h854016h854016h47m") == LONGEST - LONGEST % (60 * SECOND)
    assert duration_nanoseconds(most) < LONGEST
    with pytest.raises(ValueError, match="is longer than 292 years"):
        duration_nanoseconds("854015h854016h854016h48m")


def test_fragments_and_warm_up_last_as_long_as_the_spec_says(tmp_path: Path) -> None:
    recorded = [Recorded("/scan", SECOND + at * 100_000_000, "x" * 50) for at in range(50)]
    bag = write_bag(tmp_path / "a.bag", recorded, 10_000_000)
    fragment = {"length": "1.001s", "warmUp": "1.001s"}
    spec = make_spec(source={"bags": ["pvc://none/a.bag"], "fragment": fragment}).source
    made = fragments([bag.as_uri()], spec, "ros1", Crossing([("", Conditions())]), Storage({}), {})
    starts = [case.window.start for case in made.cases]
    assert starts == [SECOND + number * 1_001_000_000 for number in range(len(starts))]
    assert len(starts) == 5
    assert [case.window.start - case.window.lead_in_start for case in made.cases] == [
        0, *[1_001_000_000] * 4
    ]  # fmt: skip
