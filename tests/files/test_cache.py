"""The cache: damage is never returned, the cap holds, processes agree, trouble is said once."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import textwrap
import time
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from struck.analysis.analysis import model_of_modes
from struck.errors import CacheWarning, FileFormatError, OptionError
from struck.files import atomic, model_file
from struck.files.cache import Cache, opened, user_folder
from struck.model.material import Material
from struck.model.model import ModalModel
from tests.folders import closed_to_writing

HOME = Path.home()


def key_of(text: object) -> str:
    return hashlib.sha256(str(text).encode()).hexdigest()


def content_of(number: int, size: int = 2000) -> bytes:
    return np.random.default_rng(number).bytes(size)


@pytest.fixture
def cache(tmp_path: Path) -> Cache:
    return Cache(tmp_path / "cache")


# Where it is


@pytest.mark.parametrize(
    ("system", "environment", "folder"),
    [
        ("linux", {}, HOME / ".cache/struck"),
        ("linux", {"XDG_CACHE_HOME": "/var/xdg"}, Path("/var/xdg/struck")),
        # "All paths set in these environment variables must be absolute": XDG, section 2.
        ("linux", {"XDG_CACHE_HOME": "relative"}, HOME / ".cache/struck"),
        ("darwin", {"XDG_CACHE_HOME": "/var/xdg"}, HOME / "Library/Caches/struck"),
        ("win32", {"LOCALAPPDATA": "/users/a/local"}, Path("/users/a/local/struck/Cache")),
        ("win32", {}, HOME / "AppData/Local/struck/Cache"),
    ],
)
def test_folder_is_where_the_system_keeps_caches(
    system: str, environment: dict[str, str], folder: Path
) -> None:
    assert user_folder(system, environment) == folder


def test_user_without_a_home_has_no_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError

    monkeypatch.setattr(Path, "home", homeless)
    assert user_folder("linux", {}) is None


def test_environment_and_argument_choose(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def folder(*, choice: bool | str | Path) -> Path | None:
        chosen = opened(choice=choice)
        return None if chosen is None else chosen.folder

    monkeypatch.setenv("STRUCK_CACHE", str(tmp_path / "named"))
    assert folder(choice=True) == tmp_path / "named"
    assert folder(choice=tmp_path / "given") == tmp_path / "given"
    assert folder(choice=False) is None
    monkeypatch.setenv("STRUCK_CACHE", "off")
    assert folder(choice=True) is None
    assert folder(choice=str(tmp_path / "given")) == tmp_path / "given"
    monkeypatch.setenv("STRUCK_CACHE", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(sys, "platform", "linux")
    assert folder(choice=True) == tmp_path / "struck"


@pytest.mark.parametrize("named", ["~nosuchuser/x", "~nosuchuser"])
def test_home_of_nobody_is_no_folder(
    named: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("STRUCK_CACHE", named)
    with pytest.warns(CacheWarning, match=f"'{named}', and there is no such home.*whole path"):
        assert opened() is None
    assert not list(tmp_path.iterdir())


def test_choosing_makes_no_folder(tmp_path: Path) -> None:
    chosen = opened(choice=tmp_path / "given")
    assert chosen is not None
    assert chosen.get(key_of("a")) is None
    assert not chosen.entries()
    assert not list(tmp_path.iterdir())


# What it keeps


@pytest.mark.parametrize("content", [b"", b"a", content_of(0, 100_000)], ids=len)
def test_what_was_put_comes_back(cache: Cache, content: bytes) -> None:
    cache.put(key_of("a"), content)
    assert cache.get(key_of("a")) == content
    assert Cache(cache.folder).get(key_of("a")) == content
    assert cache.get(key_of("b")) is None
    assert cache.damaged == 0


def test_the_folder_is_closed_to_others(cache: Cache) -> None:
    cache.put(key_of("a"), b"one")
    assert os.name == "nt" or cache.folder.stat().st_mode & 0o077 == 0


def test_putting_again_replaces(cache: Cache) -> None:
    cache.put(key_of("a"), b"one")
    cache.put(key_of("a"), b"two")
    assert cache.get(key_of("a")) == b"two"
    assert len(cache.entries()) == 1


@pytest.mark.parametrize("key", ["", "a" * 63, "A" * 64, "../" + "a" * 61, "a" * 64 + "\n"])
def test_a_key_is_a_hash(cache: Cache, key: str) -> None:
    with pytest.raises(OptionError, match="SHA-256"):
        cache.get(key)
    with pytest.raises(OptionError, match="SHA-256"):
        cache.put(key, b"")


def test_clearing_removes_entries_and_nothing_else(cache: Cache) -> None:
    for number in range(3):
        cache.put(key_of(number), content_of(number))
    (cache.folder / "notes.txt").write_text("mine")
    assert cache.clear() == 3
    assert [path.name for path in cache.folder.iterdir()] == ["notes.txt"]
    assert cache.clear() == 0


# Damage


def damaged(data: bytes, others: list[bytes], rng: np.random.Generator) -> bytes:
    """Return `data` with a byte changed, cut short, extended, or another's in its place."""
    place = int(rng.integers(len(data)))
    match rng.integers(4):
        case 0:
            changed = data[place] ^ int(rng.integers(1, 256))
            return data[:place] + bytes([changed]) + data[place + 1 :]
        case 1:
            return data[:place]
        case 2:
            return data + rng.bytes(int(rng.integers(1, 100)))
        case _:
            return others[int(rng.integers(len(others)))]


