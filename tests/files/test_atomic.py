"""A file is written whole or not at all."""

from __future__ import annotations

import os
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import textwrap
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from struck.errors import FileFormatError
from struck.files import atomic
from tests.folders import closed_to_writing

STEPS = {
    "write": (atomic, "_write_through"),
    "flush": (atomic.os, "fsync"),
    "rename": (Path, "replace"),
}


def interrupted(kind: type[BaseException]) -> Callable[..., None]:
    def stop(*_: object, **__: object) -> None:
        raise kind

    return stop


def test_new_file_holds_the_data_and_the_usual_permissions(tmp_path: Path) -> None:
    atomic.write_bytes(tmp_path / "a.bin", b"one")
    (tmp_path / "plain").write_bytes(b"")
    assert (tmp_path / "a.bin").read_bytes() == b"one"
    assert (tmp_path / "a.bin").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_existing_file_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(b"a longer old content")
    atomic.write_bytes(str(tmp_path / "a.bin"), b"new")
    assert (tmp_path / "a.bin").read_bytes() == b"new"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.bin"]


def test_open_readers_keep_the_old_content(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(b"old")
    with (tmp_path / "a.bin").open("rb") as reader:
        atomic.write_bytes(tmp_path / "a.bin", b"new")
        assert reader.read() == b"old"


def test_symbolic_link_is_followed(tmp_path: Path) -> None:
    (tmp_path / "real").write_bytes(b"old")
    (tmp_path / "link").symlink_to("real")
    atomic.write_bytes(tmp_path / "link", b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_bytes() == b"new"


@pytest.mark.skipif(os.name == "nt", reason="modes of POSIX")
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o444, 0o666, 0o755, 0o000])
def test_replaced_file_passes_on_its_mode(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    path.chmod(mode)
    atomic.write_bytes(path, b"new")
    assert stat.S_IMODE(path.stat().st_mode) == mode
    path.chmod(0o600)
    assert path.read_bytes() == b"new"


@pytest.mark.skipif(os.name == "nt", reason="modes of POSIX")
def test_what_replaces_a_private_file_is_private_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    modes = []
    passed_on = atomic._pass_on_permissions

    def seen(target: Path, replaced: os.stat_result, handle: int) -> None:
        modes.append(stat.S_IMODE(os.fstat(handle).st_mode))
        passed_on(target, replaced, handle)

    monkeypatch.setattr(atomic, "_pass_on_permissions", seen)
    (tmp_path / "a.bin").write_bytes(b"old")
    atomic.write_bytes(tmp_path / "a.bin", b"new")
    assert modes == [0o600]


@pytest.mark.skipif(os.name == "nt", reason="modes of POSIX")
def test_link_stays_and_its_file_passes_on_its_mode(tmp_path: Path) -> None:
    (tmp_path / "real").write_bytes(b"old")
    (tmp_path / "real").chmod(0o640)
    (tmp_path / "link").symlink_to("real")
    atomic.write_bytes(tmp_path / "link", b"new")
    assert (tmp_path / "link").is_symlink()
    assert stat.S_IMODE((tmp_path / "real").stat().st_mode) == 0o640


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="for root alone")
def test_root_passes_on_the_owner(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    os.chown(path, 65534, 65533)
    path.chmod(0o4750)
    atomic.write_bytes(path, b"new")
    status = path.stat()
    assert (status.st_uid, status.st_gid) == (65534, 65533)
    assert stat.S_IMODE(status.st_mode) == 0o4750


@pytest.mark.skipif(os.name == "nt", reason="modes of POSIX")
def test_another_group_may_do_what_all_others_may(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where owner and group cannot be passed on, nobody gets more than before."""

    def refuse(*_: object) -> None:
        raise PermissionError

    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    path.chmod(0o2764)
    now = path.stat()
    strange = os.stat_result((*now[:4], now.st_uid + 1, now.st_gid + 1, *now[6:]))
    monkeypatch.setattr(atomic.os, "fchown", refuse)
    with path.open("rb+") as file:
        atomic._pass_on_permissions(path, strange, file.fileno())
    assert stat.S_IMODE(path.stat().st_mode) == 0o744


@pytest.mark.skipif(not hasattr(os, "setxattr"), reason="extended attributes of Linux")
def test_attributes_are_passed_on(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    try:
        os.setxattr(path, "user.origin", b"a test")
    except OSError:
        pytest.skip("this file system has no attributes")
    atomic.write_bytes(path, b"new")
    assert os.getxattr(path, "user.origin") == b"a test"


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("kind", [KeyboardInterrupt, OSError, MemoryError])
def test_failure_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str, kind: type[BaseException]
) -> None:
    (tmp_path / "a.bin").write_bytes(b"old")
    monkeypatch.setattr(*STEPS[step], interrupted(kind))
    with pytest.raises(FileFormatError if kind is OSError else kind):
        atomic.write_bytes(tmp_path / "a.bin", b"new")
    monkeypatch.undo()
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.bin"]
    assert (tmp_path / "a.bin").read_bytes() == b"old"


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT for other processes")
@pytest.mark.parametrize("delay", [0.0, 0.001, 0.003, 0.007])
def test_real_interruption_leaves_one_whole_file(tmp_path: Path, delay: float) -> None:
    program = """
        import sys
        from struck.files.atomic import write_bytes
        count = 0
        while True:
            count += 1
            write_bytes(sys.argv[1], bytes([count % 256]) * 3_000_000)
            print(count, flush=True)
    """
    command = [sys.executable, "-c", textwrap.dedent(program), str(tmp_path / "a.bin")]
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, text=True, **streams) as writer:
        assert writer.stdout is not None
        for _ in range(3):
            writer.stdout.readline()
        time.sleep(delay)
        writer.send_signal(signal.SIGINT)
    content = (tmp_path / "a.bin").read_bytes()
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.bin"]
    assert content == content[:1] * 3_000_000


def test_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"the folder .*nowhere does not exist; make it"):
        atomic.write_bytes(tmp_path / "nowhere" / "a.bin", b"")
    assert not list(tmp_path.iterdir())


def test_file_as_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(FileFormatError, match=r"the folder .*file does not exist"):
        atomic.write_bytes(tmp_path / "file" / "a.bin", b"")


def test_folder_as_target_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="is a folder: add the name"):
        atomic.write_bytes(tmp_path, b"")


def test_device_is_not_replaced() -> None:
    before = Path(os.devnull).stat()
    with pytest.raises(FileFormatError, match="not an ordinary file"):
        atomic.write_bytes(os.devnull, b"x")
    assert stat.S_ISCHR(Path(os.devnull).stat().st_mode)
    assert Path(os.devnull).stat().st_ino == before.st_ino


def test_name_too_long_is_one_error(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="cannot be written"):
        atomic.write_bytes(tmp_path / ("n" * 300), b"x")
    assert not list(tmp_path.iterdir())


@pytest.fixture
def closed_folder() -> Iterator[Path]:
    """A folder where this process may not write, even when it runs as root."""
    folder = Path(tempfile.mkdtemp())
    with closed_to_writing(folder):
        yield folder
    shutil.rmtree(folder)


@pytest.mark.skipif(os.name == "nt", reason="folders have no such permission on Windows")
def test_folder_without_permission_is_named(closed_folder: Path) -> None:
    with pytest.raises(FileFormatError, match=r"allows no new files.*another folder"):
        atomic.write_bytes(closed_folder / "a.bin", b"x")


def test_a_file_that_is_read_is_not_written(tmp_path: Path) -> None:
    """By whatever name it goes: another way there, a symbolic link, a hard link."""
    read = tmp_path / "tap.wav"
    read.write_bytes(b"a sound")
    (tmp_path / "folder").mkdir()
    (tmp_path / "soft.wav").symlink_to("tap.wav")
    os.link(read, tmp_path / "hard.wav")
    for name in ("tap.wav", "folder/../tap.wav", "soft.wav", "hard.wav"):
        with pytest.raises(FileFormatError, match=r"tap\.wav,? is read .* another name"):
            atomic.writable(tmp_path / name, unlike=[tmp_path / "other.wav", read])
    assert atomic.writable(tmp_path / "new.wav", unlike=[read]) == tmp_path / "new.wav"


def test_one_file_is_not_written_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileFormatError, match="another name"):
        atomic.writable("model.struck", unlike=[tmp_path / "model.struck"])
    assert atomic.writable("page.html", unlike=["model.struck"]) == Path("page.html")


def test_what_is_no_file_at_all_is_unlike_any(tmp_path: Path) -> None:
    unlike = ["tube:length=0.5", "n" * 300, "\0"]
    assert atomic.writable(tmp_path / "a.struck", unlike=unlike) == tmp_path / "a.struck"


def test_what_a_failing_disk_leaves_goes_with_the_next_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also in the same process; but no file that another thread is writing."""

    def fail(*_: object, **__: object) -> None:
        raise OSError

    with monkeypatch.context() as failing:
        failing.setattr(atomic.os, "fsync", fail)
        failing.setattr(Path, "unlink", fail)
        with pytest.raises(FileFormatError):
            atomic.write_bytes(tmp_path / "a.bin", b"new")
    (left,) = tmp_path.iterdir()
    monkeypatch.setattr(atomic, "_names_in_use", {left.name})
    assert atomic.sweep(tmp_path) == 0
    monkeypatch.setattr(atomic, "_names_in_use", set())
    atomic.write_bytes(tmp_path / "a.bin", b"new")
    assert [path.name for path in tmp_path.iterdir()] == ["a.bin"]


@pytest.mark.skipif(os.name == "nt", reason="modes of POSIX")
def test_private_file_is_of_its_owner_alone(tmp_path: Path) -> None:
    atomic.write_bytes(tmp_path / "a.bin", b"new", private=True)
    assert stat.S_IMODE((tmp_path / "a.bin").stat().st_mode) == 0o600


def test_what_cannot_be_removed_is_reported(tmp_path: Path) -> None:
    atomic.remove(tmp_path / "none")
    with pytest.raises(FileFormatError, match="cannot be removed"):
        atomic.remove(tmp_path)
