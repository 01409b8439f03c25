"""Make the pictures of the pages, all or those named: python docs/building/pictures.py [NAME ...].

Most are figures that commands of the pages leave, run in build/pictures, where a further call goes
on. ``bench`` needs the tests' packages and a Chromium. All are kept small. The pictures on exports
are made by validation/exported.py, and made small here.
"""

import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.plots.style import style
from qlvbayes.simulate import TABLE_1, HiddenPad, Platen, draw_effect_in, full_retraction_protocol

ROOT = Path(__file__).parents[2]
PICTURES = ROOT / "docs" / "pictures"
WORK = ROOT / "build" / "pictures"
WIDEST = 1200  # pixels
COLOURS = 64  # of a palette
GREY, BLUE = "0.55", "#0072b2"

# Pictures that are figures of commands: where they stand, and what makes them.
LOADS = "force 1 N in 0.1 s, hold 30 s, force 0.3 N in 0.1 s, hold 30 s"
COMMANDS: dict[str, tuple[str, tuple[str, ...]]] = {
    "forces_before_after": (
        "friction/B/forces_before_after.png",
        (
            "simulate -o friction.csv --pads B --hide friction --seed 1",
            "diagnose friction.csv -o friction",
        ),
    ),
    "design": (
        "design/B/design.png",
        (
            f"study {ROOT}/data/pads.csv -o design --pads B",
            "design design --pad B --for m,b,cause --minutes 10 --tests 3",
        ),
    ),
    "creep": (
        "creep/B/prediction.png",
        (
            "simulate -o creep.csv --pads B --rates none --loads 0.3,1 --max-rows 400",
            "fit creep.csv -o creep --all-tests",
            f'check creep --program "{LOADS}"',
        ),
    ),
    "convert": ("tidy.png", ("look press.csv --pad B -o tidy.csv",)),
}
# Of this figure the head and the two slowest of six tests, as a share of its height.
TOP = {"forces_before_after": 0.352}


def small(path: Path) -> None:
    """Make a picture at most WIDEST wide and give it a palette."""
    with Image.open(path) as picture:
        if picture.mode == "P" and picture.width <= WIDEST:
            return
        plain = picture.convert("RGB")
    if plain.width > WIDEST:
        height = round(plain.height * WIDEST / plain.width)
        plain = plain.resize((WIDEST, height), Image.Resampling.LANCZOS)
    plain.quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)


def by_commands(name: str) -> None:
    """Run the commands of a page, and take the figure that they leave."""
    figure, commands = COMMANDS[name]
    WORK.mkdir(parents=True, exist_ok=True)
    if name == "convert":
        sys.path.insert(0, str(ROOT / "tests"))
        from support.machine_files import Pressed, bluehill, pressed

        test = pressed()
        turned = Pressed(test.time, -test.way - 3.0, -test.load)
        (WORK / "press.csv").write_text(bluehill(turned))
    for command in commands:
        words = [word.strip('"') for word in re.findall(r'"[^"]*"|\S+', command)]
        program = [sys.executable, "-c", "from qlvbayes.cli.main import run; run()", *words]
        subprocess.run(program, cwd=WORK, check=True)
    with Image.open(WORK / figure) as picture:
        height = round(TOP.get(name, 1.0) * picture.height)
        picture.crop((0, 0, picture.width, height)).save(PICTURES / f"{name}.png")


