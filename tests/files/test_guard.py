"""Files that crash, hang, swell or lie: one error each, and the next file is read as ever."""

from __future__ import annotations

import bz2
import gzip
import json
import lzma
import os
import re
import signal
import subprocess
import sys
import threading
import time
import zipfile
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import trimesh

from struck.errors import MeshError
from struck.files import guard as guards
from struck.files.guard import Contents, Guard, read_contents
from struck.files.meshes import load_mesh
from struck.files.messages import Frame, Part, ReadingLimits, read_frame, write_frame
from tests.explorer.served import patience

MIB = 2**20
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
ANSWER = {"kind": "obj", "names": ["default"], "beside": {}}
BUNNY = Path(__file__).parents[3] / "shared/data/meshes/stanford_bunny.obj"
linux = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")


@pytest.fixture
def tetrahedron(tmp_path: Path) -> Path:
    path = tmp_path / "a.obj"
    path.write_text(TETRAHEDRON)
    return path


@pytest.fixture
def guard() -> Iterator[Guard]:
    made = Guard()
    yield made
    made.close()


def refused(guard: Guard, path: Path) -> str:
    with pytest.raises(MeshError) as caught:
        guard.contents(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def refused_by_all(path: Path, *, seconds: float = 1.0, memory: int = 300 * MIB) -> str:
    """Refuse a file with a reader that runs, in time and memory, and return the line."""
    guard = guards._GUARD
    guard._running()
    started = busy(guard)
    message = refused(guard, path)
    assert guard.process_id
    if sys.platform == "linux":
        assert busy(guard) - started < seconds
        assert peak(guard) < memory
    return message


def busy(guard: Guard) -> float:
    """Return how long the reader has worked, s: the same however many others do."""
    if sys.platform != "linux":
        return 0.0
    fields = Path(f"/proc/{guard.process_id}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")


def peak(guard: Guard) -> int:
    """Return the most memory that the reader has held, bytes."""
    status = Path(f"/proc/{guard.process_id}/status").read_text()
    return 1024 * int(re.findall(r"VmHWM:\s*(\d+)", status)[0])


def saved(path: Path, content: bytes | str) -> Path:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def is_alive(process: int) -> bool:
    """Tell whether any thread of it is left: the first may end before the others."""
    folder = Path(f"/proc/{process}")
    try:
        ended = (folder / "stat").read_text().rpartition(")")[2].split()[0] == "Z"
        return not ended or len(list((folder / "task").iterdir())) > 1
    except FileNotFoundError:
        return False


def dies(process: int, *, seconds: float = 10.0) -> bool:
    deadline = time.perf_counter() + seconds
    while is_alive(process) and time.perf_counter() < deadline:
        time.sleep(0.01)
    return not is_alive(process)


# The reader


def test_same_arrays_as_in_the_file(tetrahedron: Path) -> None:
    contents = read_contents(tetrahedron)
    (part,) = contents.parts
    assert (contents.kind, part.name) == ("obj", "default")
    np.testing.assert_array_equal(part.points, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    np.testing.assert_array_equal(part.faces, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def test_one_reader_for_many_files(guard: Guard, tetrahedron: Path) -> None:
    guard.contents(tetrahedron)
    first = guard.process_id
    started = time.perf_counter()
    for _ in range(10):
        guard.contents(tetrahedron)
    assert guard.process_id == first
    assert time.perf_counter() - started < 3  # ten readers would take longer


@pytest.mark.prove
@pytest.mark.skipif(not BUNNY.exists(), reason=f"{BUNNY.name} is not beside the checkout")
def test_a_scan_in_time() -> None:
    limit, started = 5 * patience(), time.perf_counter()
    (part,) = read_contents(BUNNY).parts
    assert time.perf_counter() - started < limit
    assert len(part.faces) == 69451


def test_relative_paths_are_from_where_the_program_is(
    guard: Guard, tetrahedron: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    guard.contents(tetrahedron)
    monkeypatch.chdir(tetrahedron.parent)
    assert len(guard.contents("a.obj").parts) == 1


def test_modules_where_the_program_is_started_are_not_taken(
    guard: Guard, tetrahedron: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tetrahedron.parent / "json.py").write_text("raise SystemExit")
    monkeypatch.chdir(tetrahedron.parent)
    assert len(guard.contents(tetrahedron).parts) == 1


def test_threads_wait_for_each_other(tmp_path: Path, guard: Guard) -> None:
    counts: dict[int, set[int]] = {}

    def read(number: int) -> None:
        path = saved(tmp_path / f"{number}.obj", TETRAHEDRON + "f 1 3 2\n" * number)
        counts[number] = {len(guard.contents(path).parts[0].faces) for _ in range(10)}

    threads = [threading.Thread(target=read, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert counts == {number: {4 + number} for number in range(4)}


@linux
def test_killed_reader_is_replaced(guard: Guard, tetrahedron: Path) -> None:
    guard.contents(tetrahedron)
    first = guard.process_id
    assert first
    os.kill(first, signal.SIGKILL)
    assert dies(first)
    assert len(guard.contents(tetrahedron).parts) == 1
    assert guard.process_id != first


@pytest.mark.prove
@linux
def test_fork_gets_a_reader_of_its_own(tetrahedron: Path) -> None:
    """In a process of one thread: pytest's own may have more, and then Python warns of forks."""
    program = """
import os, sys
from struck.files.guard import Guard
guard = Guard()
guard.contents(sys.argv[1])
mine = guard.process_id
child = os.fork()
if child == 0:
    guard.contents(sys.argv[1])
    sys.exit(0 if guard.process_id != mine else 1)
assert os.waitpid(child, 0)[1] == 0
guard.contents(sys.argv[1])
assert guard.process_id == mine
"""
    command = [sys.executable, "-W", "error", "-c", program, str(tetrahedron)]
    assert subprocess.run(command, capture_output=True, check=True).stderr == b""


PARENT = """
import os, sys, time
from struck.files.guard import Guard
guard = Guard()
guard.contents(sys.argv[1])
print(guard.process_id, flush=True)
if sys.argv[2] == "wait":
    time.sleep(60)
"""


@linux
@pytest.mark.parametrize("death", ["end", "kill"])
def test_reader_dies_with_its_program(tetrahedron: Path, death: str) -> None:
    wait = "wait" if death == "kill" else "end"
    with subprocess.Popen(
        [sys.executable, "-W", "error", "-c", PARENT, str(tetrahedron), wait],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as parent:
        assert parent.stdout
        assert parent.stderr
        reader = int(parent.stdout.readline())
        if death == "kill":
            assert is_alive(reader)
            parent.kill()
        parent.wait()
        assert parent.stderr.read() == b""
    assert dies(reader)


@pytest.mark.prove
@linux
def test_reader_amid_a_file_dies_without_its_program(tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", guards._PROGRAM, "{}"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        bufsize=0,
    ) as reader:
        assert reader.stdin
        assert reader.stdout
        read_frame(reader.stdout, largest=0)
        path = saved(tmp_path / "a.obj", "v 0 0 0\n" * 6_000_000)
        times = {"seconds": 0.1, "wall": 60.0}
        question = {"task": "surface", "path": str(path), "options": {}, **times}
        write_frame(reader.stdin, question)
        assert dies(reader.pid)
        assert reader.wait() == -signal.SIGPROF


def test_nothing_reaches_the_terminal(
    tmp_path: Path, guard: Guard, capfd: pytest.CaptureFixture[str]
) -> None:
    refused(guard, saved(tmp_path / "a.off", "OFF\n3 1 0\n0 0 0\n"))
    refused(guard, saved(tmp_path / "a.obj", "v \x1b[31m\x07 0 0\n"))
    assert capfd.readouterr() == ("", "")


def test_messages_cannot_steer_a_terminal(tmp_path: Path, guard: Guard) -> None:
    message = refused(guard, saved(tmp_path / "a.obj", "f \x1b[31mred \u202e\x07\n"))
    assert message.isprintable()
    assert "line 1" in message


# Readers that fail

SPEAK = f"""{guards._ALMOST_EMPTY_PACKAGE}
import time, os, signal
import numpy as np
from struck.files.messages import read_frame, write_frame
questions, answers = sys.stdin.buffer, sys.stdout.buffer
write_frame(answers, {{"ready": True}})
read_frame(questions, largest=0)
"""


def speaking(program: str, **limits: float) -> Guard:
    """Return a guard whose reader does what a program says once it is asked."""
    return Guard(ReadingLimits(**limits), command=[sys.executable, "-c", SPEAK + program])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("program", "message"),
    [
        ("time.sleep(60)", "took longer than 0.5 s: simplify"),
        pytest.param(
            *("answers.write(b'x'); answers.flush(); time.sleep(60)", "took longer than 0.5 s"),
            marks=pytest.mark.prove,
        ),
        ("while True: pass", "took longer than 0.5 s"),
        ("os._exit(77)", "more than 2147483648 bytes of memory: simplify"),
        ("os.abort()", "its reader crashed on it (exit code"),
        ("os.kill(os.getpid(), signal.SIGSEGV)", "its reader crashed on it (exit code -11)"),
        ("pass", "its reader crashed on it (exit code 0)"),
        ("answers.write(b'x' * 4)", "its reader crashed on it"),
    ],
)
def test_reader_that_fails(tetrahedron: Path, program: str, message: str) -> None:
    guard = speaking(program, wall=0.5)
    started = time.perf_counter()
    assert message in refused(guard, tetrahedron)
    assert time.perf_counter() - started < 10
    assert guard.process_id is None


@pytest.mark.prove
@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timer of processor time here")
def test_the_time_of_a_reader_is_what_it_has_worked_and_not_what_others_have(
    tetrahedron: Path, tmp_path: Path
) -> None:
    guard = Guard(ReadingLimits(seconds=0.1))
    guard._running()
    os.kill(guard.process_id or 0, signal.SIGSTOP)  # nobody lets it work
    asleep = threading.Timer(0.5, os.kill, (guard.process_id, signal.SIGCONT))
    asleep.start()
    assert guard.contents(tetrahedron).parts
    corners = "".join(f"v {n} {n * n % 7} {n % 5}\n" for n in range(300_000))
    slow = saved(tmp_path / "slow.obj", corners + "f 1 2 3\n" * 100_000)
    assert "more than 0.1 s of the processor: simplify" in refused(guard, slow)
    assert guard.contents(tetrahedron).parts  # by another reader
    guard.close()


ARRAYS = "np.zeros((4, 3)), np.zeros((1, 3), int)"


@pytest.mark.parametrize(
    "program",
    [
        "answers.write(b'\\xff' * 1000)",
        "answers.write((100).to_bytes(8, 'little') + b'{' * 100)",
        "answers.write((50000).to_bytes(8, 'little') + b'[' * 50000)",
        "answers.write((2).to_bytes(8, 'little') + b'{}')",
        "answers.write((2).to_bytes(8, 'little') + b'\\xff\\xfe')",
        "write_frame(answers, {})",
        "write_frame(answers, {'kind': 'obj', 'names': 3})",
        "write_frame(answers, {'kind': 'obj', 'names': [3]}, [" + ARRAYS + "])",
        "write_frame(answers, {'kind': 'obj', 'names': ['a', 'b']}, [" + ARRAYS + "])",
        "write_frame(answers, {'kind': 'exe', 'names': ['a'], 'beside': {}}, [" + ARRAYS + "])",
        "write_frame(answers, {'kind': 'obj', 'names': ['a'], 'beside': {'line': 'x'}}, ["
        + ARRAYS
        + "])",
        f"write_frame(answers, {ANSWER}, [np.zeros((4, 2)), np.zeros((1, 3), int)])",
        f"write_frame(answers, {ANSWER}, [np.zeros((4, 3)), np.zeros((1, 3))])",
        f"write_frame(answers, {ANSWER}, [np.zeros((600, 3)), np.zeros((1, 3), int)])",
    ],
)
def test_reader_that_talks_nonsense(tetrahedron: Path, program: str) -> None:
    guard = speaking(f"{program}\nanswers.flush()\ntime.sleep(9)", answer=24 * 510)
    assert "its reader answered nonsense" in refused(guard, tetrahedron)
    assert guard.process_id is None


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ("np.full((4, 3), np.nan), np.array([[0, 1, 2]])", "4 of 4 vertices are not finite"),
        ("np.eye(3) * [1, 1, np.inf], np.array([[0, 1, 2]])", "3 of 3 vertices are not finite"),
        (
            "np.eye(3) * 1e200, np.array([[0, 1, 2]])",
            "1e200 from the origin, and volumes can be computed within 1e60",
        ),
        ("np.eye(3), np.array([[0, 1, 3]])", "faces name vertices 0 to 3 of 3"),
        ("np.eye(3), np.array([[0, -1, 2]])", "faces name vertices -1 to 2 of 3"),
        ("np.eye(3), np.empty((0, 3), int)", "no triangles"),
        ("np.eye(3), np.array([[0, 0, 2]])", "all of its 1 faces are lines or points"),
    ],
)
def test_arrays_are_judged_by_the_program(tetrahedron: Path, arrays: str, message: str) -> None:
    program = f"write_frame(answers, {ANSWER}, [{arrays}])\ntime.sleep(9)"
    guard = speaking(program)
    assert message in refused(guard, tetrahedron)
    guard.close()


def test_reader_that_cannot_be_started(tetrahedron: Path) -> None:
    assert "cannot be started" in refused(Guard(command=["no such program"]), tetrahedron)
    assert "did not start" in refused(Guard(command=[sys.executable, "-c", ""]), tetrahedron)


def test_interrupted_question_is_not_answered_to_the_next(
    tmp_path: Path, guard: Guard, tetrahedron: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    guard.contents(tetrahedron)
    first = guard.process_id

    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(guards, "read_frame", interrupt)
        with pytest.raises(KeyboardInterrupt):
            guard.contents(tetrahedron)
    two = saved(tmp_path / "two.obj", TETRAHEDRON + "f 1 3 2\n")
    assert len(guard.contents(two).parts[0].faces) == 5
    assert guard.process_id != first


@linux
def test_memory_is_bounded(tmp_path: Path) -> None:
    guard = Guard(ReadingLimits(memory=300 * MIB))
    path = saved(tmp_path / "a.obj", "v 0 0 0\n" * 2_000_000)
    assert "more than 314572800 bytes of memory" in refused(guard, path)


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"size": 50}, "takes up 64 bytes or more, and 50 are read: simplify"),
        ({"vertices": 3}, "4 vertices or more, and 3 are read: simplify"),
        ({"faces": 3}, "4 faces or more, and 3 are read: simplify"),
        ({"parts": 1}, "2 parts or more, and 1 are read"),
    ],
)
def test_counts_are_bounded(tmp_path: Path, limits: dict[str, int], message: str) -> None:
    text = TETRAHEDRON.replace("f 3 1 4", "o b\nf 3 1 4") if "parts" in limits else TETRAHEDRON
    guard = Guard(ReadingLimits(**limits))  # type: ignore[arg-type]
    assert message in refused(guard, saved(tmp_path / "a.obj", text))
    guard.close()


def test_pipes_and_devices_are_not_waited_for(tmp_path: Path, guard: Guard) -> None:
    if not hasattr(os, "mkfifo"):
        pytest.skip("no pipes among files")
    os.mkfifo(tmp_path / "a.obj")
    assert "a pipe or a device" in refused(guard, tmp_path / "a.obj")
    (tmp_path / "b.stl").symlink_to("/dev/zero")
    assert "a pipe or a device" in refused(guard, tmp_path / "b.stl")


# Frames


def test_frames_return_what_was_sent() -> None:
    stream = BytesIO()
    arrays = [np.arange(6.0).reshape(2, 3), np.empty((0, 3), int), np.arange(4)[:, None][::-1]]
    write_frame(stream, {"a": ["ü", None, 1.5]}, arrays)
    stream.seek(0)
    found = read_frame(stream, largest=80)
    assert found.content == {"a": ["ü", None, 1.5]}
    for ours, theirs in zip(arrays, found.arrays, strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("seed", range(200))
def test_corrupted_frames_are_refused_or_well_formed(seed: int) -> None:
    stream = BytesIO()
    write_frame(stream, {**ANSWER}, [np.eye(3), np.array([[0, 1, 2]])])
    rng = np.random.default_rng(seed)
    data = bytearray(stream.getvalue())
    for place in rng.integers(len(data), size=rng.integers(1, 4)):
        data[place] = rng.integers(256)
    cut = data[: rng.integers(len(data))] if seed % 3 == 0 else data
    try:
        found = read_frame(BytesIO(bytes(cut)), largest=1000)
    except (EOFError, ValueError):
        return
    assert isinstance(found, Frame)
    assert all(array.ndim == 2 for array in found.arrays)


# What has an area


def test_lines_alone_are_no_surface() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2.0, 0, 0]])
    lines, triangle = np.array([[0, 1, 3], [1, 1, 2]]), np.array([[0, 1, 2]])
    with pytest.raises(MeshError, match="all of its 2 faces are lines or points"):
        Contents(kind="stl", parts=[Part(name="a", points=points, faces=lines)])
    Contents(kind="stl", parts=[Part(name="a", points=points, faces=np.vstack([lines, triangle]))])


