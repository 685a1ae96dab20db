"""The server of the room, on this machine alone, and the verb that opens it in a browser."""

from __future__ import annotations

import asyncio
import contextlib
import html
import json
import math
import mimetypes
import os
import secrets
import socket
import sys
import threading
import time
import webbrowser
from collections.abc import AsyncIterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from struck.core.build import LIBRARIES
from struck.errors import MissingDependencyError, OptionError, StruckError, require_choice
from struck.excitation.hertz import strikers
from struck.explorer.facts import change
from struck.explorer.jobs import PAGE_ENDING, Jobs
from struck.explorer.objects import Thing, things
from struck.explorer.page_files import HEAD_MAKERS, head_bytes
from struck.explorer.placement import stand
from struck.explorer.private_folder import PrivateFolder
from struck.files.atomic import write_bytes
from struck.model.arrays import checked
from struck.model.material import materials
from struck.model.model import ModalModel
from struck.processes.termination import orderly_end

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import FileResponse, Response
    from starlette.types import ASGIApp

STATIC = Path(__file__).parent / "static"
_BY_HAND = "open it in a browser"
_END_SECONDS = 30.0  # s that an end may take: heads that are being made are waited for
_QUEUE = 4096  # connections that wait to be accepted; the system may allow less
MAX_STREAMS = 16  # of events, one for each page; chosen by judgement
# Sample rates of audio devices, Hz, which are those of an AudioContext.
_HEAD_RATES = (
    *("8000", "11025", "16000", "22050", "24000", "32000", "44100", "48000"),
    *("88200", "96000", "176400", "192000"),
)
_PART_BYTES = 2**20  # of a file that is sent: in parts of 2**16 a head took 20 s under attack
_PREPARED_RATES = ("48000", "44100")  # so that the first click need not wait


