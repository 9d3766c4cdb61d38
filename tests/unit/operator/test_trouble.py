"""What keeps a job from its work: which trouble is the same, and how others' messages are cited."""

import pytest

from bagpipe_operator.jobs.troubles.trouble import Trouble, sentence


def test_a_trouble_is_the_same_while_its_words_change() -> None:
    first = Trouble("StackImageUnavailable", "x-1-exec-1", "not found", "stack")
    assert first.key == Trouble("StackImageUnavailable", "x-1-exec-1", "back-off", "stack").key
    assert first.key != Trouble("StackImageUnavailable", "x-1-exec-2", "not found", "stack").key


def test_a_trouble_lasts_unless_it_is_marked_as_passing() -> None:
    lasting = Trouble("StackImageUnavailable", "x-1-exec-1", "not found", "stack")
    passing = lasting.passing()
    assert (lasting.lasting, passing.lasting) == (True, False)
    assert (passing.key, passing.message) == (lasting.key, lasting.message)


@pytest.mark.parametrize(
    ("words", "reported"),
    [
        ("no space left", "no space left."),
        ("no\n  space\tleft ", "no space left."),
        ("Done.", "Done."),
        ("Why?", "Why?"),
        ("No!", "No!"),
        ("", ""),
        (" \n ", ""),
        ("x" * 500, "x" * 500 + "."),
        ("x" * 501, "x" * 498 + " …"),
        ("x" * 497 + " yyy", "x" * 497 + " …"),
    ],
)
def test_somebody_s_words_become_one_sentence_of_bounded_length(words: str, reported: str) -> None:
    assert sentence(words) == reported
