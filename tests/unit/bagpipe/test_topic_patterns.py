"""Patterns of topics: in linear time, and never stricter than the agent's."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bagpipe.topic_patterns import records

PARTS = st.sampled_from(
    ["/a", "/b", "/ab", "/.*", "/a+", "/(a|b)", "/[ab]?", "a?", "(/b)*", "b{1,2}"]
)
PLAIN = st.lists(PARTS, min_size=1, max_size=4).map("".join)


@given(PLAIN, st.from_regex(r"(/[ab]{1,4}){1,3}", fullmatch=True))
def test_what_both_know_means_the_same_as_in_python(pattern: str, topic: str) -> None:
    assert records(pattern, topic) == (re.fullmatch(pattern, topic) is not None)


@pytest.mark.timeout(20)
def test_what_backtracks_for_ever_elsewhere_takes_no_time() -> None:
    assert not records("/(a+)+b", "/" + "a" * 250)
    assert not records("/(a|aa)+$b", "/" + "a" * 250)


@pytest.mark.parametrize(
    "pattern", ["/a[a-z&&[^b]]", r"/\b{start}a", "/(?=a)a", "/(a", "(a{1000}){1000}"]
)
def test_what_re2_can_t_read_is_left_to_the_agent(pattern: str) -> None:
    assert records(pattern, "/whatever")