@pytest.mark.parametrize("scale", [1e-59, 1e-3, 1e59])
def test_needles_are_no_lines_at_any_scale(scale: float) -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1e-9, 0]]) * scale
    part = Part(name="a", points=points, faces=np.array([[0, 1, 2]]))
    assert Contents(kind="stl", parts=[part]).parts == [part]


# Archives


def zipped(path: Path, members: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return path


PACKED: dict[str, Callable[[bytes], bytes]] = {
    "gz": gzip.compress,
    "bz2": bz2.compress,
    "xz": lzma.compress,
}


@pytest.mark.parametrize("packing", PACKED)
def test_packed_mesh(tmp_path: Path, packing: str) -> None:
    pack = PACKED[packing]
    path = saved(tmp_path / f"A.OBJ.{packing.upper()}", pack(TETRAHEDRON.encode()))
    body = load_mesh(path)
    assert body.volume == pytest.approx(1 / 6)
    assert body.up == "y"
    halves = [pack(TETRAHEDRON[:30].encode()), pack(TETRAHEDRON[30:].encode())]
    saved(path, b"".join(halves))
    assert load_mesh(path).volume == pytest.approx(1 / 6)
    for cut in (1, 20, -1):
        assert "cannot be unpacked" in refused_by_all(saved(path, pack(b"v 0 0 0\n" * 99)[:cut]))
    assert "empty once unpacked" in refused_by_all(saved(path, pack(b"")))


@pytest.mark.prove
def test_zipped_mesh_among_other_things(tmp_path: Path) -> None:
    members = {
        "cup/": b"",
        "cup/licence.txt": b"free",
        "cup/cup.stl": trimesh.creation.box().export(file_type="stl"),
        "__MACOSX/cup/._cup.stl": b"x",
    }
    body = load_mesh(zipped(tmp_path / "a.zip", members))
    assert body.volume == pytest.approx(1)
    assert body.up == "z"


def test_zipped_gltf_with_its_buffer(tmp_path: Path) -> None:
    files = trimesh.creation.box().export(file_type="gltf")
    members = {f"cup/{name}": content for name, content in files.items()}
    assert load_mesh(zipped(tmp_path / "a.zip", members)).volume == pytest.approx(1)
    alone = {"cup/model.gltf": files["model.gltf"]}
    assert "the archive has no" in refused_by_all(zipped(tmp_path / "a.zip", alone))


@pytest.mark.parametrize(
    ("members", "message"),
    [
        ({"a.txt": b"x"}, "holds 0 mesh files"),
        ({"a.obj": b"x", "b/b.stl": b"x"}, "holds 2 mesh files"),
        ({"a.obj": b"x", "../b.txt": b"x"}, "names '../b.txt', and only files beside"),
        ({"../a.obj": b"x"}, "names '../a.obj'"),
        ({"a\\..\\..\\a.obj": b"x"}, "and only files beside"),
        ({"/a.obj": b"x"}, "names '/a.obj'"),
        ({"C:a.obj": b"x"}, "names 'C:a.obj'"),
        ({"a.obj": b"x", "b.zip": b"x"}, "an archive in an archive, 'b.zip'"),
        ({"a.obj.gz": b"x"}, "an archive in an archive"),
        ({"a.obj": gzip.compress(b"v 0 0 0")}, "an archive in an archive"),
        ({"a.obj": b""}, "empty once unpacked"),
        ({f"{i}.txt": b"" for i in range(1001)}, "holds 1001 files, and 1000 are taken"),
        ({f"{i:0200}.txt": b"" for i in range(5000)}, "table of contents is larger"),
    ],
)
def test_archives_that_are_refused(tmp_path: Path, members: dict[str, bytes], message: str) -> None:
    assert message in refused_by_all(zipped(tmp_path / "a.zip", members))


def test_links_in_archives_are_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        link = zipfile.ZipInfo("a.obj")
        link.external_attr = 0o120777 << 16
        archive.writestr(link, "/etc/passwd")
    assert "it holds a link, 'a.obj'" in refused_by_all(tmp_path / "a.zip")


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_methods_that_unpack_without_bounds_are_refused(tmp_path: Path, method: int) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w", method) as archive:
        archive.writestr("a.obj", TETRAHEDRON)
    assert "pack it by deflate" in refused_by_all(tmp_path / "a.zip")


@pytest.mark.parametrize("seed", range(30))
def test_damaged_archives(tmp_path: Path, seed: int) -> None:
    kind = ["gz", "bz2", "xz", "zip"][seed % 4]
    rng = np.random.default_rng(seed)
    path = tmp_path / f"a.obj.{kind}"
    if kind == "zip":
        zipped(path, {"a.obj": TETRAHEDRON.encode()})
    else:
        saved(path, PACKED[kind](TETRAHEDRON.encode()))
    data = bytearray(path.read_bytes())
    data[rng.integers(len(data))] ^= rng.integers(1, 256)
    saved(path, bytes(data))
    try:
        assert len(read_contents(path).parts) == 1
    except MeshError as error:
        assert "\n" not in str(error)  # noqa: PT017


# Traps

MEBIBYTE = bytes(MIB)


def blown_up(make: Callable[[], bz2.BZ2Compressor | lzma.LZMACompressor], count: int) -> bytes:
    packer = make()
    return b"".join([*(packer.compress(MEBIBYTE) for _ in range(count)), packer.flush()])


@pytest.mark.prove
def test_bz2_of_few_bytes_that_asks_for_gigabytes(tmp_path: Path) -> None:
    """Streams in a row: 40 bytes of bz2 hold 45 MB, and ten thousand of them hold 450 GB."""
    one = bz2.compress(bytes(45_000_000))
    assert len(one) < 100
    message = refused_by_all(saved(tmp_path / "a.stl.bz2", one))
    assert "no honest file packs better than 200 to 1" in message
    refused_by_all(saved(tmp_path / "a.stl.bz2", one * 10_000))


@pytest.mark.parametrize("packing", ["gz", "xz", "zip"])
def test_bombs(tmp_path: Path, packing: str) -> None:
    path = tmp_path / f"a.obj.{packing}"
    if packing == "xz":
        saved(path, blown_up(lambda: lzma.LZMACompressor(preset=0), 64))
    elif packing == "gz":
        with gzip.open(path, "wb", compresslevel=1) as file:
            for _ in range(64):
                file.write(MEBIBYTE)
    else:
        zipped(path, {"a.obj": bytes(64 * MIB)})
    assert "no honest file packs better than 200 to 1" in refused_by_all(path)


@pytest.mark.prove
def test_zip_that_says_it_is_too_large(tmp_path: Path) -> None:
    path = tmp_path / "a.zip"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("a.obj", "w") as member,
    ):
        for _ in range(257):
            member.write(MEBIBYTE)
    assert "268435456 are read" in refused_by_all(path)


