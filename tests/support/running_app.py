"""A bench that runs as a command, and a browser's visit to it."""

import os
import re
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import dataclass
from urllib.parse import urlsplit

RUN = [sys.executable, "-c", "from qlvbayes.cli.main import run; run()"]
PATIENCE = 300_000  # ms that a step may take on a machine that does other work too


@dataclass(frozen=True)
class App:
    """Its address with the token, as the command prints it, and the process that serves."""

    address: str
    process: int


@contextmanager
def running_app(sessions, *arguments):
    """The command as a user runs it, and ends it."""
    command = [*RUN, "app", *map(str, arguments), "--no-browser", "--sessions", str(sessions)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env=os.environ | {"PYTHONUNBUFFERED": "1"}
    ) as server:
        try:
            found = filter(None, (re.search(r"http\S+", line) for line in server.stdout))
            yield App(next(found)[0], server.pid)
        finally:
            server.terminate()
            server.communicate(timeout=300)


class Visit:
    """A page of the bench, what it said on the console and what it asked of other machines."""

    def __init__(self, browser, app, width=1400):
        self.context = browser.new_context(
            viewport={"width": width, "height": 900}, accept_downloads=True
        )
        self.context.set_default_timeout(PATIENCE)
        self.said, self.asked = [], []
        self.home = "http://" + urlsplit(app.address).netloc
        self.page = self.open(app.address)

    def open(self, address):
        """Another tab of the same browser."""
        page = self.context.new_page()
        page.on("console", lambda message: self.said.append(message.text))
        page.on("pageerror", lambda error: self.said.append(str(error)))
        page.on("request", lambda request: self.asked.append(request.url))
        page.goto(address)
        return page

    @property
    def elsewhere(self):
        """Addresses asked for that are not this server's."""
        return [url for url in self.asked if not url.startswith((self.home, "data:", "blob:"))]

    def bundled(self, name, page=None):
        """Open a session of a bundled file and wait for its curves."""
        page = page or self.page
        page.goto(self.home)
        page.get_by_role("button", name=f"Open {name}").click()
        page.locator("#force canvas").wait_for()
        page.locator("#map td.cell").first.wait_for()
        return page

    def close(self):
        """Leave."""
        self.context.close()


def until(page, what):
    """Wait until something that the page's script can tell is true."""
    for _ in range(PATIENCE // 100):
        if page.evaluate(what):
            return
        page.wait_for_timeout(100)
    raise AssertionError(f"never true: {what}")


def now(page, what):
    """A value of what the page knows."""
    return page.evaluate(f"bench.store.now.{what}")


def errors(page):
    """(how, fitted, held-out or None) of each model in the list of errors, from the store."""
    return [(s["how"], s["rmse"], s["heldout"]) for s in now(page, "entry.history")]
