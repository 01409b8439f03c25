"""The bench in a real browser: open, see, add, watch the error fall, sample, take out."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from support.endtoend import PADS
from support.exported_pad import write_fit
from support.machine_files import workbook
from support.running_app import Visit, errors, now, running_app, until

from qlvbayes.fitting.results import load
from qlvbayes.fitting.summary import Constant, FitSummary
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements
from qlvbayes.io.text import digest

sync_api = pytest.importorskip("playwright.sync_api", reason="no playwright: bench not opened")
for needed in ("starlette", "uvicorn", "python_multipart"):
    pytest.importorskip(needed, reason=f"no {needed}: bench not opened")
expect = sync_api.expect
pytestmark = pytest.mark.integration
BROKEN = """test,time_s,displacement_mm,force_N
a,0,0,0
a,0.1,0.1,0.05
a,0.05,0.2,0.10
a,0.3,0.3,0.20
"""
NAMELESS = """all => all.filter(one => one.checkVisibility() && !(one.getAttribute("aria-label") ||
    one.textContent.trim() || one.labels?.length || one.getAttribute("aria-labelledby")))
    .map(one => one.outerHTML)"""
expect.set_options(timeout=300_000)  # ms, as in the visit


@pytest.fixture(scope="module")
def app(tmp_path_factory):
    with running_app(tmp_path_factory.mktemp("sessions")) as running:
        yield running


@pytest.fixture
def visit(browser, app):
    opened = Visit(browser, app)
    yield opened
    assert opened.elsewhere == []
    opened.close()


def drop(page, name, text):
    """Let a file fall on the page, as from the desktop."""
    files = page.evaluate_handle(
        "([name, text]) => { const files = new DataTransfer();"
        " files.items.add(new File([text], name, { type: 'text/csv' })); return files; }",
        [name, text],
    )
    page.locator(".drop").dispatch_event("drop", {"dataTransfer": files})


def cell(page, test, phase):
    return page.locator("#map tr", has_text=test).get_by_role("button", name=f"{phase} of {test}")


def takes(page, effect):
    """Share of the squared residual that a drawn effect would take (%)."""
    row = page.locator(".effects li", has=page.get_by_role("button", name=f"Draw it {effect}"))
    row.get_by_role("button", name=f"Draw it {effect}", exact=True).click()
    return float(re.search(r"take (?:[<>] )?(\d+) %", row.locator(".drawn").inner_text())[1])


def test_the_first_page_shows_what_can_be_opened_and_says_no_word_on_the_console(visit):
    page = visit.page
    expect(page.get_by_role("button", name="Open hidden")).to_be_visible()
    assert "token" not in page.url
    assert page.locator("button, input, select, a").evaluate_all(NAMELESS) == []
    assert visit.said == []


def test_a_broken_file_that_is_dropped_is_refused_in_the_words_of_the_command(visit, tmp_path):
    path = tmp_path / "broken.csv"
    path.write_text(BROKEN)
    with pytest.raises(InputError) as refused:
        read_measurements(path)
    expect(visit.page.locator(".drop")).to_be_visible()
    drop(visit.page, "broken.csv", BROKEN)
    line = visit.page.locator("#wait .wrong, #start .wrong").filter(has_text="broken.csv")
    expect(line).to_contain_text("line 4")
    assert str(refused.value).removeprefix(f"{tmp_path}/") in line.inner_text()
    expect(visit.page.locator(".drop")).to_be_visible()  # for the file, once corrected


def test_which_test_is_of_which_pad_is_said_by_keyboard(visit, tmp_path):
    """By names in the table, which the server suggests; markup stays text."""
    pytest.importorskip("openpyxl")
    page, keys = visit.page, visit.page.keyboard
    expect(page.locator(".drop")).to_be_visible()
    page.locator("#files").set_input_files(
        workbook(tmp_path / "pads.xlsx", ["<b>A1", "<b>A2", "B1", "B2"])
    )
    asked = page.locator("#asking")
    expect(asked.get_by_label("one pad")).to_be_focused()
    expect(asked.locator("tbody th")).to_have_text(["<b>A1", "<b>A2", "B1", "B2"])
    expect(asked.locator("#ask-pad0")).to_be_hidden()
    keys.press("ArrowDown")
    expect(asked.locator("#ask-pad0")).to_have_value("<b>A")
    for pad in ("AA", "AA", "B", "C/D"):
        keys.press("Tab")  # into the table at first, which scrolls
        if page.evaluate("document.activeElement.tagName") != "INPUT":
            keys.press("Tab")
        keys.press("ControlOrMeta+a")
        keys.type(pad)
    assert asked.locator("input, button, a").evaluate_all(NAMELESS) == []
    keys.press("Enter")
    expect(asked.locator("form > .wrong")).to_contain_text("C-D")
    keys.press("ControlOrMeta+a")
    keys.type("C")
    keys.press("Enter")
    expect(asked).to_be_hidden()
    until(page, "bench.store.now.pads.length")
    assert now(page, "pads") == ["AA", "B", "C"]
    assert [text for text in visit.said if "422" not in text] == []


@pytest.mark.slow
def test_the_loop_by_hand(visit):
    """Hidden in the file is a squeeze film: it is seen, drawn, added, and takes the error down."""
    page = visit.bundled("hidden")

    # where it fails
    cell(page, "C-100", "ramp").click()
    expect(page.locator("#cell-words")).to_contain_text("too low on average")
    expect(page.locator("#test")).to_have_value("C-100")
    expect(page.get_by_role("button", name="ramp", exact=True)).to_have_attribute(
        "aria-pressed", "true"
    )
    expect(cell(page, "C-100", "ramp")).to_have_accessible_name(re.compile("beyond noise"))

    # what it may be
    assert takes(page, "squeeze film") > 10.0 * takes(page, "friction")
    expect(page.locator("#residual .u-legend")).to_contain_text("squeeze film")

    # the right one
    page.get_by_role("button", name="Add squeeze film", exact=True).click()
    last = page.locator(".states li.current")
    expect(last).to_contain_text("+ squeeze film")
    expect(last).not_to_contain_text("being computed")
    noise = now(page, "entry.noise")
    plain, added = errors(page)
    assert plain[2] > 1.3 * noise
    assert added[2] < 1.1 * noise
    expect(cell(page, "C-100", "ramp")).not_to_have_accessible_name(re.compile("beyond noise"))

    # out again, and back to it
    page.get_by_role("button", name="Remove squeeze film", exact=True).click()
    expect(page.locator(".states li.current")).to_contain_text("− squeeze film")
    assert errors(page)[2][1] == pytest.approx(plain[1], rel=0.02)
    page.get_by_role("button", name=re.compile(r"^\+ squeeze film.*Go back")).click()
    expect(page.get_by_role("button", name="Remove squeeze film", exact=True)).to_be_visible()
    assert now(page, "shown.rmse") == pytest.approx(added[1], rel=1e-6)

    # sample, and stop it
    page.get_by_role("button", name="Sample", exact=True).click()
    job = page.locator("#jobs .job")
    expect(job.locator("progress")).to_be_visible()
    page.get_by_role("button", name="Cancel: Sample").click()
    expect(job).to_contain_text("cancelled")

    # reload
    page.reload()
    expect(page.locator(".states li")).to_have_count(3)
    assert errors(page)[:2] == [plain, added]
    assert visit.said == []


@pytest.mark.slow
def test_a_slider_redraws_and_the_last_move_is_what_is_shown(visit):
    page = visit.bundled("hidden")
    slider = page.get_by_role("slider").first
    slider.focus()
    for _ in range(100):
        page.keyboard.press("ArrowRight")
    value = now(page, "hand.values.m")
    expect(page.locator(".states .hand")).to_be_visible()
    until(
        page, "Math.abs(bench.store.now.shown.values.m / bench.store.now.hand.values.m - 1) < 1e-9"
    )
    assert now(page, "hand.values.m") == value
    assert value > now(page, "entry.history")[0]["values"]["m"]

    # a number that is none, and one that is too large, are refused where they stand
    box = page.get_by_role("textbox", name="m in N/mm")
    for text, words in (("much", "write a number"), ("1e9", "goes from")):
        box.fill(text)
        box.press("Enter")
        expect(page.locator(".constant .wrong:visible")).to_contain_text(words)
    assert now(page, "hand.values.m") == value
    page.get_by_role("button", name="Put back").click()
    expect(page.locator(".states .hand")).to_have_count(0)
    assert visit.said == []


def sampled(out):
    """A folder of results as a command leaves it: pad B's file, posterior and summary."""
    out.mkdir()
    data = Path(shutil.copy(PADS, out / "data.csv"))
    write_fit(out, source=data, sha256=digest(data), spread=0.005)
    saved = load(out / "B" / "posterior.nc")
    posterior = {
        name: Constant(
            unit="1",
            mean=float(draws.mean()),
            sd=float(draws.std()),
            median=float(np.median(draws)),
            hdi90=tuple(np.quantile(draws, [0.05, 0.95]).tolist()),
            r_hat=1.0,
            ess_bulk=1000.0,
        )
        for name, draws in zip(saved.names, saved.draws.T, strict=True)
    }
    summary = FitSummary(pad="B", effects=(), sampler="emcee", converged=True, parameters=posterior)
    summary.write(out / "B" / "summary.json")
    return posterior