def test_zip_that_lies_about_its_size(tmp_path: Path) -> None:
    path = zipped(tmp_path / "a.zip", {"a.obj": b"v 0 0 0\n" * 4_000_000})
    data = path.read_bytes()
    true = (32_000_000).to_bytes(4, "little")
    assert data.count(true) == 2
    assert "cannot be unpacked" in refused_by_all(
        saved(path, data.replace(true, (100).to_bytes(4, "little")))
    )


def test_dictionary_of_half_a_gigabyte(tmp_path: Path) -> None:
    filters = [{"id": lzma.FILTER_LZMA2, "dict_size": 2**20}]
    data = bytearray(lzma.compress(TETRAHEDRON.encode(), filters=filters, check=lzma.CHECK_CRC32))
    # The block header: its size, flags, filter, size of properties, dictionary as a power, CRC.
    assert data[14:16] == b"\x21\x01"
    data[16] = 34  # 512 MiB
    header = bytes(data[12:20])
    data[20:24] = zlib.crc32(header).to_bytes(4, "little")
    message = refused_by_all(saved(tmp_path / "a.obj.xz", bytes(data)))
    assert "Memory usage limit" in message


@pytest.mark.parametrize("text", ["[" * 10**6, '{"a":' * 10**6, '{"nodes":' + "[" * 10**6])
def test_deep_headers(tmp_path: Path, text: str) -> None:
    assert "cannot be read as GLTF" in refused_by_all(saved(tmp_path / "a.gltf", text))
    chunk = text.encode() + b" " * (-len(text) % 4)
    head = b"glTF" + np.array([2, 20 + len(chunk), len(chunk)], "<u4").tobytes() + b"JSON"
    assert "cannot be read as GLB" in refused_by_all(saved(tmp_path / "a.glb", head + chunk))


