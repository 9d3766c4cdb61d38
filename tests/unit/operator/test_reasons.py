"""Every reason that the operator can give is explained to users."""

from pathlib import Path

from bagpipe_operator.api import reasons

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "conditions.md"


def all_reasons() -> set[str]:
    return {
        value
        for value in vars(reasons).values()
        if isinstance(value, str) and "." not in value and value.isalnum() and value[0].isupper()
    }


def test_the_page_explains_every_reason() -> None:
    text = PAGE.read_text()
    assert sorted(reason for reason in all_reasons() if reason not in text) == []


def test_troubles_are_reasons() -> None:
    assert len(reasons.TROUBLES) == 20
    assert all_reasons() > reasons.TROUBLES
