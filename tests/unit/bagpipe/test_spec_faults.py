"""What is wrong with a spec, in one line that can be read, whatever a manifest has in it."""

import pytest

from bagpipe.spec_faults import sentence


@pytest.mark.parametrize(
    ("place", "fault", "described"),
    [
        (("stack", "image"), "Value error, name one", "spec.stack.image: name one"),
        (("matrix", 3), "Field required", "spec.matrix.3: Field required"),
        ((), "not a mapping", "spec: not a mapping"),
        # A line of a log, or of `kubectl describe`, is not another one's.
        (("a\nOK", "b"), "not\r\n  this\tone", "spec.a OK.b: not this one"),
        (("k" * 251,), "f" * 1024, f"spec.{'k' * 251}: {'f' * 1024}"),
        (("k" * 252,), "f" * 1025, f"spec.{'k' * 249} …: {'f' * 1022} …"),
        ((), "f" * 1021 + " fff", f"spec: {'f' * 1021} …"),
    ],
)
def test_it_is_one_line_of_a_bounded_length(
    place: tuple[str | int, ...], fault: str, described: str
) -> None:
    assert sentence(place, fault) == described