PLY = (
    "ply\nformat ascii 1.0\nelement vertex {0}\nproperty float x\nproperty float y\n"
    "property float z\nelement face {1}\nproperty list uchar int vertex_indices\nend_header\n0 0 0"
)
HUGE: dict[str, bytes | str] = {
    "vertices.ply": PLY.format(10**9, 1),
    "faces.ply": PLY.format(1, 10**9),
    "endless.ply": "ply\nformat ascii 1.0\n" + "comment x\n" * 10**6,
    "blank.ply": "ply\n" + "\n" * 10**6,
    "counts.off": "OFF\n1000000000 1000000000 0\n0 0 0\n",
    "count.stl": bytes(80) + b"\xff\xff\xff\xff" + bytes(50),
    "blank.stl": "solid x\nfacet" + "\n" * 10**6 + "endfacet",
    "word.obj": "v " + "1" * 10**7,
    "parts.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\n" + "".join(f"g {i}\nf 1 2 3\n" for i in range(10001)),
}


@pytest.mark.parametrize("name", HUGE)
def test_huge_headers(tmp_path: Path, name: str) -> None:
    refused_by_all(saved(tmp_path / name, HUGE[name]), seconds=2)


# glTF and the files that it names


def gltf(path: Path, **changes: object) -> Path:
    header = json.loads(trimesh.creation.box().export(file_type="gltf")["model.gltf"])
    header.update(changes)
    return saved(path, json.dumps(header))


