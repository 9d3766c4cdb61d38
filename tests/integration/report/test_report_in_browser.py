"""report.html in a real browser: verdict first, filters, many cases, hostile words, no request."""

import json
import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from selenium import webdriver
from selenium.common.exceptions import NoSuchElementException, StaleElementReferenceException
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import Select, WebDriverWait

from tests.integration.chromium import logged, requests, screen
from tests.integration.report import drives
from tests.integration.report.drives import drive_rows, report_of
from tests.integration.report.keystrokes import typed
from tests.waiting import PATIENCE, wait_until

pytestmark = pytest.mark.integration

URI = "pvc://results/out/lane-nightly/u"
# Some 1,200 are there, of 1,000 cases as of 10,000.
MOST_ELEMENTS = 1_500


def opened(
    browser: webdriver.Chrome, page: Path, rows: list[dict[str, Any]], **options: Any
) -> bytes:
    made = report_of(rows, URI, **options)
    page.write_bytes(made)
    logged(browser, "performance")
    logged(browser, "browser")
    browser.get(page.as_uri())
    return made


def text_of(browser: webdriver.Chrome, css: str) -> str:
    return browser.find_element(By.CSS_SELECTOR, css).text


def awaited(browser: webdriver.Chrome, css: str, right: Callable[[WebElement], bool]) -> WebElement:
    """The first such element once it is right: rows are redrawn after they were scrolled."""
    redrawn = [StaleElementReferenceException, NoSuchElementException]
    wait = WebDriverWait(browser, PATIENCE, ignored_exceptions=redrawn)

    def look(_: webdriver.Chrome) -> WebElement | None:
        element = browser.find_element(By.CSS_SELECTOR, css)
        return element if right(element) else None

    found_right = wait.until(look)
    assert found_right is not None
    return found_right


def found(browser: webdriver.Chrome) -> str:
    return text_of(browser, "#found")


def test_the_verdict_is_the_first_thing_to_be_seen(browser: webdriver.Chrome, page: Path) -> None:
    rows = [row for row in drive_rows(288) if row["outcome"] != "errored"]
    opened(browser, page, rows)
    assert browser.title == "Failed: lane-nightly"
    heading = browser.find_element(By.TAG_NAME, "h1")
    failed = sum(row["outcome"] == "failed" for row in rows)
    (regressed,) = re.findall(r"(\d+) regressed", text_of(browser, ".compared"))
    assert heading.text == f"Failed: {failed} failed, {regressed} regressed"
    assert heading.rect["y"] + heading.rect["height"] < 140
    assert text_of(browser, ".sentence").startswith(f"Of {len(rows)} cases {failed} failed. Most")
    assert text_of(browser, ".counts .failed") == f"{failed} failed"
    assert "worse\npr-812 against released" in text_of(browser, ".compared").replace(" pr", "\npr")
    assert logged(browser, "browser") == []


def test_of_a_regression_that_ran_the_machine_is_shown(
    browser: webdriver.Chrome, page: Path
) -> None:
    opened(browser, page, [row for row in drive_rows(288) if row["outcome"] != "errored"])
    first = browser.find_element(By.CSS_SELECTOR, "#first-case details.case")
    assert first.get_attribute("open") is not None
    assert "CriterionFailed" in first.text
    assert "The machine meanwhile" in first.text
    heads = [head.text for head in first.find_elements(By.CSS_SELECTOR, "table.plain th")]
    assert heads[:5] == ["Criterion", "Outcome", "May be", "What was found", "Judged on"]
    assert "without a longer silence in 98% of the window" in first.text


