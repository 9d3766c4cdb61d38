"""A quarantine that the API server refuses, and one that the models refuse, are the same ones."""

from datetime import date, timedelta
from typing import Any

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st
from pydantic import ValidationError

from bagpipe.quarantine import QuarantineRule
from tests.unit.crds.offline import refusals
from tests.unit.crds.test_crd import CRD, schema_of

_SPEC = schema_of(yaml.load(CRD.read_text(), Loader=yaml.CSafeLoader))["properties"]["spec"]
SCHEMA = _SPEC["properties"]["quarantine"]["items"]
GOOD = {"cases": "night-*", "reason": "issue 17", "until": "2026-12-31"}

digits = st.integers(0, 99).map("{:02d}".format)
days = st.one_of(
    st.tuples(st.sampled_from(["2024", "2026", "2000", "2100", "1999"]), digits, digits).map(
        "-".join
    ),
    st.text(max_size=12),
    st.sampled_from(["2026-12-31T00:00:00Z", "1798675200", "2026-1-1", "２026-01-01"]),
)
texts = st.one_of(
    st.text(max_size=6),
    st.sampled_from([" ", "\t\n", "\u00a0", "\v", *("a" * n for n in (253, 254, 500, 501))]),
)


def refusal_of_the_model(value: dict[str, Any]) -> str:
    try:
        QuarantineRule.model_validate(value)
    except ValidationError as error:
        return error.errors()[0]["msg"].removeprefix("Value error, ")
    return ""


@given(days)
@example("2026-02-28")
@example("2026-02-29")
@example("2028-02-29")
@example("2026-04-31")
@example("2026-12-31\n")
def test_the_same_days(day: str) -> None:
    value = GOOD | {"until": day}
    assert bool(refusals(SCHEMA, value)) == bool(refusal_of_the_model(value))


@given(texts, texts)
def test_the_same_texts(cases: str, reason: str) -> None:
    value = GOOD | {"cases": cases, "reason": reason}
    assert bool(refusals(SCHEMA, value)) == bool(refusal_of_the_model(value))


def test_every_day_of_four_years_is_taken() -> None:
    days = [date(2024, 1, 1) + timedelta(days=n) for n in range(4 * 366)]
    refused = [day for day in days if refusals(SCHEMA, GOOD | {"until": day.isoformat()})]
    assert refused == []


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"until": "soon"}, "quarantine.until is no day: write the last one on which it holds"),
        ({"until": 1798675200}, "quarantine.until is no day: write the last one on which it holds"),
        ({"reason": " "}, "quarantine.reason is empty: write why the case flakes"),
    ],
)
def test_the_sentences_say_what_to_write(changed: dict[str, Any], words: str) -> None:
    assert refusal_of_the_model(GOOD | changed).startswith(words)
