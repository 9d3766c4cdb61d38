"""Images of the failing moment in the page: checked once more, and within bounds of their own."""

import base64
from typing import Any

import pytest

from bagpipe.pictures import MOST_BYTES, MOST_OF_A_PAGE
from bagpipe.report.details import Details
from bagpipe.report.images import images_of
from bagpipe.report.spool import Spool
from tests.unit.bagpipe.jobs import make_row
from tests.unit.evaluate.test_cameras import JPEG, PNG

SVG = b"<svg xmlns='http://www.w3.org/2000/svg'/>"


def image(file: bytes = PNG, **changed: Any) -> dict[str, Any]:
    text = base64.b64encode(file).decode()
    made = {"topic": "/cam", "of": "input", "at": 2.0, "width": 640, "height": 480}
    return made | {"type": "image/png", "data": text} | changed


def only(given: Any) -> dict[str, Any]:
    (found,) = images_of({"images": [given]})
    return found


def test_an_image_is_what_its_bytes_are_whatever_its_row_says() -> None:
    assert only(image()) == image()
    assert only(image(JPEG, type="text/html"))["type"] == "image/jpeg"


@pytest.mark.parametrize(
    "given",
    [
        image(SVG, type="image/svg+xml"), image(SVG), image(data="PHN2Zz4="),
        image(data=f'x"onerror="alert(1){image()["data"]}'), image(data=7), image(at="now"),
        image(at=float("nan")), image(PNG + bytes(MOST_BYTES)), {},
    ],
)  # fmt: skip
def test_what_is_no_picture_is_a_sentence(given: Any) -> None:
    found = only(given)
    assert "data" not in found
    assert found["fault"] == "the line of results.jsonl has no picture that can be shown"


def test_numbers_and_texts_of_others_are_bounded() -> None:
    found = only(image(topic="/" * 9000, of="<b>", width="wide", height=1 << 40))
    assert (len(found["topic"]), found["of"], found["width"], found["height"]) == (
        200, "output", None, None,
    )  # fmt: skip
    assert only({"fault": "x" * 9000})["fault"] == "x" * 200
    assert len(images_of({"images": [image()] * 90})) == 2
    for none in (None, "x", {"a": 1}, [3, None]):
        assert images_of({"images": none}) == []


def test_a_page_has_so_many_pictures_and_says_how_many_it_leaves_out() -> None:
    details = Details(Spool())
    names = [f"a-{n:03d}" for n in range(200)]
    for name in names:
        details.add(make_row(name, "failed", "CriterionFailed", images=[image(), image()]))
    shown = details.in_full(names)
    assert len(shown) == 200
    assert sum(len(each["images"]) for each in shown.values()) == MOST_OF_A_PAGE == 60
    assert sum(each["unseen"] for each in shown.values()) == 400 - MOST_OF_A_PAGE
    # Those that the page lists have theirs first.
    listed = details.listed()
    assert all(len(shown[name]["images"]) == 2 for name in listed[:30])
    assert all(not shown[name]["images"] for name in listed[30:])
