"""The bench's server as a process of its own, asked over HTTP; no browser is needed."""

import contextlib
import json
import os
import re
import signal
import time
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest

for needed in ("starlette", "uvicorn", "python_multipart"):
    pytest.importorskip(needed, reason=f"no {needed}: bench not served")
httpx = pytest.importorskip("httpx", reason="no httpx: bench not asked")

from support.endtoend import two_tests  # noqa: E402
from support.machine_files import CORPUS  # noqa: E402
from support.running_app import running_app  # noqa: E402

import qlvbayes as q  # noqa: E402
from qlvbayes.app.sessions import BenchPad, Sessions  # noqa: E402
from qlvbayes.diagnosis.description.grammar import grammar  # noqa: E402
from qlvbayes.diagnosis.description.source import References, source_of  # noqa: E402
from qlvbayes.io.files import DESCRIBED  # noqa: E402
from qlvbayes.io.units import PAD  # noqa: E402

pytestmark = pytest.mark.integration
PATIENCE = 300.0  # s that a step may take on a machine that does other work too
PLAIN = {"elastic": "exponential", "relaxation": "prony:2", "effects": []}
BROKEN = "time_s,displacement_mm,force_N\n0,0,0\n0.1,0.1,0.1\n0.05,0.2,0.2\n0.3,0.3,0.3\n"
PROC = Path("/proc")
LINUX = pytest.mark.skipif(not PROC.is_dir(), reason="looks into /proc")


class Served:
    """A server that runs as the command, and a client with its token."""

    def __init__(self, app, sessions):
        place = urlsplit(app.address)
        self.app, self.process, self.sessions = app, app.process, sessions
        self.token = parse_qs(place.query)["token"][0]
        self.base = f"http://{place.netloc}"
        headers = {"Authorization": f"Bearer {self.token}", "X-Qlvbayes": "1"}
        self.client = httpx.Client(base_url=self.base, headers=headers, timeout=PATIENCE)

    def get(self, path):
        return self.client.get(path).raise_for_status().json()

    def post(self, path, content):
        return self.client.post(path, json=content).raise_for_status().json()

    def upload(self, *files):
        """(name, content) of each: the new session's id."""
        parts = [("file", file) for file in files]
        answer = self.client.post("/api/upload", files=parts)
        return answer.raise_for_status().json()["id"]

    def until(self, session, *stages):
        """The session's state, once it has come to one of some stages."""
        return wait_for(
            lambda: self.get(f"/api/s/{session}"), lambda state: state["stage"] in stages
        )

    def children(self, module):
        """Process ids of the server's workers that answer the calls of a module."""
        task = Path(f"/proc/{self.process}/task/{self.process}/children")
        found = set()
        for number in task.read_text().split():
            with contextlib.suppress(OSError):  # gone
                line = Path(f"/proc/{number}/cmdline").read_bytes()
                if line.endswith(f"qlvbayes.app.worker\0{module}\0".encode()):
                    found.add(int(number))
        return found


def model_of(state):
    return {key: state[key] for key in ("elastic", "relaxation", "effects", "values")}


def wait_for(ask, enough):
    """The first answer that is enough."""
    end = time.monotonic() + PATIENCE
    while not enough(answer := ask()):
        assert time.monotonic() < end, answer
        time.sleep(0.1)
    return answer


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    sessions = tmp_path_factory.mktemp("sessions")
    with running_app(sessions) as app:
        running = Served(app, sessions)
        yield running
        running.client.close()
        modules = ("computations", "steps") if PROC.is_dir() else ()
        started = {number for module in modules for number in running.children(module)}
    assert not any((PROC / str(number)).exists() for number in started)


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    return two_tests(tmp_path_factory.mktemp("data") / "two.csv")


@pytest.fixture(scope="module")
def opened(served, two):
    """A session of two tests, ready."""
    session = served.upload(("two.csv", two.read_bytes()))
    state = served.until(session, "ready", "failed")
    assert state["error"] is None
    return session


@pytest.mark.parametrize(
    ("name", "value"),
    [("Authorization", "Bearer wrong"), ("Authorization", ""), ("Host", "bench.example"),
     ("Origin", "http://other.example")],
)  # fmt: skip
def test_only_who_has_the_token_and_comes_from_the_page_is_answered(served, name, value):
    assert served.client.get("/api/start").status_code == 200
    answer = served.client.get("/api/start", headers={name: value})
    assert answer.status_code == 403
    assert "error" in answer.json()


def test_the_token_becomes_a_cookie_and_what_changes_something_needs_a_header(served):
    token = {"Authorization": f"Bearer {served.token}"}
    with httpx.Client(base_url=served.base, headers=token) as c:
        assert c.post("/api/sessions", json={"open": "hidden"}).status_code == 403
        assert c.delete("/api/s/anything").status_code == 403
    with httpx.Client(base_url=served.base) as visitor:
        assert visitor.get("/").status_code == 403
        assert visitor.get("/?token=wrong").status_code == 403
        entered = visitor.get("/", params={"token": served.token})
        assert entered.status_code == 303
        assert entered.headers["location"] == "/"
        words = entered.headers["set-cookie"].lower()
        assert re.search("httponly.*samesite=strict", words)
        page = visitor.get("/")
        policy = page.headers["content-security-policy"]
        assert (page.status_code, "unsafe" in policy) == (200, False)
        assert "default-src 'none'" in policy
        assert not re.search(r"<script(?![^>]*\bsrc=)|<style|\sstyle=|\son\w+=", page.text)


