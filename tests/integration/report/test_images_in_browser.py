"""Pictures of cameras in report.html, in a real browser."""

import base64
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from selenium import webdriver
from selenium.webdriver.common.by import By

from bagpipe.evaluate.thumbnails import of_image
from tests.integration.chromium import logged, requests, screen
from tests.integration.report.drives import drive_rows, report_of
from tests.integration.report.test_report_in_browser import URI, opened

pytestmark = pytest.mark.integration

PHOTO = of_image(
    SimpleNamespace(
        width=640, height=480, step=1920, encoding="rgb8", is_bigendian=0,
        data=np.tile(np.arange(640 * 3, dtype=np.uint16) // 8 % 256, 480).astype(np.uint8),
    )
)  # fmt: skip


def with_images(rows: list[dict[str, Any]], kind: str = PHOTO.kind) -> list[dict[str, Any]]:
    """The rows, each that failed with a picture of its output, and one of its input that lacks."""
    data = base64.b64encode(PHOTO.data).decode()
    picture = {"topic": "/lane/seen", "of": "output", "at": 10.02, "width": 640, "height": 480}
    lacks = {"topic": "/camera", "of": "input", "fault": "images encoded as 'yuv422' are not shown"}
    images = [picture | {"type": kind, "data": data}, lacks]
    return [row | ({"images": images} if row["outcome"] == "failed" else {}) for row in rows]


def ran(cases: int) -> list[dict[str, Any]]:
    """Rows of cases that passed or failed: of these the first is open."""
    return [row for row in drive_rows(cases) if row["outcome"] != "errored"]


@pytest.mark.parametrize("width", [390, 1280])
def test_the_cameras_picture_of_the_failing_moment_is_drawn(
    browser: webdriver.Chrome, page: Path, width: int
) -> None:
    with screen(browser, width):
        opened(browser, page, with_images(ran(100)))
        first = browser.find_element(By.CSS_SELECTOR, "#failing-cases .case[open] .cameras")
        shown = first.find_element(By.TAG_NAME, "img")
        natural = (
            "return [arguments[0].complete, arguments[0].naturalWidth, arguments[0].naturalHeight]"
        )
        assert browser.execute_script(natural, shown) == [True, 320, 240]
        # As the camera took it, whether its file is shown or a smaller one of its pixels.
        turned = "return getComputedStyle(arguments[0]).imageOrientation"
        assert browser.execute_script(turned, shown) == "none"
        column = first.find_element(By.TAG_NAME, "figure").rect["width"]
        assert shown.rect["width"] == pytest.approx(min(320, column), abs=1)
        assert "/lane/seen of the stack at 10.020 s, 640 × 480" in first.text
        assert "No picture: images encoded as 'yuv422' are not shown." in first.text
        assert browser.execute_script("return document.documentElement.scrollWidth") <= width
        assert logged(browser, "browser") == []
        # DevTools counts what is in the page as a request, which leaves nowhere.
        left = [each for each in requests(browser) if not each.startswith("data:")]
        assert left == [page.as_uri()]


def test_a_picture_of_another_type_is_none(browser: webdriver.Chrome, page: Path) -> None:
    """Whatever a row says of itself, the browser is given the type of the bytes."""
    opened(browser, page, with_images(ran(100), kind="image/svg+xml"))
    first = browser.find_element(By.CSS_SELECTOR, "#failing-cases .case[open] .cameras img")
    assert (first.get_attribute("src") or "").startswith("data:image/png;base64,iVBOR")


def test_thousands_of_failed_cases_with_pictures_stay_one_page() -> None:
    """They add 60 pictures at most, and of the cases in full, some 900, some words each."""
    plain = [row | {"outcome": "failed"} for row in drive_rows(4_000)]
    without, pictured = (report_of(rows, URI) for rows in (plain, with_images(plain)))
    picture = base64.b64encode(PHOTO.data)
    assert pictured.count(picture) == 30
    assert len(pictured) - len(without) < 30 * len(picture) + 200_000