@pytest.mark.parametrize(
    "address",
    [
        *("../b.bin", "%2e%2e/b.bin", "a/../../b.bin", "..\\b.bin", "/dev/zero", "/etc/passwd"),
        *("http://localhost/b.bin", "file:///etc/passwd", "C:\\b.bin", "a\0b.bin", ""),
    ],
)
def test_buffers_elsewhere_are_refused(tmp_path: Path, address: str) -> None:
    path = gltf(tmp_path / "a.gltf", buffers=[{"uri": address, "byteLength": 4}])
    assert "only files beside or below it are read" in refused_by_all(path)


def test_buffers_below_and_with_spaces_are_read(tmp_path: Path) -> None:
    files = trimesh.creation.box().export(file_type="gltf")
    header = json.loads(files["model.gltf"])
    (tmp_path / "my data").mkdir()
    for number, buffer in enumerate(header["buffers"]):
        saved(tmp_path / f"my data/{number}.bin", files[buffer["uri"]])
        buffer["uri"] = f"my%20data/{number}.bin"
    path = saved(tmp_path / "a.gltf", json.dumps(header))
    assert load_mesh(path).volume == pytest.approx(1)


def test_buffers_count_together(tmp_path: Path) -> None:
    saved(tmp_path / "b.bin", bytes(1000))
    path = gltf(tmp_path / "a.gltf", buffers=[{"uri": "b.bin", "byteLength": 4}] * 50)
    guard = Guard(ReadingLimits(size=20_000))
    message = refused(guard, path)
    assert "and 20000 are read" in message
    guard.close()