@pytest.mark.slow
def test_once_sampled_every_constant_shows_its_interval_and_the_slider_spans_it(browser, tmp_path):
    posterior = sampled(tmp_path / "OUT")
    with running_app(tmp_path / "sessions", tmp_path / "OUT") as app:
        visit = Visit(browser, app)
        page = visit.page
        page.get_by_role("button", name="Pad B").click()
        until(page, "bench.store.now.pad === 'B' && Boolean(bench.store.now.hand)")
        assert now(page, "entry.bands.state") == 0
        for parameter in now(page, "parameters"):
            row = page.locator(f".constant[data-key='{parameter['name']}']")
            ends = [f"{end:.4g}" for end in posterior[parameter["name"]].hdi90]
            expect(row.locator(".range")).to_have_text(f"90 %: {' to '.join(ends)}")
            if parameter["derived"]:
                continue
            share = row.locator(".track").evaluate(
                "track => ['--to', '--from'].map(x => parseFloat(track.style.getPropertyValue(x)))"
            )
            assert share[0] - share[1] > 15.0  # % of the slider: the fit may lie beyond its end
        assert visit.said == []
        visit.close()


@pytest.mark.slow
def test_a_search_is_ended_early_with_what_it_knows(visit):
    page = visit.bundled("hidden")
    page.get_by_role("button", name="Search all hypotheses").click()
    job = page.locator("#search-jobs .job")
    enough = job.get_by_role("button", name="That is enough")
    expect(enough).to_be_enabled()
    expect(page.locator(".effects .chance").first).to_be_visible()
    enough.click()
    expect(job).to_contain_text(re.compile("Summing up|done after"))
    expect(page.get_by_text("Verdict:")).to_be_visible()
    expect(page.locator(".words p").first).to_be_visible()  # it opens by itself
    expect(job).to_contain_text("done after")
    expect(job.get_by_role("button", name=re.compile("enough|Summing"))).to_have_count(0)
    result = now(page, "entry.diagnosis")
    shown = {one["effect"]: one["probability"] for one in now(page, "entry.ranking")}
    assert {one["effect"]: one["inclusion"] for one in result["ranking"]} == shown
    assert visit.said == []


@pytest.mark.slow
def test_a_move_while_a_fit_ends_leaves_no_curves_of_another_model(visit):
    """The answers of the server are held back, so that the move's comes after the fit's."""
    page, held = visit.bundled("hidden"), {}

    def hold(name, act):
        """The first request of a name after an act; those after it go on."""
        page.route(
            f"**/{name}",
            lambda route: route.continue_() if name in held else held.update({name: route}),
        )
        act()
        while name not in held:
            page.wait_for_timeout(20)

    hold("parameters", page.get_by_role("button", name="Fit from here").click)
    page.get_by_role("slider").first.focus()
    hold("curves", lambda: page.keyboard.press("ArrowRight"))
    held["parameters"].continue_()
    expect(page.locator(".states li")).to_have_count(2)
    page.wait_for_function("!bench.store.now.busy")
    with page.expect_response("**/curves") as answer:
        held["curves"].continue_()
    answer.value.finished()
    page.wait_for_timeout(500)
    shown, hand = (now(page, f"{name}.values.m") for name in ("shown", "hand"))
    assert shown == pytest.approx(hand, rel=1e-9)