def grip() -> Figure:
    """Draw the grip of the page on prediction, by the code that stands there."""
    text = (ROOT / "docs" / "prediction.md").read_text(encoding="utf-8")
    code = next(one for one in re.findall(r"```python\n(.*?)```", text, re.S) if "GRIP" in one)
    found: dict = {}
    exec(code, found)
    figure = Figure((7.1, 2.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for positions, line in ((found["stays"], "--"), (found["command"], "-")):
        left.plot(found["time"], positions, line, color=BLUE)
        right.plot(found["time"], found["real_force"](positions), line, color=BLUE)
    right.axhspan(0.97, 1.03, color="0.85")
    left.set(xlabel="time (s)", ylabel="displacement (mm)")
    right.set(xlabel="time (s)", ylabel="force (N)")
    return figure


# what each effect adds to the force

SIZE = 0.06  # of the peak force: the effect's largest contribution in these tests
RATES = (2.0, 20.0)  # mm/s, of the first test and the second; the second is drawn
APART = 600.0  # s between their beginnings, so that what changes with the clock has changed
PHASES = ("press", "hold", "back", "rest") * 2
COLUMNS = 4


def phases(platen: Platen) -> list[tuple[float, float]]:
    """Return begin and end (s) of each press, hold and way back."""
    edges = [0.0]
    for piece, after in zip(platen.pieces[:-1], platen.pieces[1:], strict=True):
        still, then = (one.velocity == one.acceleration == 0.0 for one in (piece, after))
        if still != then:
            edges.append(after.start)
    return list(zip(edges, [*edges[1:], platen.duration], strict=True))


def draw(ax: Axes, pad: HiddenPad, effect: HiddenPad, platen: Platen) -> None:
    """Draw the force that the effect adds, in per cent of the peak, before the force itself."""
    spans, peak = phases(platen), 0.0
    curves = []
    for k, (begin, end) in enumerate(spans):
        even = np.linspace(0.0, 1.0, 240)
        # at rest the time since it began is drawn in its logarithm, from 1 ms
        moves = k % 2 == 0
        since = (end - begin) * even if moves else 1e-3 * ((end - begin) / 1e-3) ** even
        time = np.clip(begin + since, begin + 1e-9, end - 1e-9)
        plain, with_it = pad.force(platen, time), effect.force(platen, time)
        peak = max(peak, float(plain.max()))
        curves.append((k + even, plain, with_it - plain))
    most = max(float(np.abs(added).max()) for *_, added in curves)
    for x, plain, added in curves:
        ax.fill_between(x, 0.0, plain / peak * 100.0 * most / peak, color="0.9", lw=0)
        ax.plot(x, 100.0 * added / peak, color=BLUE, lw=1.2)
    for edge in range(1, len(spans)):
        ax.axvline(edge, color="0.8", lw=0.5, zorder=0)
    ax.axhline(0.0, color=GREY, lw=0.5, zorder=0)
    ax.set_xlim(0.0, len(spans))


def effects() -> Figure:
    """Draw a panel for each candidate effect: one pad of the simulator with it and without."""
    pad = HiddenPad(TABLE_1["B"])
    tests = [
        Platen(full_retraction_protocol(rate), start_s=k * APART, number=k)
        for k, rate in enumerate(RATES)
    ]
    lines = -(-len(EFFECTS) // COLUMNS)
    with style():
        figure = Figure((7.1, 1.25 * lines), layout="constrained")
        panels = figure.subplots(lines, COLUMNS, sharex=True).ravel()
        for ax, kind in zip(panels, EFFECTS, strict=False):
            rng = np.random.default_rng(1)
            effect = draw_effect_in(kind.name, rng, pad, tests, SIZE, TABLE_1["B"].v)
            draw(ax, pad, HiddenPad(TABLE_1["B"], (effect,)), tests[-1])
            ax.set_title(kind.name, fontsize=6, loc="left", fontweight="bold")
            ax.tick_params(labelsize=6)
            ax.set_xticks([k + 0.5 for k in range(len(PHASES))], PHASES, fontsize=5, rotation=90)
            ax.tick_params(axis="x", length=0)
        for ax in panels[len(EFFECTS) - COLUMNS : len(EFFECTS)]:
            ax.tick_params(labelbottom=True)
        for ax in panels[len(EFFECTS) :]:
            ax.remove()
        figure.supylabel("force added (% of the peak force)", fontsize=7)
    return figure


def bench() -> None:
    """Click through the hidden case on the bench's page, and through its two forms."""
    sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "app")]
    from playwright.sync_api import expect, sync_playwright
    from support.machine_files import workbook
    from support.running_app import PATIENCE, Visit, running_app
    from test_app_browser import UNCLEAR, chromium, drop

    expect.set_options(timeout=5 * PATIENCE)
    with (
        tempfile.TemporaryDirectory() as made,
        running_app(made) as app,
        sync_playwright() as playwright,
    ):
        browser = playwright.chromium.launch(executable_path=chromium(), args=["--no-sandbox"])
        visit = Visit(browser, app, WIDEST)
        page = visit.page

        def take(name: str) -> None:
            page.wait_for_timeout(500)  # ms, for the last frame
            page.screenshot(path=PICTURES / f"bench_{name}.png", full_page=True)

        def press(name: str) -> None:
            page.get_by_role("button", name=name, exact=True).click()

        page.goto(visit.home)
        page.locator(".drop").wait_for()
        drop(page, "test1.csv", UNCLEAR)
        page.locator("#asking pre").wait_for()
        take("asked")
        page.goto(visit.home)
        file = workbook(Path(made) / "specimens.xlsx", ["AA1", "AA2", "BB1", "BB2"])
        page.locator("#files").set_input_files(file)
        page.get_by_label("several pads").check()
        take("pads")
        page = visit.bundled("hidden")
        page.wait_for_timeout(1000)
        take("opened")
        page.get_by_role("button", name="ramp of C-100").click()
        for effect in ("squeeze film", "friction"):
            press(f"Draw it {effect}")
            page.get_by_text("squared residual").last.wait_for()
            page.wait_for_timeout(1000)
        page.locator("#residual .u-over").hover()
        page.locator(".effects").evaluate("list => { list.scrollTop = 0; }")
        take("drawn")
        press("Add squeeze film")
        current = page.locator(".states li.current")
        expect(current).to_contain_text("squeeze film")
        expect(current).not_to_contain_text("being computed")
        page.locator("#test").select_option("all tests")
        take("added")
        press("Search all hypotheses")
        page.get_by_text("Verdict:").wait_for(timeout=5 * PATIENCE)
        take("searched")
        browser.close()


DRAWN: dict[str, Callable[[], Figure]] = {"effects": effects, "grip": grip}


def main(names: list[str]) -> None:
    """Make the named pictures, or all."""
    for name in names or [*DRAWN, *COMMANDS, "bench"]:
        if name in DRAWN:
            DRAWN[name]().savefig(PICTURES / f"{name}.png", dpi=160)
        elif name in COMMANDS:
            by_commands(name)
        else:
            bench()
    for path in PICTURES.glob("*.png"):
        small(path)


if __name__ == "__main__":
    main(sys.argv[1:])