def test_the_first_regression_is_open_and_causes_stand_together(
    browser: webdriver.Chrome, page: Path
) -> None:
    rows = drive_rows(288)
    opened(browser, page, rows)
    crashes = [row["case"] for row in rows if row["reason"] == "StackExited"]
    lines = browser.find_elements(By.CSS_SELECTOR, "#causes-table tbody tr")
    # Each crash has another second in its message, and they are one cause.
    [crash] = [line for line in lines if "StackExited" in line.text]
    assert crash.text.startswith(f"{len(crashes)} errored\nStackExited")
    assert min(crashes) in crash.text
    named = browser.find_elements(By.CSS_SELECTOR, "#comparison a[data-case]")
    assert text_of(browser, "#first-name") == "The first case that regressed"
    first = browser.find_element(By.CSS_SELECTOR, "#first-case details.case")
    assert first.get_attribute("open") is not None
    assert first.get_attribute("data-case") in [link.text for link in named]
    # A crash of what passed has regressed, as a criterion that fails; it has no figures to show.
    assert "segmentation fault" in first.text
    crash.find_element(By.CSS_SELECTOR, "button.chip").click()
    assert found(browser) == f"{len(crashes)} of {len(rows)} cases"
    browser.find_element(By.ID, "clear").click()
    assert found(browser) == f"{len(rows)} of {len(rows)} cases"
    assert logged(browser, "browser") == []


def test_discarded_runs_and_the_origin_are_shown(browser: webdriver.Chrome, page: Path) -> None:
    rows = drive_rows(288)
    opened(browser, page, rows)
    tried = [row["case"] for row in rows if row.get("discarded") and row["outcome"] == "passed"]
    assert text_of(browser, ".counts .discarded") == f"{2 * 4} runs discarded"
    browser.find_element(By.ID, "search").send_keys(tried[0])
    body = browser.find_element(By.CSS_SELECTOR, ".grid .body")
    body.send_keys(Keys.HOME, Keys.ENTER)
    chosen = awaited(browser, "#chosen .case", lambda case: tried[0] in case.text)
    assert chosen.text.count("MachineBusy after 20.4 s: /lane_node lost 3 of 498") == 2
    shown = text_of(browser, "#provenance")
    for word in ("label branch pr-812", "lane@sha256:abab", "AMD EPYC 7R13", "bagpipe-agent 0.1.0"):
        assert word in shown


def test_a_case_in_quarantine_says_so_and_is_found_by_it(
    browser: webdriver.Chrome, page: Path
) -> None:
    mark = {"cases": "*", "reason": "issue <b>17</b>", "until": "2026-12-31"}
    rows = drive_rows(288)
    failed = [row["case"] for row in rows if row["outcome"] == "failed"]
    rows = [row | {"quarantine": mark} if row["case"] == failed[-1] else row for row in rows]
    opened(browser, page, rows)
    assert text_of(browser, ".counts .quarantined") == "1 of these in quarantine"
    browser.find_element(By.ID, "search").send_keys("issue <b>17")
    assert found(browser) == f"1 of {len(rows)} cases"
    body = browser.find_element(By.CSS_SELECTOR, ".grid .body")
    assert "in quarantine until 2026-12-31: issue <b>17</b>; " in body.text
    body.send_keys(Keys.HOME, Keys.ENTER)
    chosen = awaited(browser, "#chosen .case", lambda case: failed[-1] in case.text)
    assert "This case is in quarantine until 2026-12-31: issue <b>17</b>." in chosen.text
    assert logged(browser, "browser") == []


def test_a_field_of_the_matrix_filters_the_cases(browser: webdriver.Chrome, page: Path) -> None:
    rows = [row for row in drive_rows(288) if row["outcome"] != "errored"]
    opened(browser, page, rows)
    heads = browser.find_elements(By.CSS_SELECTOR, ".heat tbody th")
    assert [head.text for head in heads] == drives.RAIN
    wanted = [r for r in rows if r["values"] == {"rain": "heavy", "speed": 25}]
    [field] = browser.find_elements(By.CSS_SELECTOR, "button[aria-label^='rain heavy, speed 25:']")
    failed = sum(row["outcome"] == "failed" for row in wanted)
    assert field.text == f"✕ {failed}/{len(wanted)}"
    field.click()
    assert found(browser) == f"{len(wanted)} of {len(rows)} cases"
    assert field.get_attribute("aria-pressed") == "true"
    Select(browser.find_element(By.ID, "outcome")).select_by_visible_text("failed")
    assert found(browser) == f"{failed} of {len(rows)} cases"
    browser.find_element(By.ID, "clear").click()
    assert found(browser) == f"{len(rows)} of {len(rows)} cases"
    assert field.get_attribute("aria-pressed") == "false"
    Select(browser.find_element(By.ID, "rows")).select_by_visible_text("variant")
    heads = browser.find_elements(By.CSS_SELECTOR, ".heat tbody th")
    assert [head.text for head in heads] == ["released", "pr-812"]


