"""Pages as pictures, by Debian's Chromium."""

import base64
import io
import json
import subprocess
from pathlib import Path
from typing import Any

from PIL import Image
from selenium import webdriver
from selenium.webdriver.common.by import By

from tests.integration.chromium import logged, screen
from tests.waiting import PATIENCE, wait_until

SOURCES = Path(__file__).parent / "board"
_FONTS = ("svg", "ttf", "woff2")
_COLORS = 128


def bundled(packages: Path, folder: Path) -> Path:
    """A folder with the page's program, made of Grafana's components; `packages` are npm's."""
    command = [
        str(packages / "node_modules/.bin/esbuild"), str(SOURCES / "page.tsx"), "--bundle",
        f"--outfile={folder / 'page.js'}", "--format=iife", "--jsx=automatic", "--minify",
        '--define:process.env.NODE_ENV="production"', "--log-level=error",
        *(f"--loader:.{ending}=dataurl" for ending in _FONTS),
    ]  # fmt: skip
    # The page's imports are looked for beside it, and then here.
    environment = {"NODE_PATH": str(packages / "node_modules"), "PATH": "/usr/bin:/bin"}
    subprocess.run(command, check=True, env=environment, timeout=300)
    return folder


def draw_board(
    browser: webdriver.Chrome, folder: Path, board: dict[str, Any], answers: dict[str, Any],
    picture: Path, mode: str = "light",
) -> None:  # fmt: skip
    """A dashboard's JSON with what a Prometheus answered to its panels."""
    given = {"BOARD": board, "ANSWERS": answers, "MODE": mode}
    # What is in a script may not end it.
    words = [f"window.{name}={json.dumps(value)};" for name, value in given.items()]
    script = "".join(words).replace("</", "<\\/")
    page = folder / "board.html"
    page.write_text(
        '<!doctype html><meta charset="utf-8"><link rel="stylesheet" href="page.css">'
        f'<body><div id="root"></div><script>{script}</script><script src="page.js"></script>'
    )
    panels = sum(panel["type"] != "row" for panel in board["panels"])
    logged(browser, "browser")

    def all_there() -> bool:
        return bool(len(browser.find_elements(By.CSS_SELECTOR, ".panel section")) == panels)

    with screen(browser, 1200):
        browser.get(page.as_uri())
        wait_until(all_there, PATIENCE, f"not all {panels} panels of {board['title']} were drawn")
        thrown = [entry for entry in logged(browser, "browser") if "Uncaught" in entry["message"]]
        assert thrown == []
        photograph(browser, picture)


def photograph(browser: webdriver.Chrome, picture: Path, height: int | None = None) -> None:
    """The page as it is now, from its top; whole, or so many pixels of it."""
    whole = browser.execute_cdp_cmd("Page.getLayoutMetrics", {})["cssContentSize"]
    clip = {
        "x": 0,
        "y": 0,
        "width": whole["width"],
        "height": height or whole["height"],
        "scale": 1,
    }
    options = {"format": "png", "captureBeyondViewport": True, "clip": clip}
    shot = browser.execute_cdp_cmd("Page.captureScreenshot", options)
    with Image.open(io.BytesIO(base64.b64decode(shot["data"]))) as image:
        # A third of the bytes, and the same to the eye.
        image.convert("RGB").quantize(_COLORS).save(picture, optimize=True)
