"""The work behind the room: formulas first, progress told, and a room that fills itself."""

from __future__ import annotations

import asyncio
import json
import signal
import socket
import subprocess
import sys
import threading
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import struck
from struck.explorer.facts import facts, peak
from struck.explorer.jobs import PROCESSES, Jobs
from struck.explorer.objects import furniture, table, things
from struck.explorer.server import Explorer
from struck.solids.revolution import bell
from tests.explorer.served import Client, opened, patience


def test_room_is_that_of_1998_and_more() -> None:
    names = [thing.name for thing in things()]
    assert len(set(names)) == len(names) == 18
    assert {"string", "bar", "rod", "table", "chair", "square", "l_membrane", "plate"} < set(names)
    assert {"bowl", "bell", "figurine", "tabla", *(f"chime_{n}" for n in range(1, 7))} < set(names)
    kinds = [thing.kind for thing in things()]
    assert kinds[:6] == ["formula"] * 6
    for thing in things():
        turn = np.asarray(thing.rotation)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)


def test_furniture_is_one_body_of_the_volume_of_its_boards() -> None:
    top = 0.9 * 0.56 * 0.03
    assert table().volume() == pytest.approx(top + 4 * 0.055**2 * 0.47, rel=1e-9)
    joined = furniture(((0, 0, 0), (100, 20, 20)), ((50, 0, 0), (100, 20, 20)))
    assert joined.volume() == pytest.approx(0.15 * 0.02 * 0.02, rel=1e-9)


@pytest.mark.prove
def test_something_sounds_soon_progress_is_told_and_control_c_ends_it_all(
    tmp_path: Path,
) -> None:
    """Of the start of the server, with nothing cached: at most 10 s."""
    limit, begun = 10 * patience(), time.monotonic()
    process = opened(tmp_path)
    assert process.stderr is not None
    client = Client(process.stderr.readline().strip())
    client.enter()
    ready: list[dict] = []
    while not ready:
        assert time.monotonic() - begun < limit
        time.sleep(0.05)
        told = client.ask("GET", "/api/room").json["objects"]
        ready = [one for one in told if one["state"] == "ready"]
    assert client.ask("GET", f"/models/{ready[0]['id']}.struck").status == 200
    assert ready[0]["facts"]["modes"] > 5
    assert ready[0]["facts"]["peak"] > 0
    assert len(ready[0]["facts"]["points"]) == 10
    assert any(one["state"] == "working" for one in told)
    process.send_signal(signal.SIGINT)
    # Workers hold the same standard error: it ends with the last of them.
    out, err = process.communicate(timeout=20)
    assert process.returncode == 0, err
    assert not err.splitlines()[1:]  # but how to end it
    assert "closed" in out
    with socket.socket() as probe, pytest.raises(ConnectionRefusedError):
        probe.connect(("127.0.0.1", client.port))


def test_processes_have_ended_when_the_room_is_cancelled(tmp_path: Path) -> None:
    """Else their pipes outlive the loop, which is told as errors while Python ends."""

    async def cancelled() -> list[str]:
        jobs = Jobs(things(), tmp_path)
        work = asyncio.create_task(jobs.run())
        async for _ in jobs.news():
            if sum(job.state == "working" for job in jobs.jobs.values()) == PROCESSES:
                break
        work.cancel()
        await asyncio.gather(work, return_exceptions=True)
        return [str(task) for task in asyncio.all_tasks() if task is not asyncio.current_task()]

    with ThreadPoolExecutor(1) as thread:  # a browser of another test may have a loop in this one
        assert thread.submit(asyncio.run, cancelled()).result() == []


def test_control_c_waits_for_the_thread_of_the_server() -> None:
    bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
    explorer = Explorer(given=[struck.analyze(bar, "steel")], names=["bar"])
    limit = 20 * patience()
    timer = threading.Timer(0.4, signal.raise_signal, [signal.SIGINT])
    timer.start()
    explorer.wait(limit)
    timer.join()
    assert explorer._thread.ident not in sys._current_frames()