@pytest.mark.prove
def test_one_surface_placed_many_times_is_bounded(tmp_path: Path) -> None:
    body = trimesh.creation.icosphere(subdivisions=3)
    header = json.loads(body.export(file_type="gltf", embed_buffers=True)["model.gltf"])
    header["nodes"] = [{"name": f"n{i}", "mesh": 0} for i in range(100)]
    header["scenes"] = [{"nodes": list(range(100))}]
    guard = Guard(ReadingLimits(faces=50_000))
    message = refused(guard, saved(tmp_path / "a.gltf", json.dumps(header)))
    assert "51200 faces or more, and 50000 are read" in message
    guard.close()


@pytest.mark.parametrize("children", [[1, 1], [0], [1, 0]])
def test_nodes_in_circles_and_diamonds_end(tmp_path: Path, children: list[int]) -> None:
    body = trimesh.creation.box()
    header = json.loads(body.export(file_type="gltf", embed_buffers=True)["model.gltf"])
    steps = [[i + child for child in children] for i in range(40)]
    header["nodes"] = [{"name": f"n{i}", "children": each} for i, each in enumerate(steps)]
    header["nodes"].append({"name": "leaf", "mesh": 0})
    header["scenes"] = [{"nodes": [0]}]
    started = time.perf_counter()
    try:
        read_contents(saved(tmp_path / "a.gltf", json.dumps(header)))
    except MeshError as error:
        assert "took longer" not in str(error)  # noqa: PT017
    assert time.perf_counter() - started < 5


def test_what_people_are_told_of_the_limits_holds() -> None:
    told = (Path(__file__).parents[2] / "SECURITY.md").read_text("utf-8")
    limits = ReadingLimits()
    assert f"{limits.memory / 2**30:g} GB of memory" in told
    assert f"{limits.seconds:g} s of processor time and {limits.wall:g} s of clock" in told
