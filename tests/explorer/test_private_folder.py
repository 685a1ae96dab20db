"""The folder of a room: private, gone at the end, and swept where a process was killed."""

from __future__ import annotations

import os
import re
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import struck
from struck.explorer.private_folder import PrivateFolder, sweep
from tests.explorer.served import Client, patience

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals and modes of POSIX")
HOLD = """
import sys, tempfile, time
from struck.explorer.private_folder import PrivateFolder
tempfile.tempdir = sys.argv[1]
folder = PrivateFolder()
print(folder.path, flush=True)
time.sleep(600)
"""
ENDINGS = [signal.SIGTERM, signal.SIGHUP]


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "bar.struck"
    body = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
    struck.save(struck.analyze(body, "steel", band=(20, 2000)), path)
    return path


def started(
    words: list[str], scratch: Path, **variables: str
) -> tuple[subprocess.Popen[str], Client]:
    """Start `struck explore`, and return it with a client of its address."""
    process = subprocess.Popen(
        [sys.executable, "-m", "struck", "explore", *words],
        env={**os.environ, "TMPDIR": str(scratch), **variables},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    return process, Client(process.stderr.readline().strip())


def wait_for(path: Path) -> None:
    limit = time.monotonic() + 20 * patience()
    while not (path.exists() and path.stat().st_size):
        assert time.monotonic() < limit
        time.sleep(0.02)


@pytest.mark.prove
def test_sigterm_and_sighup_leave_nothing_and_the_browser_gets_no_token(
    model: Path, tmp_path: Path
) -> None:
    """Both rooms at once, as a start takes seconds."""
    script = tmp_path / "browser"
    script.write_text('#!/bin/sh\nprintf "%s\\n" "$@" > "$SEEN.part" && mv "$SEEN.part" "$SEEN"\n')
    script.chmod(0o755)
    rooms = []
    for number in ENDINGS:
        scratch = tmp_path / number.name
        scratch.mkdir()
        variables = {"BROWSER": str(script), "DISPLAY": ":9", "SEEN": f"{scratch}.seen"}
        rooms.append((number, scratch, *started([str(model)], scratch, **variables)))
    for number, scratch, process, client in rooms:
        seen = Path(f"{scratch}.seen")
        wait_for(seen)
        (address,) = seen.read_text().split()
        token = client.path.partition("token=")[2]
        assert token
        assert token not in address
        page = Path(unquote(urlsplit(address).path))
        assert (stat.S_IMODE(page.stat().st_mode), page.stat().st_uid) == (0o600, os.getuid())
        assert stat.S_IMODE(page.parent.stat().st_mode) == 0o700
        assert page.parent.parent == scratch
        (target,) = set(re.findall(r"http://[^\"]+", page.read_text()))
        entered = Client(target)
        # A redirect after a file would bring no strict cookie: the step is a page of the server.
        step = entered.ask("GET", entered.path, sec_fetch_site="cross-site")
        assert step.status in {200, 303}
        entered.enter()
        assert entered.ask("GET", "/api/room").json["objects"][0]["title"] == "bar"
        process.send_signal(number)
    for number, scratch, process, _ in rooms:
        process.communicate(timeout=60)
        assert process.returncode in {-number, 128 + number}
        assert not list(scratch.iterdir())


@pytest.mark.prove
@pytest.mark.parametrize("number", ENDINGS)
def test_room_in_a_program_of_a_user_ends_as_orderly(
    number: signal.Signals, model: Path, tmp_path: Path
) -> None:
    program = "import struck, sys; struck.explore(struck.load(sys.argv[1]), browser=False)"
    process = subprocess.Popen(
        [sys.executable, "-c", program, str(model)],
        env={**os.environ, "TMPDIR": str(tmp_path)},
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    process.stderr.readline()
    assert [path.name.startswith("struck-room-") for path in tmp_path.iterdir()] == [True]
    process.send_signal(number)
    process.communicate(timeout=60)
    assert process.returncode == -number
    assert not list(tmp_path.iterdir())


@pytest.mark.prove
def test_what_ignores_the_end_of_a_terminal_goes_on(model: Path, tmp_path: Path) -> None:
    """As with nohup."""
    command = [sys.executable, "-m", "struck", "explore", "--no-browser", str(model)]
    process = subprocess.Popen(
        ["/bin/sh", "-c", 'trap "" HUP; exec "$@"', "sh", *command],
        env={**os.environ, "TMPDIR": str(tmp_path)},
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    client = Client(process.stderr.readline().strip())
    process.send_signal(signal.SIGHUP)
    time.sleep(1)
    client.enter()
    assert client.ask("GET", "/api/room").status == 200
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=60)
    assert process.returncode == -signal.SIGTERM


@pytest.fixture
def held(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """Yield a process that holds a folder, and the folder."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        yield process, Path(process.stdout.readline().strip())
        process.kill()


def test_folder_of_the_dead_goes_and_that_of_the_living_stays(
    held: tuple[subprocess.Popen[str], Path], tmp_path: Path
) -> None:
    process, folder = held
    (folder / "model.struck").write_bytes(b"model")
    assert sweep(tmp_path) == 0
    assert (folder / "model.struck").exists()
    process.kill()
    process.wait()
    assert folder.exists()
    assert sweep(tmp_path) == 1
    assert not folder.exists()
    assert sweep(tmp_path) == 0


def test_only_folders_of_rooms_and_of_this_user_go(tmp_path: Path) -> None:
    aim = tmp_path / "aim"
    aim.mkdir()
    (aim / "lock").touch()
    (aim / "precious").touch()
    (tmp_path / "struck-room-aaaaaaaa").symlink_to(aim)  # a link to a folder
    (tmp_path / "struck-room-bbbbbbbb").touch()  # a file
    for name in ("struck-room-cccccccc", "struck-cccccccc", "struck-room-cccccccc.old"):
        (tmp_path / name).mkdir()  # without a lock, or of another kind
    (tmp_path / "struck-cccccccc/lock").touch()
    linked = tmp_path / "struck-room-dddddddd"  # whose lock is a link
    linked.mkdir()
    (linked / "lock").symlink_to(aim / "lock")
    piped = tmp_path / "struck-room-eeeeeeee"
    piped.mkdir()
    os.mkfifo(piped / "lock")
    strange = tmp_path / "struck-room-ffffffff"
    strange.mkdir()
    (strange / "lock").touch()
    if os.geteuid() == 0:
        os.chown(strange, 65534, 65534)
    before = sorted(tmp_path.rglob("*"))
    dead = tmp_path / "struck-room-00000000"
    dead.mkdir()
    (dead / "lock").touch()
    (dead / "link").symlink_to(aim)
    assert sweep(tmp_path) == 2 - (os.geteuid() == 0)
    assert not dead.exists()
    assert [path for path in before if path.exists() or path.is_symlink()] == [
        path for path in before if os.geteuid() == 0 or strange not in (path, path.parent)
    ]


def test_start_sweeps_and_the_end_removes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    dead = tmp_path / "struck-room-00000000"
    dead.mkdir()
    (dead / "lock").touch()
    folder, other = PrivateFolder(), PrivateFolder()
    assert sorted(tmp_path.iterdir()) == sorted([folder.path, other.path])
    assert stat.S_IMODE(folder.path.stat().st_mode) == 0o700
    page = folder.write_private("open.html", "text")
    assert stat.S_IMODE(page.stat().st_mode) == 0o600
    folder.remove()
    assert list(tmp_path.iterdir()) == [other.path]
    other.remove()
    other.remove()
    assert not list(tmp_path.iterdir())
