"""Answer the routes of the bench, which docs/app.md lists."""

from __future__ import annotations

import io
import json
import re
import zipfile
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path, PurePosixPath
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import UploadFile
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from qlvbayes.app.actions import Actions
from qlvbayes.app.failures import refused
from qlvbayes.app.scripts import commands, script
from qlvbayes.app.security import UPLOAD_LIMIT
from qlvbayes.app.sessions import Session

_PAGE = Path(__file__).parent / "page"
_REPORT = Path(__file__).parents[1] / "report" / "static"
_MOST_FILES = 50  # files of an upload
_LONGEST = 100  # characters of an uploaded file's name that are kept
_FIGURES = (".png", ".pdf")
_TYPES = {
    ".png": "image/png",
    ".pdf": "application/pdf",
    ".html": "text/html; charset=utf-8",
    ".csv": "text/csv; charset=utf-8",
    ".gz": "application/gzip",
}


class Routes:
    """Routes of the server, with the answers to their requests; all state is in ``actions``."""

    def __init__(self, actions: Actions) -> None:
        self.actions = actions

    def all(self) -> list[Route]:
        """Return all routes, each with its method, path and handler."""
        table: list[tuple[str, str, Callable[..., Any]]] = [
            ("GET", "/", self.page),
            ("GET", "/s/{id}", self.page),
            ("GET", "/static/{name}", self.static),
            ("GET", "/api/start", self.start),
            ("POST", "/api/sessions", self.open),
            ("POST", "/api/upload", self.upload),
            ("GET", "/api/s/{id}", self.state),
            ("DELETE", "/api/s/{id}", self.forget),
            ("GET", "/api/s/{id}/events", self.events),
            ("POST", "/api/s/{id}/answers", self.answers),
            ("POST", "/api/s/{id}/specimens", self.specimens),
            ("GET", "/api/s/{id}/tidy.csv", self.tidy),
            ("POST", "/api/s/{id}/guess", self.guess),
            ("POST", "/api/s/{id}/jobs", self.order),
            ("GET", "/api/s/{id}/jobs/{job}", self.job),
            ("DELETE", "/api/s/{id}/jobs/{job}", self.cancel),
            ("POST", "/api/s/{id}/jobs/{job}/enough", self.enough),
            ("GET", "/api/s/{id}/comparison", self.comparison),
            ("GET", "/api/s/{id}/session.zip", self.saved),
            ("GET", "/api/s/{id}/report.html", self.report),
            ("GET", "/api/s/{id}/figures", self.figures),
            ("POST", "/api/s/{id}/pads/{pad}/open", self.open_pad),
            ("GET", "/api/s/{id}/pads/{pad}/measured", self.measured),
            ("GET", "/api/s/{id}/pads/{pad}/catalogue", self.catalogue),
            ("POST", "/api/s/{id}/pads/{pad}/parameters", self.parameters),
            ("POST", "/api/s/{id}/pads/{pad}/curves", self.curves),
            ("POST", "/api/s/{id}/pads/{pad}/signature", self.signature),
            ("POST", "/api/s/{id}/pads/{pad}/states", self.change),
            ("POST", "/api/s/{id}/pads/{pad}/current", self.go_back),
            ("GET", "/api/s/{id}/pads/{pad}/figures/{name}", self.figure),
            ("GET", "/api/s/{id}/pads/{pad}/residuals.csv", self.residuals),
            ("GET", "/api/s/{id}/pads/{pad}/constants.csv", self.constants),
            ("GET", "/api/s/{id}/pads/{pad}/repeat", self.repeat),
            ("GET", "/api/s/{id}/pads/{pad}/repeat.py", self.repeat_script),
            ("GET", "/api/s/{id}/pads/{pad}/repeat.sh", self.repeat_commands),
        ]
        return [Route(path, answer, methods=[method]) for method, path, answer in table]

    def _session(self, request: Request) -> Session:
        session = self.actions.sessions.get(request.path_params["id"])
        if session.stage == "closed":
            self.actions.resume(session)
        return session

    # page and files

    async def page(self, request: Request) -> Response:
        """Return the one page."""
        return FileResponse(_PAGE / "index.html", media_type="text/html; charset=utf-8")

    async def static(self, request: Request) -> Response:
        """Return a static file of the page or of the report."""
        name = request.path_params["name"]
        for folder in (_PAGE, _REPORT):
            file = folder / name
            if file.parent == folder and file.is_file():
                return FileResponse(file)
        raise refused(404, f"there is no file {name}")

    # sessions

    async def start(self, request: Request) -> Response:
        """Return what the first page shows."""
        return JSONResponse(
            {
                "version": _version(),
                "worker": self.actions.calls.status,
                "bundled": self.actions.bundled(),
                "sessions": self.actions.sessions.known(),
                "upload_limit_bytes": UPLOAD_LIMIT,
            }
        )

    async def open(self, request: Request) -> Response:
        """Open a session with measurements that come with the package."""
        body = await _body(request)
        name = body.get("open")
        if name == "deal":
            session = self.actions.open_simulated()
        else:
            session = self.actions.open_bundled(str(name), guess=bool(body.get("guess")))
        return JSONResponse({"id": session.id})

    async def upload(self, request: Request) -> Response:
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
        return JSONResponse({"id": session.id})

    async def state(self, request: Request) -> Response:
        """Return the whole state of a session."""
        shown = self.actions.shown(self._session(request))
        return JSONResponse(shown | {"upload_limit_bytes": UPLOAD_LIMIT})

    async def forget(self, request: Request) -> Response:
        """Remove a session."""
        session = self.actions.sessions.get(request.path_params["id"])
        await self.actions.jobs.cancel_all(session.id)
        self.actions.sessions.forget(session)
        return JSONResponse({"ok": True})

    async def events(self, request: Request) -> Response:
        """Return the stream of a session's events."""
        session = self._session(request)
        stream = self.actions.events.stream(session.id)
        return StreamingResponse(stream, media_type="text/event-stream")

    async def answers(self, request: Request) -> Response:
        """Take the answers to the questions about a file."""
        given = (await _body(request)).get("answers")
        if not isinstance(given, dict):
            raise refused(422, "there are no answers", "see docs/app.md")
        words = {str(key): str(value) for key, value in given.items() if value not in (None, "")}
        await self.actions.answer(self._session(request), words)
        return JSONResponse({"ok": True})

    async def specimens(self, request: Request) -> Response:
        """Return the pads that a pattern finds in the tests' names."""
        pattern = (await _body(request)).get("pad_from")
        if not isinstance(pattern, str):
            raise refused(422, "no pattern is given", "see docs/app.md")
        return JSONResponse(await self.actions.specimens(self._session(request), pattern))

    async def tidy(self, request: Request) -> Response:
        """Return the measurements."""
        session = self._session(request)
        return _download(Path(session.data or "none"), Path(session.data).name or "data.csv")

    async def guess(self, request: Request) -> Response:
        """Record a guess."""
        body = await _body(request)
        effects, words = body.get("effects", []), body.get("words", "")
        if not (isinstance(effects, list) and isinstance(words, str)):
            raise refused(422, "this is no guess", "see docs/app.md")
        session = self._session(request)
        return JSONResponse(
            {"guess": self.actions.guess(session, [str(x) for x in effects], words)}
        )

    # jobs

    async def order(self, request: Request) -> Response:
        """Start a job."""
        session = self._session(request)
        job = self.actions.order(session, await _body(request))
        return JSONResponse(self.actions.jobs.shown(job))

    async def job(self, request: Request) -> Response:
        """Return the progress of a job."""
        session = self._session(request)
        job = self.actions.jobs.get(session.id, request.path_params["job"])
        return JSONResponse(self.actions.jobs.shown(job))

    async def cancel(self, request: Request) -> Response:
        """Cancel or remove a job."""
        session = self._session(request)
        job = self.actions.jobs.get(session.id, request.path_params["job"])
        await self.actions.jobs.cancel(job)
        return JSONResponse(self.actions.jobs.shown(job))

    async def enough(self, request: Request) -> Response:
        """End a search with its results so far."""
        session = self._session(request)
        job = self.actions.jobs.get(session.id, request.path_params["job"])
        await self.actions.jobs.enough(job)
        return JSONResponse(self.actions.jobs.shown(job))

    # the model by hand

    async def open_pad(self, request: Request) -> Response:
        """Open a pad."""
        session, pad = self._session(request), request.path_params["pad"]
        await self.actions.open_pad(session, pad)
        return JSONResponse(session.shown()["pad"][pad])

    async def measured(self, request: Request) -> Response:
        """Return the samples."""
        return await self._forwarded(request, "measured")

    async def catalogue(self, request: Request) -> Response:
        """Return the laws and effects."""
        return await self._forwarded(request, "catalogue")

    async def parameters(self, request: Request) -> Response:
        """Return the sliders of a model."""
        return await self._forwarded(request, "parameters", model=await _body(request))

    async def curves(self, request: Request) -> Response:
        """Return a model's force and errors."""
        tab = request.headers.get("x-tab")
        key = None if tab is None else f"{request.path_params['id']} {tab}"
        return await self._forwarded(request, "curves", model=await _body(request), tab=key)

    async def signature(self, request: Request) -> Response:
        """Return what an effect would add to a model."""
        body = await _body(request)
        model, effect = body.get("model"), body.get("effect")
        if not (isinstance(model, dict) and isinstance(effect, str)):
            raise refused(422, "no effect in addition to a model is named", "see docs/app.md")
        return await self._forwarded(request, "signature", model=model, effect=effect)

    async def change(self, request: Request) -> Response:
        """Make a new state."""
        session, pad = self._session(request), request.path_params["pad"]
        return JSONResponse(await self.actions.change(session, pad, await _body(request)))

    async def go_back(self, request: Request) -> Response:
        """Go back to a state of the history."""
        session, pad = self._session(request), request.path_params["pad"]
        number = (await _body(request)).get("state")
        if not isinstance(number, int):
            raise refused(422, "no state is named", "see docs/app.md")
        return JSONResponse(await self.actions.go_back(session, pad, number))

    async def _forwarded(self, request: Request, call: str, **arguments: Any) -> Response:
        session, pad = self._session(request), request.path_params["pad"]
        answer = await self.actions.forwarded(session, pad, call, **arguments)
        return Response(answer, media_type="application/json")

    # data out

    async def comparison(self, request: Request) -> Response:
        """Return the results of the comparisons."""
        files = sorted(self._session(request).folder.glob("compare/*/compare.json"))
        results = [json.loads(file.read_text()) for file in files]
        return JSONResponse({"comparisons": results})

    async def saved(self, request: Request) -> Response:
        """Return the session as one file."""
        session = self._session(request)
        session.save()
        content = await run_in_threadpool(_zipped, session.folder)
        name = f"{Path(session.name).stem or 'session'}.zip"
        return _attached(content, name, "application/zip")

    async def report(self, request: Request) -> Response:
        """Return the report, written anew where there is a newer result."""
        session = self._session(request)
        if session.is_hiding:
            raise refused(409, "a guess is owed first", "write down what you think is missing")
        file = session.folder / "report.html"
        if _older(file, session.folder):
            await self.actions.jobs.run({"kind": "report", "out": str(session.folder)})
        return _download(file, "report.html")

    async def figures(self, request: Request) -> Response:
        """Return the list of figures."""
        session = self._session(request)
        formats_of: dict[tuple[str, str], list[str]] = {}
        for pad in ("-", *session.pads):
            for file in sorted(_folder_of(session, pad).glob("*.*")):
                if file.suffix in _FIGURES:
                    formats_of.setdefault((pad, file.stem), []).append(file.suffix[1:])
        entries = [
            {"pad": pad, "name": name, "formats": sorted(formats, reverse=True)}
            for (pad, name), formats in formats_of.items()
        ]
        return JSONResponse({"figures": entries})

    async def figure(self, request: Request) -> Response:
        """Return one figure."""
        session, name = self._session(request), request.path_params["name"]
        folder = _folder_of(session, request.path_params["pad"])
        file = folder / name
        if file.parent != folder or file.suffix not in _FIGURES:
            raise refused(404, f"there is no figure {name}")
        return _download(file, name, attached=file.suffix == ".pdf")

    async def residuals(self, request: Request) -> Response:
        """Return the residuals as CSV."""
        return await self._table(request, "residuals")

    async def constants(self, request: Request) -> Response:
        """Return the constants as CSV."""
        return await self._table(request, "constants")

    async def _table(self, request: Request, call: str) -> Response:
        session, pad = self._session(request), request.path_params["pad"]
        own = session.pad(pad)
        number = request.query_params.get("state", "")
        state = own.state(int(number) if number.isdecimal() else own.current)
        more = {"begun": state.begun} if call == "constants" else {}
        raw = await self.actions.forwarded(session, pad, call, model=state.model, **more)
        return _attached(json.loads(raw).encode(), f"{pad}_{call}.csv", _TYPES[".csv"])

    async def repeat(self, request: Request) -> Response:
        """Return script and command lines, to be shown."""
        session, pad = self._session(request), request.path_params["pad"]
        python, lines = script(session, pad), commands(session, pad)
        return JSONResponse({"python": python, "commands": lines})

    async def repeat_script(self, request: Request) -> Response:
        """Return the script."""
        session, pad = self._session(request), request.path_params["pad"]
        return _attached(script(session, pad).encode(), "repeat.py", "text/x-python")

    async def repeat_commands(self, request: Request) -> Response:
        """Return the command lines."""
        session, pad = self._session(request), request.path_params["pad"]
        return _attached(commands(session, pad).encode(), "repeat.sh", "text/x-sh")