def test_a_hundred_damaged_entries_are_all_found(cache: Cache) -> None:
    rng = np.random.default_rng(3)
    contents = {key_of(number): content_of(number, 50 + 37 * number) for number in range(10)}
    for key, content in contents.items():
        cache.put(key, content)
    files = {key: (cache.folder / key).read_bytes() for key in contents}
    for count in range(1, 101):
        key = str(rng.choice(list(contents)))
        others = [data for other, data in files.items() if other != key]
        (cache.folder / key).write_bytes(damaged(files[key], others, rng))
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            assert {k: cache.get(k) for k in contents} == {**contents, key: None}
        assert cache.damaged == count
        assert [each.category for each in said] == [CacheWarning] * (count == 1)
        assert not (cache.folder / key).exists()
        cache.put(key, contents[key])


def test_a_hundred_damaged_model_files_are_all_found(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    path = tmp_path / "a.struck"
    model_file.save(small_model(), path)
    whole = path.read_bytes()
    for _ in range(100):
        path.write_bytes(damaged(whole, [b"", rng.bytes(len(whole)), b"solid x"], rng))
        with pytest.raises(FileFormatError):
            model_file.load(path)


def small_model() -> ModalModel:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    return model_of_modes(
        points,
        faces,
        [100.0, 200.0],
        np.random.default_rng(0).standard_normal((4, 3, 2)),
        material=Material.named("steel"),
        mass=1.0,
        centre=np.full(3, 0.25),
        inertia=np.eye(3),
    )


def test_damage_is_said_with_its_place_and_what_follows(cache: Cache) -> None:
    cache.put(key_of("a"), b"one")
    (cache.folder / key_of("a")).write_bytes(b"")
    with pytest.warns(CacheWarning, match=r"cache in .*cache was damaged .* computed again"):
        assert cache.get(key_of("a")) is None


def test_an_entry_of_a_later_version_is_left_out(cache: Cache) -> None:
    cache.put(key_of("a"), b"one")
    path = cache.folder / key_of("a")
    path.write_bytes(path.read_bytes().replace(b"struck cache\x01", b"struck cache\x02"))
    with pytest.warns(CacheWarning, match="version"):
        assert cache.get(key_of("a")) is None


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such files")
@pytest.mark.parametrize("kind", ["folder", "pipe", "link", "huge"])
def test_what_is_no_entry_is_never_read(tmp_path: Path, kind: str) -> None:
    cache = Cache(tmp_path, most_bytes=10_000)
    path = tmp_path / key_of("a")
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "link":
        path.symlink_to(os.devnull)
    else:
        with path.open("wb") as file:
            file.truncate(2**40)
    with pytest.warns(CacheWarning):
        assert cache.get(key_of("a")) is None
    assert cache.damaged == 1


# The cap


def test_the_least_recently_used_go_first(tmp_path: Path) -> None:
    cache = Cache(tmp_path, most_bytes=3 * 1100)
    for number in range(3):
        cache.put(key_of(number), content_of(number, 1000))
        set_age(tmp_path / key_of(number), 100 - number)
    assert cache.get(key_of(0)) == content_of(0, 1000)
    cache.put(key_of(3), content_of(3, 1000))
    assert {path.name for path in tmp_path.iterdir()} == {key_of(n) for n in (0, 2, 3)}


def set_age(path: Path, seconds: float) -> None:
    then = time.time() - seconds
    os.utime(path, (then, then))


def test_all_entries_together_stay_under_the_cap(tmp_path: Path) -> None:
    cache = Cache(tmp_path, most_bytes=20_000)
    rng = np.random.default_rng(5)
    for number in range(60):
        cache.put(key_of(number), rng.bytes(int(rng.integers(9000))))
        assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 20_000
        assert cache.get(key_of(number)) is not None


def test_an_entry_beyond_the_cap_is_not_kept_and_said_once(tmp_path: Path) -> None:
    cache = Cache(tmp_path, most_bytes=1000)
    cache.put(key_of("small"), b"one")
    with pytest.warns(CacheWarning, match="1048 bytes exceed the whole cache of 1000"):
        cache.put(key_of("large"), bytes(1000))
    cache.put(key_of("larger"), bytes(2000))  # a warning would be an error
    assert [path.name for path in tmp_path.iterdir()] == [key_of("small")]


def test_a_cap_below_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="-1"):
        Cache(tmp_path, most_bytes=-1)