def test_what_is_not_there_too_long_or_no_model_is_told(served, opened):
    """And only files of the page are served."""
    pad, post = f"/api/s/{opened}/pads", served.client.post
    models = ({}, {**PLAIN, "elastic": "steel"}, {**PLAIN, "values": {"m": "much"}})
    files = ("..%2Fserver.py", "%2Fetc%2Fpasswd", "..%5Cserver.py", "none.js")
    paths = ("/api/s/none", "/api/s/..%2F..", "/nowhere", f"{pad}/Z/measured")
    answers = {
        404: [served.client.get(path) for path in (*paths, *(f"/static/{x}" for x in files))],
        413: [post("/api/sessions", content=b" " * 2_000_000)],
        422: [post(f"{pad}/C/curves", json=model) for model in models],
    }
    answers[422] += [post("/api/sessions", content=x) for x in (b"", b"[]", b"{", b"\xff")]
    for status, found in answers.items():
        assert {answer.status_code for answer in found} == {status}
        assert all(answer.json()["error"]["text"] for answer in found)


def test_a_broken_file_is_told_as_on_the_command_line(served, tmp_path):
    """And the name that it came with is never a path."""
    file = tmp_path / "broken.csv"
    file.write_text(BROKEN)
    with pytest.raises(q.InputError) as refused:
        q.read_study(file)
    session = served.upload(("../../broken.csv", BROKEN.encode()))
    state = served.until(session, "failed")
    assert state["name"] == "broken.csv"
    error = state["error"]
    assert error["text"] == str(refused.value).replace(str(file), "broken.csv")
    assert (error["file"], error["line"]) == ("broken.csv", 4)


def test_questions_come_one_after_another_and_stay_until_they_are_answered(served):
    """The contact of two tests that begin in it, and then their pads."""
    content = (CORPUS / "other" / "in_contact-mach-1.txt").read_bytes()
    session = served.upload(("a.txt", content))
    path = f"/api/s/{session}"
    first = served.until(session, "asking", "failed")["questions"]
    assert [one["name"] for one in first["ask"]] == ["contact"]
    served.post(f"{path}/answers", {"answers": {"contact": "file"}})
    served.until(session, "asking", "failed")
    second = served.get(path)["questions"]
    assert [one["name"] for one in second["ask"]] == ["specimens", "pad0", "pad1"]
    several = {"specimens": "several", "pad0": "A", "pad1": "a/b"}
    answer = served.client.post(f"{path}/answers", json={"answers": several})
    assert (answer.status_code, "a/b" in answer.json()["error"]["text"]) == (422, True)
    assert served.get(path)["questions"] == second
    served.post(f"{path}/answers", {"answers": several | {"pad1": "B"}})
    assert served.until(session, "preparing", "ready", "failed")["pads"] == ["A", "B"]
    assert served.client.post(f"{path}/answers", json={"answers": several}).status_code == 409
    served.client.delete(path).raise_for_status()
    assert served.client.get(path).status_code == 404


def test_curves_are_those_of_the_public_api(served, opened, two):
    state = served.get(f"/api/s/{opened}")["pad"]["C"]
    begun = state["history"][0]
    model = model_of(begun)
    pad = f"/api/s/{opened}/pads/C"
    found, measured = served.post(f"{pad}/curves", model), served.get(f"{pad}/measured")
    bench = q.Bench.from_experiment(q.read_study(two)["C"].experiment)
    look = bench.look(q.ByHand(values=begun["values"]))
    assert found["rmse"] == pytest.approx(look.error, rel=1e-9)
    assert found["rmse"] == pytest.approx(begun["rmse"], rel=1e-9)
    for k, test in enumerate(found["tests"]):
        np.testing.assert_allclose(test["model"], look.forces[k], rtol=1e-5)
        force = np.array(measured["tests"][k]["force"])
        np.testing.assert_allclose(force, bench.samples.observed[k], rtol=1e-5, atol=1e-12)
    assert {cell["phase"] for cell in found["cells"]} == {"ramp", "hold", "unload", "recovery"}
    assert all(cell["words"].startswith("The model is") for cell in found["cells"])


