"""Takes the pictures of the bench's page anew: python docs/building/bench_pictures.py [FOLDER].

It needs the tests' packages and a Chromium, runs the bench as the tests do, and clicks through the
hidden case at 1400 pixels and at 800.
"""

import sys
import tempfile
from pathlib import Path

from playwright.sync_api import Page, expect, sync_playwright

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "app")]
from support.machine_files import workbook  # noqa: E402
from support.running_app import PATIENCE, Visit, running_app  # noqa: E402
from test_app_browser import UNCLEAR, chromium, drop  # noqa: E402

NARROW, WIDE = 800, 1400  # pixels


def walk(visit: Visit, folder: Path, end: str) -> None:
    """The hidden case: opened, two signatures drawn, the right effect added, all searched."""
    page = visit.bundled("hidden")
    page.wait_for_timeout(1000)
    take(page, folder / f"bench_opened{end}.png")
    page.get_by_role("button", name="ramp of C-100").click()
    for effect in ("squeeze film", "friction"):
        press(page, f"Draw it {effect}")
        page.get_by_text("squared residual").last.wait_for()
        page.wait_for_timeout(1000)
    page.locator("#residual .u-over").hover()
    page.locator(".effects").evaluate("list => { list.scrollTop = 0; }")
    take(page, folder / f"bench_drawn{end}.png")
    press(page, "Add squeeze film")
    current = page.locator(".states li.current")
    expect(current).to_contain_text("squeeze film")
    expect(current).not_to_contain_text("being computed")
    page.locator("#test").select_option("all tests")
    take(page, folder / f"bench_added{end}.png")
    press(page, "Search all hypotheses")
    page.get_by_text("Verdict:").click(timeout=5 * PATIENCE)
    take(page, folder / f"bench_searched{end}.png")


def asked(visit: Visit, folder: Path, end: str) -> None:
    """The form for a file whose columns are not clear."""
    visit.page.goto(visit.home)
    visit.page.locator(".drop").wait_for()
    drop(visit.page, "test1.csv", UNCLEAR)
    visit.page.locator("#asking canvas").last.wait_for()
    take(visit.page, folder / f"bench_asked{end}.png")


def pads_asked(visit: Visit, folder: Path, end: str) -> None:
    """The form for a file of several tests, which may be several specimens."""
    page = visit.page
    page.goto(visit.home)
    with tempfile.TemporaryDirectory() as made:
        file = workbook(Path(made) / "specimens.xlsx", ["AA1", "AA2", "BB1", "BB2"])
        page.locator("#files").set_input_files(file)
        page.get_by_label("several pads").check()
    take(page, folder / f"bench_pads{end}.png")


def press(page: Page, name: str) -> None:
    """A button by its whole name."""
    page.get_by_role("button", name=name, exact=True).click()


def take(page: Page, path: Path) -> None:
    """All of the page."""
    page.wait_for_timeout(500)  # ms, for the last frame
    page.screenshot(path=path, full_page=True)
    print(path)


def main(folder: Path) -> None:
    """Both widths."""
    expect.set_options(timeout=5 * PATIENCE)
    with (
        tempfile.TemporaryDirectory() as sessions,
        running_app(sessions) as app,
        sync_playwright() as playwright,
    ):
        browser = playwright.chromium.launch(executable_path=chromium(), args=["--no-sandbox"])
        for width, end in ((WIDE, ""), (NARROW, "_narrow")):
            visit = Visit(browser, app, width)
            asked(visit, folder, end)
            pads_asked(visit, folder, end)
            walk(visit, folder, end)
            visit.close()
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "pictures")