def test_variants_criteria_and_reasons_select_cases(browser: webdriver.Chrome, page: Path) -> None:
    rows = drive_rows(288)
    opened(browser, page, rows)
    Select(browser.find_element(By.ID, "variant")).select_by_visible_text("released")
    assert found(browser) == f"144 of {len(rows)} cases"
    Select(browser.find_element(By.ID, "criterion")).select_by_visible_text("lane rate failed")
    slow = sum(
        finding["name"] == "lane rate" and finding["outcome"] == "failed"
        for row in rows
        if row["variant"] == "released"
        for finding in row["criteria"]
    )
    assert found(browser) == f"{slow} of {len(rows)} cases"
    browser.find_element(By.ID, "clear").click()
    browser.find_element(By.ID, "search").send_keys("segmentation StackExited")
    assert found(browser) == f"0 of {len(rows)} cases"  # stderr is shown, and not searched
    browser.find_element(By.ID, "search").clear()
    browser.find_element(By.ID, "search").send_keys("status 139 speed=10")
    errored = [r for r in rows if r["outcome"] == "errored" and r["values"]["speed"] == 10]
    assert found(browser) == f"{len(errored)} of {len(rows)} cases"


def test_the_table_is_used_with_keys(browser: webdriver.Chrome, page: Path) -> None:
    rows = drive_rows(2000)
    opened(browser, page, rows)
    body = browser.find_element(By.CSS_SELECTOR, ".grid .body")
    body.send_keys(Keys.END)
    last = max(r["case"] for r in rows if r["outcome"] == "passed")
    awaited(browser, ".grid .row.active", lambda row: row.text.startswith(last))
    body.send_keys(Keys.HOME, Keys.ARROW_DOWN, Keys.ENTER)
    second = sorted(r["case"] for r in rows if r["outcome"] == "failed")[1]
    chosen = awaited(
        browser, "#chosen .case", lambda case: case.get_attribute("data-case") == second
    )
    assert f"bagpipe replay {second} --results {URI}" in chosen.text
    assert "--volume results=FOLDER --volume recordings=FOLDER" in chosen.text
    assert len(browser.find_elements(By.CSS_SELECTOR, ".grid .space .row")) < 60


def test_of_ten_thousand_cases_the_browser_holds_what_is_seen(
    browser: webdriver.Chrome, page: Path
) -> None:
    made = opened(browser, page, drive_rows(10_000))
    assert len(made) < 10_000_000
    typed(browser, "0123-heavy-35-pr-812")
    assert found(browser) == "1 of 10,000 cases"
    browser.find_element(By.ID, "clear").click()
    assert found(browser) == "10,000 of 10,000 cases"
    typed(browser, "lane rate 7.")
    assert 100 < int(found(browser).split(" of ")[0].replace(",", "")) < 9_900
    # A keystroke's time grows with these; in seconds it is a bench's (BENCH=report).
    assert len(browser.find_elements(By.CSS_SELECTOR, ".grid .space .row")) < 60
    elements = browser.execute_script("return document.querySelectorAll('*').length")
    assert elements < MOST_ELEMENTS
    assert logged(browser, "browser") == []


def test_hostile_words_stay_words(browser: webdriver.Chrome, page: Path) -> None:
    rows = drive_rows(200, hostile=True)
    opened(browser, page, rows, name=drives.HOSTILE[1])
    for summary in browser.find_elements(By.CSS_SELECTOR, "#failing-cases summary"):
        browser.execute_script("arguments[0].click()", summary)
    body = browser.find_element(By.CSS_SELECTOR, ".grid .body")
    for _ in range(12):
        body.send_keys(Keys.PAGE_DOWN, Keys.ENTER)
    assert browser.execute_script("return window.hacked") is None
    assert browser.execute_script("return document.scripts.length") == 2
    assert (
        browser.execute_script("return document.querySelectorAll('img,iframe,object').length") == 0
    )
    everything = browser.find_element(By.TAG_NAME, "body").text
    for evil in ("<script>window.hacked = 1</script>", "<img src=x onerror=", "{{ 7 * 7 }}"):
        assert evil in everything
    assert browser.title == f"No verdict: {drives.HOSTILE[1]}"
    assert logged(browser, "browser") == []
    assert requests(browser) == [page.as_uri()]


