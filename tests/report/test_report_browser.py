"""The report in a real browser: offline, without errors, zoomed, on a phone and on paper."""

import pytest
from support.written_results import write_study

from qlvbayes import write_report

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    return write_report(write_study(tmp_path_factory.mktemp("results")))


class Visit:
    """The page as opened, what it said on the console and what it asked the network for."""

    def __init__(self, browser, path, width=1400, **options):
        self.context = browser.new_context(viewport={"width": width, "height": 900}, **options)
        self.page = self.context.new_page()
        self.said, self.asked = [], []
        self.page.on("console", lambda message: self.said.append(message.text))
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.route("**/*", self._allow)
        self.page.goto(path.as_uri())

    def _allow(self, route):
        address = route.request.url
        if address.startswith(("file:", "data:")):
            route.continue_()
        else:
            self.asked.append(address)
            route.abort()

    def span(self, viewer):
        """The time that a viewer shows (s)."""
        return [float(viewer.get_attribute(f"data-{end}")) for end in ("min", "max")]


@pytest.fixture(scope="module")
def visit(browser, report):
    opened = Visit(browser, report)
    yield opened
    opened.context.close()


@pytest.fixture
def viewer(visit):
    found = visit.page.locator(".live").first
    found.scroll_into_view_if_needed()
    return found


def test_it_opens_offline_without_a_word_on_the_console(browser, report):
    opened = Visit(browser, report, offline=True)
    opened.page.wait_for_selector(".live canvas")
    assert opened.said == opened.asked == []
    opened.context.close()


def test_every_figure_can_be_seen_and_heard(visit):
    broken = "images => images.filter(i => !i.naturalWidth || !i.alt.trim()).length"
    pictures = visit.page.locator("figure img")
    assert pictures.count() > 0
    assert pictures.evaluate_all(broken) == 0
    for drawing in visit.page.locator(".live [role=img]").all():
        assert "pad" in drawing.get_attribute("aria-label")


def test_a_fast_test_opens_on_logarithmic_time_and_can_be_switched(visit, viewer):
    """Half of the axis belongs to ramp and hold, in which the first millisecond can be seen."""
    assert viewer.get_attribute("data-scale") == "log"
    scale = "viewers[0].charts.map(c => [c.scales.x.min, c.scales.x.max])"
    assert visit.page.evaluate(scale) == [pytest.approx([0.0, 4.0], abs=0.01)] * 2
    assert visit.page.evaluate("viewers[0].time.to(0.05)") == pytest.approx(1.0)
    for time in (0.01, 1.0, 29.0, 30.4, 45.0):
        back = visit.page.evaluate(f"viewers[0].time.from(viewers[0].time.to({time}))")
        assert back == pytest.approx(time, rel=1e-9)
    assert "logarithmic" in visit.page.evaluate("viewers[0].charts[0].axes[0].label")
    viewer.get_by_role("button", name="hold").click()
    assert visit.span(viewer)[1] == pytest.approx(30.8, abs=2.0)
    switch(viewer, "linear")
    assert visit.span(viewer) == pytest.approx([0.0, 60.0], abs=1.0)
    assert viewer.get_attribute("data-scale") == "linear"
    switch(viewer, "logarithmic")
    assert viewer.get_attribute("data-scale") == "log"
    assert visit.said == []


def switch(viewer, name):
    viewer.get_by_role("button", name=name, exact=True).click()


def test_dragging_zooms_both_curves_and_a_double_click_shows_all(visit, viewer):
    switch(viewer, "linear")
    start, stop = visit.span(viewer)
    assert stop - start > 55.0
    surface = viewer.locator(".force .u-over")
    box = surface.bounding_box()
    x, y = box["x"], box["y"] + 0.5 * box["height"]
    visit.page.mouse.move(x + 0.25 * box["width"], y)
    visit.page.mouse.down()
    visit.page.mouse.move(x + 0.50 * box["width"], y, steps=5)
    visit.page.mouse.up()
    low, high = visit.span(viewer)
    assert low == pytest.approx(start + 0.25 * (stop - start), abs=1.0)
    assert high == pytest.approx(start + 0.50 * (stop - start), abs=1.0)
    scales = visit.page.evaluate("viewers[0].charts.map(c => [c.scales.x.min, c.scales.x.max])")
    assert scales == [pytest.approx([low, high])] * 2
    surface.dblclick()
    assert visit.span(viewer) == pytest.approx([start, stop])


@pytest.mark.parametrize("width", [420, 1400])
def test_nothing_sticks_out_of_the_page(browser, report, width):
    opened = Visit(browser, report, width)
    opened.page.locator("details").evaluate_all("all => all.forEach(d => { d.open = true; })")
    assert opened.page.evaluate("document.documentElement.scrollWidth") <= width
    opened.context.close()


def test_without_scripts_and_on_paper_figures_stand_in_and_all_is_unfolded(browser, report):
    opened = Visit(browser, report, java_script_enabled=False)
    assert opened.page.locator(".still img").first.is_visible()
    assert not opened.page.locator(".live").first.is_visible()
    opened.context.close()
    opened = Visit(browser, report)
    opened.page.emulate_media(media="print")
    opened.page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert opened.page.locator(".still img").first.is_visible()
    assert not opened.page.locator(".live").first.is_visible()
    assert opened.page.locator("details:not([open])").count() == 0
    assert opened.page.pdf(format="A4").startswith(b"%PDF")
    opened.context.close()