# Trouble


def said_once_and_nothing_kept(cache: Cache, text: str) -> None:
    def keep() -> None:
        for number in range(3):
            assert cache.get(key_of(number)) is None
            cache.put(key_of(number), content_of(number, 100_000))

    with pytest.warns(CacheWarning, match=text) as said:
        keep()
    assert len(said) == 1
    assert not cache.entries()


def test_a_file_in_place_of_the_folder_is_said_once(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    said_once_and_nothing_kept(Cache(tmp_path / "file"), "not kept")
    said_once_and_nothing_kept(Cache(tmp_path / "file" / "below"), "not kept")


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such limit")
def test_a_full_disk_is_said_once(cache: Cache) -> None:
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, before[1]))  # the kernel refuses the rest
    try:
        said_once_and_nothing_kept(cache, "not kept.*free some space")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(cache.folder.iterdir())


@pytest.fixture
def closed_folder() -> Iterator[Path]:
    """A folder with one entry where this process may not write, even when it runs as root."""
    folder = Path(tempfile.mkdtemp())
    Cache(folder).put(key_of("a"), b"one")
    with closed_to_writing(folder):
        yield folder
    shutil.rmtree(folder)


@pytest.mark.skipif(os.name == "nt", reason="folders have no such permission on Windows")
def test_a_folder_closed_to_writing_serves_what_it_has(closed_folder: Path) -> None:
    cache = Cache(closed_folder)
    assert cache.get(key_of("a")) == b"one"
    with pytest.warns(CacheWarning, match="allows no new files"):
        cache.put(key_of("b"), b"two")
    assert cache.get(key_of("b")) is None


@pytest.mark.skipif(os.name == "nt", reason="folders have no such permission on Windows")
def test_a_closed_folder_is_said_once(closed_folder: Path) -> None:
    said_once_and_nothing_kept(Cache(closed_folder / "below"), "not kept")


# What killed processes leave


@pytest.mark.skipif(os.name == "nt", reason="there a process cannot be asked after")
def test_a_part_of_a_killed_process_goes_with_the_next_entry(cache: Cache) -> None:
    program = """
        import sys
        from struck.files.cache import Cache
        cache = Cache(sys.argv[1])
        while True:
            cache.put("a" * 64, bytes(30_000_000))
    """
    command = [sys.executable, "-c", textwrap.dedent(program), str(cache.folder)]
    with subprocess.Popen(command) as writer:
        while not list(cache.folder.glob(".*.part")):
            assert writer.poll() is None
        writer.kill()
    left = [*cache.folder.glob(".*.part")]
    assert cache.get("a" * 64) in {None, bytes(30_000_000)}
    cache.put(key_of("b"), b"two")
    assert not [path for path in left if path.exists()]
    assert cache.get(key_of("b")) == b"two"


