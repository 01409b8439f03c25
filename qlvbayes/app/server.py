"""Put the server's parts together, start and end it, and print its address."""

from __future__ import annotations

import contextlib
import socket
import sys
import webbrowser
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.formparsers import MultiPartException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from qlvbayes.app.actions import Actions
from qlvbayes.app.events import Events
from qlvbayes.app.failures import RefusedError, error_content
from qlvbayes.app.jobs import Jobs
from qlvbayes.app.routes import Routes
from qlvbayes.app.security import UPLOAD_LIMIT, Address, RequestFilter, TooLargeError
from qlvbayes.app.sessions import Sessions
from qlvbayes.app.workers import WarmWorker


@dataclass(frozen=True)
class Options:
    """Options of the server.

    ``token`` is the secret of all requests, ``sessions`` their folder. ``open`` is what to show at
    first: a file of measurements, a folder of results or a saved session. ``behind`` is the address
    of a proxy through which the server is reached.
    """

    token: str
    sessions: str
    host: str = "127.0.0.1"
    port: int = 0
    open: str | None = None
    browser: bool = True
    effects_file: str | None = None
    behind: str | None = None


_FAILURES = (RefusedError, HTTPException, TooLargeError, MultiPartException, Exception)


async def _answer(request: Request, error: Exception) -> Response:
    """Return the answer to a request that failed: its status and one plain line."""
    if isinstance(error, RefusedError):
        status, content = error.status, error.content
    elif isinstance(error, HTTPException):
        status, content = error.status_code, error_content(str(error.detail).lower())
    elif isinstance(error, TooLargeError):
        remedy = f"send less than {UPLOAD_LIMIT // 2**20} MB, or .csv.gz"
        status, content = 413, error_content("the upload is too large", remedy)
    elif isinstance(error, MultiPartException):
        status, content = 422, error_content("the upload is malformed", "send the file again")
    else:
        what = f"internal error ({type(error).__name__})"
        status, content = 500, error_content(what, "report it")
    return JSONResponse({"error": content}, status_code=status)


def application(options: Options, address: Address) -> Starlette:
    """Return the whole server; its life begins and ends the processes."""
    events = Events()
    worker = WarmWorker(lambda status: events.publish_all("worker", {"worker": status}))
    jobs = Jobs(events)
    actions = Actions(Sessions(Path(options.sessions)), worker, jobs, events, options.effects_file)

    @contextlib.asynccontextmanager
    async def life(app: Starlette) -> AsyncIterator[None]:
        worker.start()
        yield
        actions.close()
        events.close()
        await jobs.close()
        await worker.close()

    handlers = dict.fromkeys(_FAILURES, _answer)
    app = Starlette(routes=Routes(actions).all(), lifespan=life, exception_handlers=handlers)
    app.add_middleware(RequestFilter, token=options.token, address=address)
    app.state.actions = actions
    return app


def serve(options: Options) -> None:
    """Serve until interrupted; print the address, and open it in the browser if wanted."""
    try:
        Path(options.sessions).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        _stop(f"{options.sessions}: {error.strerror}; choose another folder with --sessions")
    listening = _bound(options.host, options.port)
    port = int(listening.getsockname()[1])
    address = Address.from_host(options.host, port, options.behind)
    app = application(options, address)
    name = socket.gethostname() if options.host in ("0.0.0.0", "::") else options.host
    base = options.behind or f"http://{f'[{name}]' if ':' in name else name}:{port}"
    config = uvicorn.Config(
        app, log_level="warning", access_log=False, server_header=False, proxy_headers=False,
        timeout_graceful_shutdown=1,
    )  # fmt: skip
    server = _Server(config, app, options, base.rstrip("/"))
    server.run(sockets=[listening])


class _Server(uvicorn.Server):
    """Web server that prints its address once it can be reached."""

    def __init__(self, config: uvicorn.Config, app: Starlette, options: Options, base: str) -> None:
        super().__init__(config)
        self._app, self._options, self._base = app, options, base

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start, then open what the options name, and print the address."""
        await super().startup(sockets=sockets)
        path = "/"
        if self._options.open is not None:
            path = f"/s/{self._app.state.actions.open_path(Path(self._options.open)).id}"
        url = f"{self._base}{path}?token={self._options.token}"
        print(f"the bench is at {url}\nCtrl-C ends it", flush=True)
        if self._options.browser:
            await run_in_threadpool(webbrowser.open, url)

    def handle_exit(self, sig: int, frame: Any) -> None:
        """End streams of events and waiting calls first, as none would end by itself."""
        self._app.state.actions.events.close()
        self._app.state.actions.worker.give_up()
        super().handle_exit(sig, frame)


def _bound(host: str, port: int) -> socket.socket:
    """Return a socket that listens; print one plain line where it cannot."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
    except OSError as error:
        reason = error.strerror or str(error)
        _stop(f"cannot listen at {host} port {port} ({reason}); choose another --host or --port")
    return listening


def _stop(text: str) -> NoReturn:
    """Print one plain line and exit with status 2, as every command does."""
    print(f"qlvbayes: {text}", file=sys.stderr)
    raise SystemExit(2)