def test_an_effect_goes_in_and_out_and_every_state_stays(served, two, tmp_path):
    """In a session of its own, which leaves another as it was."""
    first, second = (served.upload(("two.csv", two.read_bytes())) for _ in range(2))
    for session in (first, second):
        served.until(session, "ready")
    pad = f"/api/s/{first}/pads/C"
    start = served.get(f"/api/s/{first}")["pad"]["C"]["history"][0]
    model = model_of(start)
    added = served.post(f"{pad}/states", {"add": "squeeze_film", "model": model})["state"]
    assert (added["parent"], added["effects"]) == (0, ["squeeze_film"])
    without = {"remove": "squeeze_film", "model": model_of(added)}
    out = served.post(f"{pad}/states", without)["state"]
    assert added["rmse"] < start["rmse"] == pytest.approx(out["rmse"], rel=0.02)
    back = served.post(f"{pad}/current", {"state": 1})
    assert back["state"]["id"] == 1
    assert back["curves"]["rmse"] == pytest.approx(added["rmse"], rel=1e-9)
    history = wait_for(
        lambda: served.get(f"/api/s/{first}")["pad"]["C"]["history"],
        lambda states: all(state["heldout"] is not None for state in states),
    )
    how = ["start", "add squeeze_film", "remove squeeze_film"]
    assert [state["how"] for state in history] == how
    assert history[1]["heldout"] < history[0]["heldout"]
    assert len(served.get(f"/api/s/{second}")["pad"]["C"]["history"]) == 1
    assert "--add squeeze_film" in served.client.get(f"{pad}/repeat.sh").text


def test_a_described_law_can_be_added(served, two):
    """What a diagnosis has left in the pad's folder is an effect of the bench."""
    session = served.upload(("two.csv", two.read_bytes()))
    served.until(session, "ready")
    pad = f"/api/s/{session}/pads/C"
    term = next(term for term in grammar() if term.name == "linear_drag_of_depth_squared")
    text = source_of([term], References(1.6, 100.0, 1000.0, 1.5, 500.0), PAD, "It describes.")
    folder = served.sessions / session / "C"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / DESCRIBED).write_text(text, encoding="utf-8")
    shown = {one["name"]: one["listed"] for one in served.get(f"{pad}/catalogue")["effects"]}
    assert shown[term.name] is True
    start = served.get(f"/api/s/{session}")["pad"]["C"]["history"][0]
    model = model_of(start)
    added = served.post(f"{pad}/states", {"add": term.name, "model": model})["state"]
    assert added["effects"] == [term.name]
    assert added["rmse"] <= start["rmse"]


@LINUX
def test_the_server_itself_never_loads_jax(served, opened):
    assert "jax" not in Path(f"/proc/{served.process}/maps").read_text()
    (worker,) = served.children("computations")
    assert "jaxlib" in Path(f"/proc/{worker}/maps").read_text()


@LINUX
def test_a_cancelled_job_leaves_no_process_and_others_go_on(served, opened):
    ordered = served.post(f"/api/s/{opened}/jobs", {"kind": "sample", "pad": "C"})
    path = f"/api/s/{opened}/jobs/{ordered['id']}"
    again = served.client.post(f"/api/s/{opened}/jobs", json={"kind": "sample", "pad": "C"})
    assert again.status_code == 409
    running = wait_for(lambda: served.get(path), lambda job: job["elapsed_s"] > 0.0)
    assert running["state"] == "running"
    assert served.client.post(f"{path}/enough").status_code == 409  # no search: nothing to sum up
    before = served.children("steps")
    assert served.post(f"/api/s/{opened}/pads/C/curves", PLAIN)["rmse"] > 0.0
    assert served.client.delete(path).json()["state"] == "cancelled"
    gone = before - served.children("steps")
    assert gone
    assert not any(Path(f"/proc/{number}").exists() for number in gone)
    assert served.get(path)["state"] == "cancelled"
    assert not [*served.sessions.glob(f"{opened}/**/*.part")]


@LINUX
def test_the_worker_is_killed_and_the_page_goes_on(served, opened):
    path = f"/api/s/{opened}/pads/C/curves"
    before = served.post(path, PLAIN)
    (worker,) = served.children("computations")
    os.kill(worker, signal.SIGKILL)
    answer = wait_for(
        lambda: served.client.post(path, json=PLAIN), lambda answer: answer.status_code != 503
    )
    assert answer.json() == before
    assert served.children("computations") - {worker}


def test_a_session_is_found_again_in_its_folder_and_a_stranger_s_adds_no_other_option(tmp_path):
    session = Sessions(tmp_path).new("mine.csv")
    session.bench["C"] = BenchPad()
    session.bench["C"].add("start", PLAIN | {"values": {"m": 1.0}}, 0.1)
    session.save()
    again = Sessions(tmp_path).get(session.id)
    assert (again.name, again.stage, again.bench) == ("mine.csv", "closed", session.bench)
    assert [one["id"] for one in Sessions(tmp_path).known()] == [session.id]
    evil = {"made": {"files": [], "options": {"formats-file": "evil.py"}}}
    whole = {"name": "", "data": "", "notices": [], "pads": {"C": {}}}
    for content in ("{}", "[", json.dumps(whole | evil)):
        (tmp_path / "bench.json").write_text(content)
        session = Sessions(tmp_path).new("a", tmp_path)
        session.load()
        assert (session.made, session.bench) == (None, {})