def part(folder: Path, host: str, process: int) -> Path:
    path = folder / f".struck-{host}-{process}-{'0' * 16}.part"
    path.write_bytes(b"half")
    return path


def test_parts_of_the_living_and_of_other_computers_stay_for_a_day(tmp_path: Path) -> None:
    ours = part(tmp_path, atomic._host(), os.getppid())
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        ended.wait()
    theirs = part(tmp_path, "0" * 8, ended.pid)  # no process here, and perhaps one there
    other = tmp_path / ".struck.part"
    other.write_bytes(b"")
    assert atomic.sweep(tmp_path) == 0
    for path in (ours, theirs, other):
        set_age(path, 90_000)
    assert atomic.sweep(tmp_path) == 2
    assert [path.name for path in tmp_path.iterdir()] == [other.name]


@pytest.mark.skipif(sys.platform != "linux", reason="numbers of processes are the computer's")
def test_parts_of_another_namespace_or_start_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of this computer's name each: a container, a computer that is called alike, none known."""
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        ended.wait()
    own = atomic._host()
    (tmp_path / "boot").write_text("another start\n", encoding="ascii")
    (tmp_path / "pid").symlink_to("pid:[4026532001]")
    for name, path in (("_BOOT", "boot"), ("_NAMESPACE", "pid"), ("_BOOT", "none")):
        with monkeypatch.context() as elsewhere:
            elsewhere.setattr(atomic, name, tmp_path / path)
            theirs = part(tmp_path, atomic._host(), ended.pid)
        assert atomic.sweep(tmp_path) == 0
        assert theirs.exists()
    part(tmp_path, own, ended.pid)
    assert atomic.sweep(tmp_path) == 1


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="states of processes are in /proc")
def test_a_part_of_a_process_that_ended_and_nobody_waited_for_goes(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        os.waitid(os.P_PID, ended.pid, os.WEXITED | os.WNOWAIT)
        part(tmp_path, atomic._host(), ended.pid)
        assert atomic.sweep(tmp_path) == 1


def test_a_clock_that_is_ahead_sweeps_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    theirs = part(tmp_path, "0" * 8, 1)
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now + 1e6)
    assert atomic.sweep(tmp_path) == 0
    assert theirs.exists()


@pytest.mark.skipif(not shutil.which("unshare"), reason="no unshare on this system")
def test_a_writer_in_a_namespace_of_its_own_is_left_alone(tmp_path: Path) -> None:
    """Its number is that of nobody here, and its computer's name is ours."""
    program = "from struck.files.atomic import _host; import os; print(_host(), os.getpid())"
    command = ["unshare", "--pid", "--fork", sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip("namespaces may not be made here")
    host, process = done.stdout.split()
    theirs = part(tmp_path, host, 99_999_999 if process == "1" else int(process))
    assert host != atomic._host()
    assert atomic.sweep(tmp_path) == 0
    assert theirs.exists()


# Several processes

SHARING = """
    import hashlib, random, sys
    from struck.files.cache import Cache
    folder, seed = sys.argv[1], int(sys.argv[2])
    cache, rng = Cache(folder, most_bytes=400_000), random.Random(seed)
    found, wrong = 0, 0
    for _ in range(150):
        number = rng.randrange(30)
        key = hashlib.sha256(b"%d" % number).hexdigest()
        expected = random.Random(number).randbytes(20_000 + number)
        content = cache.get(key)
        found += content is not None
        wrong += content not in (None, expected)
        if content is None:
            cache.put(key, expected)
    print(found, wrong, cache.damaged)
"""


@pytest.mark.prove
def test_eight_processes_on_one_cache_agree(tmp_path: Path) -> None:
    command = [sys.executable, "-W", "error", "-c", textwrap.dedent(SHARING), str(tmp_path)]
    started = [
        subprocess.Popen([*command, str(seed)], stdout=subprocess.PIPE, text=True)
        for seed in range(8)
    ]
    told = [process.communicate()[0].split() for process in started]
    assert [process.returncode for process in started] == [0] * 8
    assert [counts[1:] for counts in told] == [["0", "0"]] * 8
    assert sum(int(counts[0]) for counts in told) > 100
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 400_000
    assert not list(tmp_path.glob(".*"))