def test_the_page_s_own_policy_stops_what_would_leave(
    browser: webdriver.Chrome, page: Path, listener: tuple[str, list[str]]
) -> None:
    """Even a script that did get in could reach nobody: each way out is tried by hand."""
    address, asked = listener
    opened(browser, page, drive_rows(20))
    outcomes = browser.execute_async_script(
        """
        const [address, done] = arguments, outcomes = [];
        const image = new Image();
        image.src = address + '/image';
        document.body.append(image);
        const inline = document.createElement('script');
        inline.textContent = 'window.hacked = 1';
        document.body.append(inline);
        const link = document.createElement('link');
        link.rel = 'stylesheet'; link.href = address + '/style';
        document.head.append(link);
        navigator.sendBeacon(address + '/beacon', 'x');
        fetch(address + '/fetch')
          .then(() => outcomes.push('fetched'), () => outcomes.push('refused'))
          .then(() => setTimeout(() => done(outcomes.concat([String(window.hacked)])), 300));
        """,
        address,
    )
    assert outcomes == ["refused", "undefined"]
    assert asked == []
    stopped: list[str] = []

    def all_are_logged() -> bool:
        found = (entry["message"] for entry in logged(browser, "browser"))
        stopped.extend(message for message in found if "Content Security" in message)
        return len(stopped) >= 4

    wait_until(all_are_logged, PATIENCE, f"not each way out is logged: {stopped}")


def case_of(browser: webdriver.Chrome, name: str) -> WebElement:
    """A case, opened from the table."""
    search = browser.find_element(By.ID, "search")
    search.clear()
    search.send_keys(name)
    body = browser.find_element(By.CSS_SELECTOR, ".grid .body")
    body.send_keys(Keys.HOME, Keys.ENTER)
    return awaited(browser, "#chosen .case", lambda case: case.get_attribute("data-case") == name)


def read_at(browser: webdriver.Chrome, case: WebElement, share: float) -> list[str]:
    """What is read where the pointer is: the time, then each criterion's values."""
    plot = case.find_element(By.CSS_SELECTOR, ".plot")
    browser.execute_script(
        "const [plot, share] = arguments, place = plot.getBoundingClientRect();"
        "plot.dispatchEvent(new PointerEvent('pointermove', {bubbles: true,"
        " clientX: place.left + share * place.width, clientY: place.top + 5}));",
        plot, share,
    )  # fmt: skip
    return [each.text for each in case.find_elements(By.CSS_SELECTOR, ".legend .time, .value")]