class Explorer:
    """A room of objects that is served to a browser.

    Parameters
    ----------
    objects : sequence of Thing, default ()
        Objects that are computed for the room.
    given : sequence of ModalModel, default ()
        Models that are in the room from the start, instead of these.
    names : sequence of str, default ()
        Titles of the models.
    port : int, default 0
        Port of this machine; 0 for a free one.

    Raises
    ------
    MissingDependencyError
        If starlette or uvicorn is not installed.
    OptionError
        If the port is in use or out of range.
    """

    def __init__(
        self,
        objects: Sequence[Thing] = (),
        *,
        given: Sequence[ModalModel] = (),
        names: Sequence[str] = (),
        port: int = 0,
    ) -> None:
        _require_libraries()
        self._socket = _listening(port)
        self.port: int = self._socket.getsockname()[1]
        self._token = secrets.token_urlsafe(24)
        try:
            self._folder = PrivateFolder()
        except OSError as error:
            self._socket.close()
            raise OptionError(
                f"no temporary folder can be made ({error.strerror or error}): free some space, or "
                "name another in TMPDIR"
            ) from error
        self._jobs = Jobs(objects, self._folder.path)
        try:
            for thing, model in zip(stand(given, names), given, strict=True):
                self._jobs.give(thing, model)
        except BaseException:
            self._socket.close()
            self._folder.remove()
            raise
        self._stopping = asyncio.Event()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._running, self._ended = threading.Event(), threading.Event()
        self._server: Any = None
        self._thread = threading.Thread(target=self._serve, name="struck explorer", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """The address to open, once a browser: the token in it lets that browser in."""
        return f"http://127.0.0.1:{self.port}/?token={self._token}"

    def wait(self, seconds: float | None = None) -> None:
        """Serve until Ctrl-C or `stop`, then end.

        SIGTERM, and SIGHUP of a terminal that is closed, end the process once the room is closed,
        unless the program handles or ignores them itself.

        Parameters
        ----------
        seconds : float, optional
            Maximum duration, s. Default: unlimited.
        """
        end = math.inf if seconds is None else time.monotonic() + seconds
        with orderly_end():
            with contextlib.suppress(KeyboardInterrupt):
                # Ctrl-C amid a thread's `join` lets Python 3.11 take the thread for ended.
                while (left := end - time.monotonic()) > 0 and not self._ended.wait(min(0.5, left)):
                    pass
            self.stop()

    def open_in_browser(self) -> bool:
        """Open the room in the browser of the user.

        The command line of a browser can be read by every user of the machine: so it names a file
        that this user alone can read, which leads to the address with the token.

        Returns
        -------
        bool
            Whether a browser could be started.

        Raises
        ------
        OptionError
            If the room is closed.
        """
        if self._ended.is_set():
            raise OptionError("the room is closed: open another by struck.explore")
        address = html.escape(self.url)
        page = self._folder.write_private(
            "open.html",
            '<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>struck</title>'
            f'<meta http-equiv="refresh" content="0;url={address}"></head>'
            f'<body><a href="{address}">Open the room</a></body></html>\n',
        )
        return webbrowser.open(page.as_uri())

    def stop(self) -> None:
        """End the server and all that still computes."""
        if self._running.wait(_END_SECONDS) and self._loop is not None:
            with contextlib.suppress(RuntimeError):  # it has ended already
                self._loop.call_soon_threadsafe(self._stopping.set)
            self._ended.wait(_END_SECONDS)
            self._thread.join(0.5)
        self._socket.close()
        self._folder.remove()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.stop()

    def _serve(self) -> None:
        try:
            asyncio.run(self._serve_until_stop())
        finally:
            self._running.set()
            self._ended.set()

    async def _serve_until_stop(self) -> None:
        from struck.explorer.connections import Server

        self._loop = asyncio.get_running_loop()
        self._running.set()
        # One thread: several heads at a time would hold up the changes of objects.
        heads = ThreadPoolExecutor(1, "struck heads")
        app = application(
            self._jobs, heads, port=self.port, token=self._token, ending=self._stopping
        )
        self._server = Server(app, self._socket)
        work = asyncio.create_task(self._jobs.run())
        ending = asyncio.create_task(self._end())
        serving = self._server._serve(sockets=[])  # noqa: SLF001 - Ctrl-C is ours
        try:
            await serving
        finally:
            self._stopping.set()
            for task in (work, ending):
                task.cancel()
            await asyncio.gather(work, ending, return_exceptions=True)
            heads.shutdown(cancel_futures=True)

    async def _end(self) -> None:
        await self._stopping.wait()
        self._server.should_exit = True


@checked
def explore(
    model: ModalModel | Sequence[ModalModel] | None = None,
    *,
    names: Sequence[str] | None = None,
    objects: Sequence[str] | None = None,
    port: int = 0,
    browser: bool = True,
    wait: bool = True,
) -> Explorer:
    """Show bodies in a browser, where a click strikes them.

    Parameters
    ----------
    model : ModalModel or sequence of ModalModel, optional
        Default: eighteen demonstration objects, which are computed in the background.
    names : sequence of str, optional
        Titles of the models. Default: "Body 1" and so on.
    objects : sequence of str, optional
        Names of the demonstration objects to compute, such as "string" or "bell". Default: all.
    port : int, default 0
        Port on 127.0.0.1; 0 selects a free one.
    browser : bool, default True
        Open a browser, if there is a display.
    wait : bool, default True
        Serve until Ctrl-C. Otherwise return, and serve until `Explorer.stop` is called.

    Returns
    -------
    Explorer
        The server, with its `url` and `stop`. It may be used in a ``with`` statement.

    Raises
    ------
    MissingDependencyError
        If starlette or uvicorn is not installed.
    OptionError
        If the port is in use or out of range, or the names do not match the models.
    FileFormatError
        If the gains of a model cannot be saved.

    Examples
    --------
    >>> bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005, ends="free")
    >>> model = struck.analyze(bar, "steel", progress=None)
    >>> with struck.explore(model, names=["bar"], browser=False, wait=False) as room:
    ...     room.url.startswith("http://127.0.0.1:")
    True
    """
    models = [model] if isinstance(model, ModalModel) else list(model or ())
    chosen = list(names or (f"Body {number + 1}" for number in range(len(models))))
    if models and objects is not None:
        raise OptionError("there are models, and objects of the room too: leave one of them out")
    if len(chosen) != len(models):
        raise OptionError(f"there are {len(chosen)} names for {len(models)} models: give as many")
    room_objects = [] if models else _chosen(objects)
    with orderly_end():
        explorer = Explorer(room_objects, given=models, names=chosen, port=port)
        try:
            is_shown = browser and has_display() and explorer.open_in_browser()
            instruction = (
                "opened in the browser (if not, open this address)" if is_shown else _BY_HAND
            )
            sys.stderr.write(f"{explorer.url}\n{instruction}; Ctrl-C ends it\n")
            sys.stderr.flush()
            if wait:
                explorer.wait()
        except BaseException:
            explorer.stop()
            raise
    return explorer


def _chosen(names: Sequence[str] | None) -> list[Thing]:
    """Return objects of the room by their names, in the order of their computation."""
    room = things()
    if names is None:
        return room
    if not names:
        raise OptionError("objects is empty: give names of objects, or leave it out for all")
    for name in names:
        require_choice("objects", name, [thing.name for thing in room])
    return [thing for thing in room if thing.name in names]


def has_display() -> bool:
    """Return whether there is a screen on which a browser could open."""
    if sys.platform in {"win32", "darwin"}:
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _require_libraries() -> None:
    try:
        import starlette
        import uvicorn
    except ImportError as error:
        raise MissingDependencyError(
            f"the explorer needs {error.name}, which is not installed: "
            "pip install 'struck[explorer]'"
        ) from error
    del starlette, uvicorn


def _listening(port: int) -> socket.socket:
    """Return a socket of this machine alone; OptionError when its port is taken."""
    if not 0 <= port <= 65_535:
        raise OptionError(f"the port is {port}: give one from 1 to 65535, or 0 for a free one")
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if sys.platform != "win32":
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind(("127.0.0.1", port))
        listening.listen(_QUEUE)
    except OSError as error:
        listening.close()
        reason = error.strerror or error
        raise OptionError(
            f"port {port} cannot be had ({reason}): give another, or none for a free one"
        ) from error
    return listening


# The application


def application(
    jobs: Jobs, heads: Executor, *, port: int, token: str, ending: asyncio.Event
) -> Starlette:
    """Return the pages, models and changes as an ASGI application behind its guard.

    Tables of heads are made in `heads`, whose one thread makes each once.
    """
    from starlette.applications import Starlette
    from starlette.middleware import Middleware
    from starlette.routing import Mount, Route
    from starlette.staticfiles import StaticFiles

    from struck.explorer.admission import Admission, headers

    for ending_of_name, kind in ((".js", "text/javascript"), (".wasm", "application/wasm")):
        mimetypes.add_type(kind, ending_of_name)  # which a system's own table may lack
    answers = _Answers(jobs, heads, ending)
    routes = [
        Route("/", answers.page),
        Route("/static/core.wasm", answers.core),
        Route("/static/heads/{name}-{rate}.bin", answers.head),
        Mount("/static", StaticFiles(directory=STATIC)),
        Route("/api/room", answers.room),
        Route("/api/events", answers.events),
        Route("/models/{name}.struck", answers.model),
        Route("/api/models/{name}/change", answers.change, methods=["POST"]),
        Route("/api/models/{name}/drive", answers.drive, methods=["POST"]),
    ]
    guard = Middleware(Admission, port=port, token=token, sent=headers(STATIC / "index.html"))
    return Starlette(routes=routes, middleware=[guard])


class _Answers:
    """Answers to requests, one method an address."""

    def __init__(self, jobs: Jobs, heads: Executor, ending: asyncio.Event) -> None:
        self._jobs = jobs
        self._heads = heads
        self._ending = ending
        self._is_prepared = False
        self._stream_count = 0

    async def page(self, _request: Request) -> Response:
        from starlette.responses import HTMLResponse

        if not self._is_prepared:
            self._is_prepared = True
            for rate in _PREPARED_RATES:
                self._heads.submit(_write_head, self._jobs.folder, "kemar", rate)
        return HTMLResponse((STATIC / "index.html").read_bytes())

    async def core(self, _request: Request) -> Response:
        path = LIBRARIES / "core.wasm"
        if not path.is_file():
            return _refusal("this struck was installed without core.wasm: install it again", 404)
        return _file(path, "application/wasm")

    async def head(self, request: Request) -> Response:
        name, rate = request.path_params["name"], request.path_params["rate"]
        try:
            require_choice("head", name, HEAD_MAKERS)
            require_choice("sample_rate", rate, _HEAD_RATES)
        except OptionError as error:
            return _refusal(str(error), 404)
        loop = asyncio.get_running_loop()
        path = await loop.run_in_executor(self._heads, _write_head, self._jobs.folder, name, rate)
        return _file(path)

    async def room(self, _request: Request) -> Response:
        from starlette.responses import JSONResponse

        groups = {name: entry["group"] for name, entry in materials().items()}
        states = [job.json_values() for job in self._jobs.jobs.values()]
        heads = {name: dict(entry) for name, entry in strikers().items()}
        return JSONResponse({"objects": states, "strikers": heads, "materials": groups})

    async def events(self, _request: Request) -> ASGIApp:
        return self._stream_events

    async def _stream_events(self, *channel: Any) -> None:  # noqa: ANN401 - of ASGI
        """Answer with the news of objects, or refuse one stream too many."""
        from starlette.responses import StreamingResponse

        if self._stream_count >= MAX_STREAMS:
            message = f"{MAX_STREAMS} pages show this room: close one of them"
            refusal = _refusal(message, 429)
            refusal.headers["connection"] = "close"  # else idle ones use up the connections
            await refusal(*channel)
            return
        self._stream_count += 1
        try:
            response = StreamingResponse(self._news(), media_type="text/event-stream")
            await response(*channel)
        finally:
            self._stream_count -= 1

    async def _news(self) -> AsyncIterator[str]:
        """Yield objects as they change, until the server ends."""
        news = self._jobs.news()
        end_task = asyncio.ensure_future(self._ending.wait())
        try:
            while not end_task.done():
                one = asyncio.ensure_future(anext(news))
                await asyncio.wait({one, end_task}, return_when=asyncio.FIRST_COMPLETED)
                if one.done():
                    yield f"data: {json.dumps(one.result())}\n\n"
                else:
                    one.cancel()
        finally:
            end_task.cancel()

    async def model(self, request: Request) -> Response:
        job = self._jobs.jobs.get(request.path_params["name"])
        if job is None or job.state != "ready":
            return _refusal("there is no such model, or not yet: wait until it is ready", 404)
        return _file(job.path.with_suffix(PAGE_ENDING))

    async def change(self, request: Request) -> Response:
        return await self._answer_with(request, change)

    async def drive(self, request: Request) -> Response:
        return await self._answer_with(request, _drive)

    async def _answer_with(self, request: Request, work: Any) -> Response:  # noqa: ANN401 - of a model
        """Answer with the result of a function of a model and of the JSON in the request."""
        from starlette.responses import JSONResponse

        name = request.path_params["name"]
        job = self._jobs.jobs.get(name)
        if job is None or job.state != "ready":
            return _refusal("there is no such model, or not yet: wait until it is ready", 404)
        try:
            values = json.loads(await request.body())
        except (ValueError, RecursionError):
            values = None
        if not isinstance(values, dict):
            return _refusal("what was sent is no JSON object", 400)
        try:
            return JSONResponse(
                await asyncio.to_thread(lambda: work(self._jobs.model(name), values))
            )
        except StruckError as error:
            return _refusal(str(error), 400)


def _write_head(folder: Path, name: str, rate: str) -> Path:
    """Return the file of a head's tables, which the first request for it writes."""
    path = folder / f"{name}-{rate}.head"
    if not path.is_file():
        write_bytes(path, head_bytes(name, int(rate)))
    return path


def _drive(model: ModalModel, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the drive of a contact, as JSON values."""
    contact = model.contact(values.get("point"), values.get("direction"))
    drive = model.gains.at(contact.point[None], contact.direction[None])[0, 0]
    return {
        "drive": drive.tolist(),
        "point": contact.point.tolist(),
        "direction": contact.direction.tolist(),
    }


def _file(path: Path, kind: str = "application/octet-stream") -> FileResponse:
    """Return a file as an answer, in few parts, as each takes its turn with other requests."""
    from starlette.responses import FileResponse

    answer = FileResponse(path, media_type=kind)
    answer.chunk_size = _PART_BYTES
    return answer


def _refusal(message: str, status: int) -> Response:
    from starlette.responses import JSONResponse

    return JSONResponse({"message": message}, status)
