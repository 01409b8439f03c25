"""Answer the routes of the bench, which docs/app.md lists."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Awaitable, Callable
from pathlib import Path, PurePosixPath
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import UploadFile
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from qlvbayes import __version__
from qlvbayes.app.actions import BUNDLED, Actions
from qlvbayes.app.failures import refused
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
        """Return all routes, each with its method, path and what answers it."""
        do, jobs, job = self.actions, "/api/s/{id}/jobs", "/api/s/{id}/jobs/{job}"
        pad = "/api/s/{id}/pads/{pad}"
        table: list[tuple[str, str, Callable[..., Any]]] = [
            ("GET", "/", self._page),
            ("GET", "/s/{id}", self._page),
            ("GET", "/static/{name}", self._static),
            ("GET", "/api/start", self._start),
            ("POST", "/api/sessions", do.open_bundled),
            ("POST", "/api/upload", self._upload),
            ("GET", "/api/s/{id}", lambda session: do.shown(session) | _LIMIT),
            ("DELETE", "/api/s/{id}", self._forget),
            ("GET", "/api/s/{id}/events", self._events),
            ("POST", "/api/s/{id}/answers", do.answer),
            ("GET", "/api/s/{id}/tidy.csv", self._tidy),
            ("GET", "/api/s/{id}/report.html", self._report),
            ("POST", jobs, do.order),
            ("GET", job, do.jobs.shown),
            ("DELETE", job, do.jobs.cancel),
            ("POST", f"{job}/enough", do.jobs.enough),
            ("POST", f"{pad}/open", do.open_pad),
            ("POST", f"{pad}/states", do.change),
            ("POST", f"{pad}/current", do.go_back),
            ("GET", f"{pad}/{{call:str}}", self._pad_file),
            ("POST", f"{pad}/{{call:str}}", self._model),
        ]
        return [Route(path, self._answering(do), methods=[method]) for method, path, do in table]

    def _answering(self, do: Callable[..., Any]) -> Callable[[Request], Awaitable[Response]]:
        """Return a handler that calls a function with those parts of a request that it names."""

        async def handle(request: Request) -> Response:
            given: dict[str, Any] = {}
            for name in inspect.signature(do).parameters:
                if name == "request":
                    given[name] = request
                elif name == "session":
                    given[name] = self._session(request)
                elif name == "job":
                    session = self._session(request)
                    given[name] = self.actions.jobs.get(session.id, request.path_params["job"])
                elif name == "body":
                    given[name] = await _body(request)
                else:
                    given[name] = request.path_params[name]
            answer = do(**given)
            if inspect.isawaitable(answer):
                answer = await answer
            return answer if isinstance(answer, Response) else JSONResponse(answer)

        return handle

    def _session(self, request: Request) -> Session:
        session = self.actions.sessions.get(request.path_params["id"])
        if session.stage == "closed":
            self.actions.resume(session)
        return session

    def _page(self) -> Response:
        return FileResponse(_PAGE / "index.html", media_type=_HTML)

    def _static(self, name: str) -> Response:
        """Return a static file of the page or of the report."""
        for folder in (_PAGE, _REPORT):
            file = folder / name
            if file.parent == folder and file.is_file():
                return FileResponse(file)
        raise refused(404, f"there is no file {name}")

    def _start(self) -> Any:
        """Return what the first page shows."""
        known = {name: text for name, text in BUNDLED.items() if bundled(f"{name}.csv").is_file()}
        return _LIMIT | {
            "version": __version__,
            "bundled": [{"name": name, "text": text} for name, text in known.items()],
            "sessions": self.actions.sessions.known(),
        }

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

    async def _forget(self, request: Request) -> Any:
        session = self.actions.sessions.get(request.path_params["id"])  # which stays closed
        await self.actions.jobs.cancel_all(session.id)
        self.actions.sessions.forget(session)
        return {"ok": True}

    def _events(self, session: Session) -> Response:
        stream = self.actions.events.stream(session.id)
        return StreamingResponse(stream, media_type="text/event-stream")

    def _tidy(self, session: Session) -> Response:
        file = Path(session.data or "none")
        return _file(file, "application/gzip" if file.suffix == ".gz" else _CSV)

    async def _report(self, session: Session) -> Response:
        """Return the report, written anew where there is a newer result."""
        folder, file = session.folder, session.folder / "report.html"
        written = file.stat().st_mtime if file.is_file() else 0.0
        if any(one.stat().st_mtime >= written for one in folder.glob("*/*.json")) or not written:
            await self.actions.jobs.run("report", {"out": str(folder)})
        return _file(file, _HTML)

    async def _model(
        self, request: Request, session: Session, pad: str, call: str, body: dict[str, Any]
    ) -> Response:
        """Return force and errors of a model, its sliders, or what an effect would add to it."""
        arguments: dict[str, Any] = {"model": body}
        if call == "signature":
            arguments = {"model": body.get("model"), "effect": body.get("effect")}
        elif call == "curves" and (tab := request.headers.get("x-tab")) is not None:
            arguments["tab"] = f"{session.id} {tab}"
        elif call not in ("curves", "parameters"):
            raise refused(404, f"there is no {call}")
        return await self._forwarded(session, pad, call, **arguments)

    async def _pad_file(self, session: Session, pad: str, call: str) -> Response:
        """Return the samples, the laws and effects, or command lines that do the same."""
        if call in ("measured", "catalogue"):
            return await self._forwarded(session, pad, call)
        if call != "repeat.sh":
            raise refused(404, f"there is no {call}")
        headers = {"content-disposition": f'attachment; filename="{call}"'}
        return Response(commands(session, pad), media_type="text/x-sh", headers=headers)

    async def _forwarded(self, session: Session, pad: str, call: str, **arguments: Any) -> Response:
        answer = await self.actions.forwarded(session, pad, call, **arguments)
        return Response(answer, media_type="application/json")


_LIMIT = {"upload_limit_bytes": UPLOAD_LIMIT}


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