def test_the_failing_moment_is_shown_with_the_baseline_s_course(
    browser: webdriver.Chrome, page: Path
) -> None:
    rows = drive_rows(288)
    opened(browser, page, rows)
    named = {row["case"]: row for row in rows}
    failed = next(
        row for row in rows
        if row["variant"] == "pr-812" and row["criteria"]
        and row["criteria"][0]["outcome"] == "failed" and row["values"]["speed"] == 25
    )  # fmt: skip
    other = named[failed["case"].removesuffix("pr-812") + "released"]
    case = case_of(browser, failed["case"])
    points = failed["criteria"][0]["course"]["points"]
    moment = next(at for at, value in points if value < 9)
    first = case.find_element(By.CSS_SELECTOR, ".legend .first").text
    assert first == f"Out of its bounds first at {moment:.4g} s: lane rate"
    assert f"released: {other['case']}" in case.find_element(By.CSS_SELECTOR, ".legend").text
    words = [each.text for each in case.find_elements(By.CSS_SELECTOR, ".chart .word")]
    assert words == ["lane rate", "offset", "end pose"]
    for css, count in ((".own", 3), (".other", 3), (".moment", 1), (".limit", 3)):
        assert len(case.find_elements(By.CSS_SELECTOR, f".plot {css}")) == count, css
    drawn = case.find_element(By.CSS_SELECTOR, ".plot .own").get_attribute("d") or ""
    assert drawn.count("L") == len(points) - 1 == 399
    # The time is the pointer's; values are those of the nearest points of both.
    time, lane, *_ = read_at(browser, case, 0.75)
    theirs = other["criteria"][0]["course"]["points"][75][1]
    assert time == "at 15.000 s"
    assert lane == f"{points[300][1]:.4g} Hz · baseline {theirs:.4g} Hz"
    # What was written stands below the same axis, and is read where the pointer is near it.
    [tick] = case.find_elements(By.CSS_SELECTOR, ".plot .tick.warn")
    assert float(tick.get_attribute("x1") or 0) == pytest.approx(501)
    assert case.find_element(By.CSS_SELECTOR, ".lines").text == (
        "0.040 s info/lane_node: map is loaded\n10.020 s warn/lane_node: no marking for 0.2 s"
    )
    assert read_at(browser, case, 0.75)[-1] == ""
    assert read_at(browser, case, 0.5)[-1] == "/lane_node: no marking for 0.2 s"
    read_at(browser, case, 0.75)
    [plane] = case.find_elements(By.CSS_SELECTOR, ".plane")
    for css, count in ((".own", 1), (".other", 1), (".goal", 1), (".end", 1)):
        assert len(plane.find_elements(By.CSS_SELECTOR, css)) == count, css
    # Where it was at the time that is read: x goes from -49 to 1, over 900 and its goal's radius.
    here = plane.find_element(By.CSS_SELECTOR, ".here").get_attribute("d") or ""
    at, middle, scale = 37.5 - 49, (-49 + 1.5) / 2, 900 / 50.5
    assert float(here[1:].split(" ")[0]) == pytest.approx(500 + (at - middle) * scale, abs=12)
    charts = case.find_element(By.CSS_SELECTOR, ".charts")
    charts.send_keys(Keys.ARROW_RIGHT)
    assert case.find_element(By.CSS_SELECTOR, ".legend .time").text == "at 15.200 s"
    assert logged(browser, "browser") == []


def test_figures_far_from_zero_and_times_without_a_value_stand_where_they_are(
    browser: webdriver.Chrome, page: Path
) -> None:
    rows = drive_rows(20)
    row = next(each for each in rows if each["outcome"] == "failed" and each["criteria"])
    row["window"] = None
    finding = row["criteria"][0] | {"outcome": "failed", "kind": "bounds"}
    limits = {"label": "/pose x", "unit": "m", "low": None}
    points = [[0.0, 5400120.25], [1000.0, 5400120.25], [1234.56, 5400121.75], [2000.0, 5400120.25]]
    row["criteria"] = [
        finding | {"name": "x", "course": limits | {"high": 5400121.5, "points": points}},
        finding | {"name": "y", "course": limits | {"high": None, "points": [], "odd": [2500.0]}},
    ]
    opened(browser, page, rows)
    case = case_of(browser, row["case"])
    assert case.find_element(By.CSS_SELECTOR, ".legend .first").text == (
        "Out of its bounds first at 1234.56 s: x"
    )
    assert "at most 5400121.5 m" in case.find_element(By.CSS_SELECTOR, ".chart figcaption").text
    assert read_at(browser, case, 0.5)[:2] == ["at 1250.000 s", "5400121.75 m"]
    [odd] = case.find_elements(By.CSS_SELECTOR, ".plot .odd")
    assert float(odd.get_attribute("x1") or 0) == 1000


def test_where_it_comes_from_is_on_top_and_recordings_are_links(
    browser: webdriver.Chrome, page: Path
) -> None:
    rows = drive_rows(40)
    rows[0] |= {"outcome": "failed", "recorded": "javascript:window.hacked=1"}
    rows[1] |= {
        "recorded": ["cases/../../etc/passwd", "s3://r/x.bag", "cases/a b.bag", "cases/..x"]
    }
    rows[2] |= {"recorded": "cases/plain-1.0f.bag"}
    opened(browser, page, rows)
    top = browser.find_element(By.CSS_SELECTOR, "header .origin")
    for word in ("branch pr-812", "sim.bagpipe.io/commit 0c1f6d2", "lane@sha256:abab", "0.1.0"):
        assert word in top.text
    assert top.rect["y"] + top.rect["height"] < 260
    links = {}
    for row in rows[:3]:
        case = case_of(browser, row["case"])
        assert f"bagpipe open {row['case']} --results {URI}" in case.text
        assert (
            row["recorded"] if isinstance(row["recorded"], str) else "s3://r/x.bag"
        ) in case.text
        found = case.find_elements(By.CSS_SELECTOR, ".recorded a")
        links[row["case"]] = [link.get_attribute("href") for link in found]
    assert list(links.values()) == [[], [], [(page.parent / "cases/plain-1.0f.bag").as_uri()]]


