"""The documentation's site in a real browser, from a disk: it renders, finds, and asks nobody."""

import subprocess
import sys
from pathlib import Path

import pytest
from selenium import webdriver
from selenium.common.exceptions import NoSuchElementException, StaleElementReferenceException
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import WebDriverWait

from tests.integration.chromium import logged, requests
from tests.integration.conftest import ROOT

pytestmark = pytest.mark.integration

SECONDS = 90


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("site") / "html"
    command = [sys.executable, "-m", "docs.site.build", str(target)]
    subprocess.run(command, cwd=ROOT, check=True, timeout=300)
    return target


def opened(browser: webdriver.Chrome, page: Path) -> None:
    logged(browser, "performance")
    logged(browser, "browser")
    browser.get(page.as_uri())


def check_quiet(browser: webdriver.Chrome) -> None:
    """Nothing was asked for but files, and nothing went wrong."""
    asked = requests(browser)
    assert asked
    assert [url for url in asked if not url.startswith(("file://", "data:"))] == []
    assert [entry["message"] for entry in logged(browser, "browser")] == []


def test_the_start_page_has_the_navigation_and_leads_on(
    browser: webdriver.Chrome, site: Path
) -> None:
    opened(browser, site / "index.html")
    assert browser.title == "Bagpipe"
    captions = browser.find_elements(By.CSS_SELECTOR, ".sidebar-tree .caption")
    assert [caption.text.title() for caption in captions] == [
        "Start", "Tasks", "Concepts", "Operations", "Reference", "Examples",
    ]  # fmt: skip
    assert all(caption.is_displayed() for caption in captions)
    browser.find_element(By.LINK_TEXT, "Getting started").click()
    WebDriverWait(browser, SECONDS).until(lambda b: b.current_url.endswith("/start.html"))
    assert browser.find_element(By.TAG_NAME, "h1").text.startswith("Getting started")
    check_quiet(browser)


def test_the_search_finds_without_a_network(browser: webdriver.Chrome, site: Path) -> None:
    opened(browser, site / "index.html")
    browser.find_element(By.CSS_SELECTOR, "input[name=q]").send_keys("lockstep", Keys.ENTER)
    wait = WebDriverWait(browser, SECONDS)

    def found(b: webdriver.Chrome) -> dict[str, WebElement]:
        """The results that are there by now: they come one after the other."""
        shown = b.find_elements(By.CSS_SELECTOR, "#search-results li a")
        return {link.text.partition(":")[0]: link for link in shown}

    wait.until(lambda b: {"Playback", "robot_state_publisher", "SimulationJob"} <= set(found(b)))
    # Not by a click, which would go where it was: the page may still grow above it.
    found(browser)["Playback"].send_keys(Keys.ENTER)
    wait.until(lambda b: "/concepts/playback.html" in b.current_url)
    assert "what is guaranteed" in browser.find_element(By.TAG_NAME, "h1").text
    check_quiet(browser)


def test_a_search_without_a_result_is_reported(browser: webdriver.Chrome, site: Path) -> None:
    opened(browser, site / "search.html")
    browser.get((site / "search.html").as_uri() + "?q=xylophone")
    summary = (By.CSS_SELECTOR, "#search-results .search-summary")
    redrawn = [StaleElementReferenceException, NoSuchElementException]
    wait = WebDriverWait(browser, SECONDS, ignored_exceptions=redrawn)
    wait.until(lambda b: "did not match any documents" in b.find_element(*summary).text)
    check_quiet(browser)


def test_a_manifest_is_shown_and_to_be_had(browser: webdriver.Chrome, site: Path) -> None:
    opened(browser, site / "examples/barrier-car/README.html")
    blocks = [each.text for each in browser.find_elements(By.CSS_SELECTOR, ".highlight-yaml")]
    (shown,) = [block for block in blocks if block.startswith("# The barrier car")]
    assert "uri: pvc://results/barrier-car" in shown
    check_quiet(browser)