def _older(report: Path, folder: Path) -> bool:
    """Return whether a result is newer than the report, or there is no report."""
    if not report.is_file():
        return True
    results = [*folder.glob("*/*.json"), *folder.glob("compare/*/*.json")]
    return any(one.stat().st_mtime > report.stat().st_mtime for one in results)


def _folder_of(session: Session, pad: str) -> Path:
    """Return the folder of a pad, or with ``-`` that of all pads."""
    if pad == "-":
        return session.folder
    if pad not in session.pads:
        raise refused(404, f"there is no pad {pad!r}")
    return session.folder / pad


async def _body(request: Request) -> dict[str, Any]:
    """Return a request's JSON; raise RefusedError where it is none."""
    try:
        content = json.loads(await request.body())
    except ValueError:
        content = None
    if not isinstance(content, dict):
        raise refused(422, "the request is no JSON object", "see docs/app.md")
    return content


def _download(file: Path, name: str, *, attached: bool = False) -> Response:
    if not file.is_file():
        raise refused(404, f"there is no {name} yet")
    kind = "attachment" if attached else "inline"
    return FileResponse(
        file, filename=name, media_type=_TYPES.get(file.suffix), content_disposition_type=kind
    )


def _attached(content: bytes, name: str, kind: str) -> Response:
    plain = "".join(c if c.isascii() and (c.isalnum() or c in "._-") else "_" for c in name)
    return Response(
        content, media_type=kind, headers={"content-disposition": f'attachment; filename="{plain}"'}
    )


def _zipped(folder: Path) -> bytes:
    """Return a folder's files as a zip, without chains and files that are being written."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(folder.rglob("*")):
            name = file.relative_to(folder)
            if file.is_file() and file.suffix != ".part" and "chain" not in name.parts:
                archive.write(file, name.as_posix())
    return out.getvalue()


def safe_name(name: str) -> str:
    """Return a name that is one file's, wherever it came from."""
    plain = re.sub(r"[^\w. ()+-]", "_", PurePosixPath(name.replace("\\", "/")).name)
    return plain.strip(" .")[-_LONGEST:] or "upload.csv"


def _version() -> str:
    try:
        return version("qlvbayes")
    except PackageNotFoundError:
        return ""