def test_a_case_that_passed_has_its_courses_delivery_and_timings(
    browser: webdriver.Chrome, page: Path
) -> None:
    rows = drive_rows(288)
    passed = next(row for row in rows if row["outcome"] == "passed")
    passed["result"]["playback"] = {"warnings": ["<b>two</b> ask"], "pace": "/slow set the pace"}
    opened(browser, page, rows)
    case = case_of(browser, passed["case"])
    assert len(case.find_elements(By.CSS_SELECTOR, ".plot .own")) == 3
    assert case.find_elements(By.CSS_SELECTOR, ".plot .moment, .legend .first") == []
    assert "Delivery" in case.text
    notes = [note.text for note in case.find_elements(By.CSS_SELECTOR, "p.note")]
    assert notes[-2:] == ["<b>two</b> ask", "/slow set the pace"]
    assert "Seconds of its parts" in case.text
    assert f"{drives.TIMINGS['master']}" in case.text


def test_of_twenty_thousand_cases_the_page_says_what_it_leaves_out(
    browser: webdriver.Chrome, page: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = drive_rows(20_000)
    made = opened(browser, page, rows)
    loaded = browser.execute_script(
        "const [n] = performance.getEntriesByType('navigation'); return n.loadEventEnd"
    )
    data = json.loads(made.split(b'id="data">', 1)[1].split(b"</script>", 1)[0])
    shown = data["details"]
    kinds = Counter(outcomes_of(rows)[name] for name in shown)
    with capsys.disabled():
        print(f"\nreport of 20,000 cases: {len(made) / 1e6:.2f} MB, drawn after {loaded:.0f} ms;"
              f" in full {dict(kinds)}, baselines {len(data['baselines'])}")  # fmt: skip
    assert len(json.dumps(shown)) < 6_200_000
    assert len(json.dumps(data["baselines"])) < 2_200_000
    assert len(made) < 12_000_000
    assert min(kinds["failed"], kinds["errored"], kinds["passed"]) > 50
    left = next(r["case"] for r in rows if r["outcome"] == "passed" and r["case"] not in shown)
    case = case_of(browser, left)
    assert case.find_elements(By.CSS_SELECTOR, ".plot") == []
    assert f"which has {len(shown):,} of 20,000 cases in full" in case.text
    for word in ("messages sent", "Seconds of its parts", "play", "20"):
        assert word in case.text
    assert typed(browser, "0123-heavy-35-pr-812")
    assert logged(browser, "browser") == []


def outcomes_of(rows: list[dict[str, Any]]) -> dict[str, str]:
    """The outcome of each case by its name."""
    return {row["case"]: row["outcome"] for row in rows}


@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_is_wider_than_the_screen(
    browser: webdriver.Chrome, page: Path, width: int
) -> None:
    with screen(browser, width):
        opened(browser, page, drive_rows(100))
        for summary in browser.find_elements(By.CSS_SELECTOR, "#failing-cases summary"):
            browser.execute_script("arguments[0].click()", summary)
        assert len(browser.find_elements(By.CSS_SELECTOR, "#failing-cases .plot")) >= 9
        wide = browser.execute_script("return document.documentElement.scrollWidth")
        assert wide <= width


def test_it_prints_the_failing_cases_in_full(browser: webdriver.Chrome, page: Path) -> None:
    rows = drive_rows(100)
    opened(browser, page, rows)
    browser.execute_script("window.dispatchEvent(new Event('beforeprint'))")
    assert len(browser.find_elements(By.CSS_SELECTOR, ".grid .space .row")) == 100
    blocks = browser.find_elements(By.CSS_SELECTOR, "#failing-cases .case")
    assert len(blocks) == sum(row["outcome"] != "passed" for row in rows)
    assert all(block.get_attribute("open") is not None for block in blocks)
