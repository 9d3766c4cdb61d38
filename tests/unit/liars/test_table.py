"""The table of liars: large enough, of every class, and what the documentation shows of it."""

from tests.liars import page
from tests.liars.row import STACKS
from tests.liars.table import CLASSES, FIRST_SIX, HONEST, LIARS, ROWS


def test_the_table_has_every_class_and_enough_of_both() -> None:
    assert len(LIARS) >= 50
    assert len(HONEST) >= 20
    assert set(FIRST_SIX) <= {row.name for row in LIARS}
    for part in CLASSES:
        assert part.LIARS, part.__name__
        assert part.HONEST, part.__name__


def test_every_row_has_a_name_and_a_deed_of_its_own() -> None:
    assert len({row.name for row in ROWS}) == len(ROWS)
    keys = [
        (row.of, row.does, row.asked.job.name, row.asked.criterion)
        for row in ROWS
        if row.does != "the same, with roscpp"
    ]
    assert len(set(keys)) == len(keys)


def test_a_liar_is_never_expected_to_pass() -> None:
    for row in LIARS:
        assert "passed" not in row.outcome, row.name


def test_every_stack_is_a_script_that_is_there() -> None:
    for row in ROWS:
        for word in row.command:
            if word.startswith(str(STACKS)):
                assert word.removeprefix(str(STACKS) + "/") in {p.name for p in STACKS.iterdir()}


def test_the_page_is_current() -> None:
    assert page.PAGE.read_text() == page.page(), "run python -m tests.liars.page"