def test_object_that_fails_says_why(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from struck.explorer.jobs import _answer, _ProgressWriter

    class Lines:
        def __init__(self) -> None:
            self.text = ""

        def write(self, text: str) -> None:
            self.text += text

        def flush(self) -> None:
            """Nothing is kept back."""

    stream = Lines()
    teller = _ProgressWriter(stream)
    thing = next(thing for thing in things() if thing.name == "bar")
    answer = _answer(thing, tmp_path / "missing" / "bar.struck", teller)
    assert answer["state"] == "failed"
    assert "missing" in answer["message"]
    lines = [json.loads(line) for line in stream.text.splitlines()]
    assert all(0 <= line["fraction"] <= 1 for line in lines)
    capsys.readouterr()
    # A fault of its options is none of the person's: its words are for the terminal.
    refused = replace(thing, make=lambda _progress: struck.analyze(table(), "oak", wall=0.01))
    answer = _answer(refused, tmp_path / "bar.struck", teller)
    assert answer["state"] == "failed"
    assert "fault of struck" in answer["message"]
    assert "=" not in answer["message"]
    assert "wall= applies to surfaces" in capsys.readouterr().err


@pytest.mark.prove
def test_facts_of_a_recording_name_no_place_on_it() -> None:
    thing = next(thing for thing in things() if thing.name == "tabla")
    told = facts(thing.make(lambda _stage, _fraction: None))
    assert told["points"] == [{"name": told["points"][0]["name"], "point": None, "direction": None}]
    assert not told["calibrated"]


def test_points_lie_on_the_body_and_apart() -> None:
    body = struck.solids.Block(size=(0.1, 0.02, 0.01))
    model = struck.analyze(body, "steel", accuracy="preview")
    points = facts(model)["points"]
    places = np.array([each["point"] for each in points])
    assert len(points) == 10
    _, _, nearest = model.gains.locator.closest(places)
    np.testing.assert_allclose(nearest, places, atol=1e-12)
    apart = np.linalg.norm(places[:, None] - places, axis=-1) + np.eye(10)
    assert apart.min() > 0.001
    np.testing.assert_array_equal(places[0], model.contact().point)  # where space strikes it
    assert points[0]["name"] == (model.contact().name or "where its lowest modes speak most")


def test_the_first_point_of_a_bell_is_its_rim() -> None:
    cast = replace(bell(), elements=(16, 8, 1))
    points = facts(struck.analyze(cast, "bronze", band=(20, 2000)))["points"]
    assert points[0]["name"] == "rim"
    assert "rim" not in [each["name"] for each in points[1:]]


def test_level_of_a_body_without_modes_is_that_of_its_recoil() -> None:
    """Recoil that is fast beside a force F is heard at its level times the greatest |dF/dt|."""
    die = struck.analyze(
        struck.solids.Block(size=(0.016, 0.016, 0.016)), "steel", accuracy="preview", band=(20, 2e3)
    )
    assert not len(die.frequencies)
    assert die.recoil is not None
    usual = struck.Strike(at="top", striker="wood", speed=1.0)
    blow = usual.resolved(die, die.contact("top"))
    # Half a sine, pi J / (2 T) sin(pi t / T), is steepest as it begins.
    steepest = blow.impulse * np.pi**2 / (2 * blow.duration**2)
    assert 0.8 < peak(die, "top") / (die.recoil.levels.max() * steepest) < 1.05
    assert facts(die)["peak"] >= peak(die, "top")
    assert peak(replace(die, recoil=None), "top") == 0.0


def fill_room(seconds: float) -> None:
    """Wait until every object of the room is ready, at most this long, s."""
    begun = time.monotonic()
    with Explorer(things()) as explorer:
        client = Client(explorer.url)
        client.enter()
        states: list[str] = []
        while not states or set(states) - {"ready"}:
            assert "failed" not in states
            assert time.monotonic() - begun < seconds
            time.sleep(0.5)
            states = [one["state"] for one in client.ask("GET", "/api/room").json["objects"]]
    assert len(states) == 18


@pytest.mark.prove
def test_every_object_of_the_room_becomes_ready(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STRUCK_CACHE", str(tmp_path))
    fill_room(1200)  # on a busy machine too


@pytest.mark.prove
@pytest.mark.timed
def test_whole_room_stands_within_two_minutes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STRUCK_CACHE", str(tmp_path))
    fill_room(120)


@pytest.mark.prove
def test_wheel_holds_the_page_and_its_licences_and_is_small(tmp_path: Path) -> None:
    root = Path(__file__).parents[2]
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)],
        cwd=root,
        check=True,
        capture_output=True,
    )
    (wheel,) = tmp_path.glob("*.whl")
    assert wheel.stat().st_size < 6e6
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    static = root / "src/struck/explorer/static"
    page = [path.relative_to(root / "src").as_posix() for path in static.rglob("*.*")]
    assert names >= {name for name in page if Path(root / "src" / name).is_file()}
    assert "struck/core/libraries/core.wasm" in names
    assert "struck/explorer/static/vendor/three/LICENSE" in names
    assert "struck/ears/kemar.md" in names
