"""Answer the routes of the bench, which docs/app.md lists."""

from __future__ import annotations

import json
import re
from collections.abc import Awaitable, Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path, PurePosixPath
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import UploadFile
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from qlvbayes.app.actions import BUNDLED, Actions
from qlvbayes.app.failures import refused
from qlvbayes.app.jobs import Job
from qlvbayes.app.security import UPLOAD_LIMIT
from qlvbayes.app.sessions import Session, commands
from qlvbayes.io.files import bundled

_PAGE = Path(__file__).parent / "page"
_REPORT = Path(__file__).parents[1] / "report" / "static"
_MOST_FILES = 50  # files of an upload
_LONGEST = 100  # characters of an uploaded file's name that are kept
_HTML = "text/html; charset=utf-8"
_CSV = "text/csv; charset=utf-8"


class Routes:
    """Routes of the server, with the answers to their requests; all state is in ``actions``.

    An answer is content for JSON, or a response of another kind.
    """

    def __init__(self, actions: Actions) -> None:
        self.actions = actions

    def all(self) -> list[Route]:
        """Return all routes, each with its method, path and handler."""
        jobs, pad = "/api/s/{id}/jobs", "/api/s/{id}/pads/{pad}"
        table: list[tuple[str, str, Callable[[Request], Awaitable[Any]]]] = [
            ("GET", "/", self._page),
            ("GET", "/s/{id}", self._page),
            ("GET", "/static/{name}", self._static),
            ("GET", "/api/start", self._start),
            ("POST", "/api/sessions", self._open),
            ("POST", "/api/upload", self._upload),
            ("GET", "/api/s/{id}", self._state),
            ("DELETE", "/api/s/{id}", self._forget),
            ("GET", "/api/s/{id}/events", self._events),
            ("POST", "/api/s/{id}/answers", self._answers),
            ("GET", "/api/s/{id}/tidy.csv", self._tidy),
            ("GET", "/api/s/{id}/report.html", self._report),
            ("POST", jobs, self._order),
            ("GET", f"{jobs}/{{job}}", self._job),
            ("DELETE", f"{jobs}/{{job}}", self._cancel),
            ("POST", f"{jobs}/{{job}}/enough", self._enough),
            ("POST", f"{pad}/open", self._open_pad),
            ("POST", f"{pad}/states", self._change),
            ("POST", f"{pad}/current", self._go_back),
            ("GET", f"{pad}/{{call:str}}", self._pad_file),
            ("POST", f"{pad}/{{call:str}}", self._model),
        ]
        return [Route(path, _answering(do), methods=[method]) for method, path, do in table]

    def _session(self, request: Request) -> Session:
        session = self.actions.sessions.get(request.path_params["id"])
        if session.stage == "closed":
            self.actions.resume(session)
        return session

    def _pad(self, request: Request) -> tuple[Session, str]:
        return self._session(request), request.path_params["pad"]

    # page and files

    async def _page(self, request: Request) -> Response:
        return FileResponse(_PAGE / "index.html", media_type=_HTML)

    async def _static(self, request: Request) -> Response:
        """Return a static file of the page or of the report."""
        name = request.path_params["name"]
        for folder in (_PAGE, _REPORT):
            file = folder / name
            if file.parent == folder and file.is_file():
                return FileResponse(file)
        raise refused(404, f"there is no file {name}")

    # sessions

    async def _start(self, request: Request) -> Any:
        """Return what the first page shows."""
        known = {name: text for name, text in BUNDLED.items() if bundled(f"{name}.csv").is_file()}
        return {
            "version": _version(),
            "bundled": [{"name": name, "text": text} for name, text in known.items()],
            "sessions": self.actions.sessions.known(),
            "upload_limit_bytes": UPLOAD_LIMIT,
        }

    async def _open(self, request: Request) -> Any:
        """Open a session with measurements that come with the package."""
        return {"id": self.actions.open_bundled(str((await _body(request)).get("open"))).id}

    async def _upload(self, request: Request) -> Any:
        """Open a session with the user's files."""
        async with request.form(max_files=_MOST_FILES, max_fields=_MOST_FILES) as form:
            files = [one for one in form.getlist("file") if isinstance(one, UploadFile)]
            if not files:
                raise refused(422, "no file was sent", "choose one")
            names = [safe_name(one.filename or "") for one in files]
            more = f" and {len(names) - 1} more" if len(names) > 1 else ""
            session = self.actions.sessions.new(names[0] + more)
            paths = []
            for k, (name, one) in enumerate(zip(names, files, strict=True)):
                folder = session.private / f"upload{k}"
                folder.mkdir(parents=True)
                paths.append(folder / name)
                with paths[-1].open("wb") as sink:
                    while block := await one.read(2**20):
                        await run_in_threadpool(sink.write, block)
        self.actions.begin(session, paths)
        return {"id": session.id}

    async def _state(self, request: Request) -> Any:
        return self.actions.shown(self._session(request)) | {"upload_limit_bytes": UPLOAD_LIMIT}

    async def _forget(self, request: Request) -> Any:
        session = self.actions.sessions.get(request.path_params["id"])
        await self.actions.jobs.cancel_all(session.id)
        self.actions.sessions.forget(session)
        return {"ok": True}

    async def _events(self, request: Request) -> Response:
        stream = self.actions.events.stream(self._session(request).id)
        return StreamingResponse(stream, media_type="text/event-stream")

    async def _answers(self, request: Request) -> Any:
        """Take the answers to the questions about a file."""
        given = (await _body(request)).get("answers")
        if not isinstance(given, dict):
            raise refused(422, "there are no answers", "see docs/app.md")
        words = {str(key): str(value) for key, value in given.items() if value not in (None, "")}
        await self.actions.answer(self._session(request), words)
        return {"ok": True}

    async def _tidy(self, request: Request) -> Response:
        file = Path(self._session(request).data or "none")
        return _file(file, "application/gzip" if file.suffix == ".gz" else _CSV)

    async def _report(self, request: Request) -> Response:
        """Return the report, written anew where there is a newer result."""
        folder = self._session(request).folder
        file = folder / "report.html"
        written = file.stat().st_mtime if file.is_file() else 0.0
        if any(one.stat().st_mtime >= written for one in folder.glob("*/*.json")) or not written:
            await self.actions.jobs.run("report", {"out": str(folder)})
        return _file(file, _HTML)

    # jobs

    def _job_of(self, request: Request) -> Job:
        return self.actions.jobs.get(self._session(request).id, request.path_params["job"])

    async def _order(self, request: Request) -> Any:
        job = self.actions.order(self._session(request), await _body(request))
        return self.actions.jobs.shown(job)

    async def _job(self, request: Request) -> Any:
        return self.actions.jobs.shown(self._job_of(request))

    async def _cancel(self, request: Request) -> Any:
        job = self._job_of(request)
        await self.actions.jobs.cancel(job)
        return self.actions.jobs.shown(job)

    async def _enough(self, request: Request) -> Any:
        """End a search with its results so far."""
        job = self._job_of(request)
        await self.actions.jobs.enough(job)
        return self.actions.jobs.shown(job)

    # the model by hand

    async def _open_pad(self, request: Request) -> Any:
        session, pad = self._pad(request)
        await self.actions.open_pad(session, pad)
        return session.shown_pad(pad)

    async def _change(self, request: Request) -> Any:
        """Make a new state."""
        return await self.actions.change(*self._pad(request), await _body(request))

    async def _go_back(self, request: Request) -> Any:
        """Go back to a state of the history."""
        number = (await _body(request)).get("state")
        return await self.actions.go_back(*self._pad(request), number)

    async def _model(self, request: Request) -> Response:
        """Return force and errors of a model, its sliders, or what an effect would add to it."""
        call, body = request.path_params["call"], await _body(request)
        if call == "signature":
            arguments = {"model": body.get("model"), "effect": body.get("effect")}
        elif call == "parameters":
            arguments = {"model": body}
        elif call == "curves":
            tab = request.headers.get("x-tab")
            key = None if tab is None else f"{request.path_params['id']} {tab}"
            arguments = {"model": body, "tab": key}
        else:
            raise refused(404, f"there is no {call}")
        return await self._forwarded(request, call, **arguments)

    async def _pad_file(self, request: Request) -> Response:
        """Return the samples, the laws and effects, or command lines that do the same."""
        call = request.path_params["call"]
        if call in ("measured", "catalogue"):
            return await self._forwarded(request, call)
        if call != "repeat.sh":
            raise refused(404, f"there is no {call}")
        headers = {"content-disposition": f'attachment; filename="{call}"'}
        return Response(commands(*self._pad(request)), media_type="text/x-sh", headers=headers)

    async def _forwarded(self, request: Request, call: str, **arguments: Any) -> Response:
        answer = await self.actions.forwarded(*self._pad(request), call, **arguments)
        return Response(answer, media_type="application/json")


def _answering(do: Callable[[Request], Awaitable[Any]]) -> Callable[[Request], Awaitable[Response]]:
    """Return a handler of a route, whose answer is JSON unless it is a response already."""

    async def handle(request: Request) -> Response:
        answer = await do(request)
        return answer if isinstance(answer, Response) else JSONResponse(answer)

    return handle


async def _body(request: Request) -> dict[str, Any]:
    """Return a request's JSON; raise RefusedError where it is none."""
    try:
        content = json.loads(await request.body())
    except ValueError:
        content = None
    if not isinstance(content, dict):
        raise refused(422, "the request is no JSON object", "see docs/app.md")
    return content


def _file(file: Path, kind: str) -> Response:
    if not file.is_file():
        raise refused(404, f"there is no {file.name} yet")
    return FileResponse(
        file, filename=file.name, media_type=kind, content_disposition_type="inline"
    )


def safe_name(name: str) -> str:
    """Return a name that is one file's, wherever it came from."""
    plain = re.sub(r"[^\w. ()+-]", "_", PurePosixPath(name.replace("\\", "/")).name)
    return plain.strip(" .")[-_LONGEST:] or "upload.csv"


def _version() -> str:
    try:
        return version("qlvbayes")
    except PackageNotFoundError:
        return ""
