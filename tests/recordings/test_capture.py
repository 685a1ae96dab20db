"""Measurements by a plan, against a simulated device."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from struck.errors import FileFormatError, OptionError, RecordingError
from struck.files import wav
from struck.files.sound import Sound
from struck.recordings.capture import CapturedTake, Outcome, SimulatedRecorder, capture
from struck.recordings.capture_plan import (
    CapturePlan,
    Hooks,
    PlannedContact,
    PlannedListener,
    Point,
    read_plan,
)
from struck.recordings.manifest import read_manifest
from tests.recordings.hits import LEAD_IN, RATE, SECONDS, clip, end_early, hit, write


def plan(folder: Path, text: str = "") -> CapturePlan:
    """Return a plan of two contacts, two listeners and two hits, but for what `text` changes."""
    usual = (
        f"seconds = {SECONDS}\nlead_in = {LEAD_IN}\nsample_rate = {RATE}\nhits = 2\n"
        "contacts = [[1.0], [0.5]]\nlisteners = [[0, 1, 0], [0, 0, 1]]\n"
    )
    path = folder / "plan.toml"
    path.write_text(usual + text)
    return read_plan(path)


NAMES = [f"contact{c}_listener{q}_{n}.wav" for c in (1, 2) for q in (1, 2) for n in (1, 2)]


@pytest.fixture
def simulation(tmp_path: Path) -> Path:
    """Return a folder of good takes for `plan`."""
    folder = tmp_path / "simulated"
    folder.mkdir()
    for number, name in enumerate(NAMES):
        write(folder / name, hit(peak=0.3 + 0.05 * number, seed=number))
    return folder


class Notes:
    """An operator who writes down what is asked and told."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.told: list[str] = []

    def ready(self, text: str) -> None:
        self.asked.append(text)

    def tell(self, text: str) -> None:
        self.told.append(text)


def run(
    wanted: CapturePlan, folder: Path, simulation: Path, operator: Notes | None = None
) -> Outcome:
    return capture(wanted, folder, SimulatedRecorder(simulation), operator=operator)


def test_every_planned_take_is_recorded_with_its_place(tmp_path: Path, simulation: Path) -> None:
    notes, heard = Notes(), list[tuple[str, float]]()
    outcome = capture(
        plan(tmp_path),
        tmp_path / "takes",
        SimulatedRecorder(simulation),
        operator=notes,
        progress=lambda stage, share: heard.append((stage, share)),
    )
    assert (outcome.recorded, outcome.earlier, outcome.refusals) == (8, 0, ())
    manifest = read_manifest(outcome.manifest)
    assert [entry.file for entry in manifest.entries] == NAMES
    np.testing.assert_array_equal(manifest.contacts, [[1.0], [0.5]])
    np.testing.assert_array_equal(manifest.listeners, [[0, 1, 0], [0, 0, 1]])
    assert manifest.pairs.tolist() == [[c, q] for c in (0, 1) for q in (0, 1) for _ in (1, 2)]
    assert [entry.hit for entry in manifest.entries] == [1, 2] * 4
    assert {entry.sample_rate for entry in manifest.entries} == {RATE}
    assert {entry.lead_in for entry in manifest.entries} == {LEAD_IN}
    for number, entry in enumerate(manifest.entries):
        assert entry.peak == pytest.approx(20 * np.log10(0.3 + 0.05 * number), abs=0.02)
        recorded = wav.decode((tmp_path / "takes" / entry.file).read_bytes())
        assert np.abs(recorded.samples).max() == pytest.approx(0.3 + 0.05 * number, abs=1e-3)
    assert notes.asked[1] == ("contact1_listener1, hit 2 of 2: contact 1.0; listener 0.0,1.0,0.0")
    assert notes.told == ["strike now"] * 8
    assert heard[0] == ("recording contact1_listener1", 0.0)
    assert heard[-1] == ("recording", 1.0)
    assert [share for _, share in heard] == sorted(share for _, share in heard)


def test_a_clipped_take_is_refused_and_repeated(tmp_path: Path, simulation: Path) -> None:
    write(simulation / NAMES[3], clip(hit()))
    write(simulation / NAMES[3].replace(".wav", ".2.wav"), end_early(hit()))
    write(simulation / NAMES[3].replace(".wav", ".3.wav"), hit(peak=0.123))
    notes = Notes()
    outcome = run(plan(tmp_path), tmp_path / "takes", simulation, notes)
    assert [(each.file, each.attempt) for each in outcome.refusals] == [
        (NAMES[3], 1),
        (NAMES[3], 2),
    ]
    assert "clipped" in outcome.refusals[0].reason
    assert "cut short" in outcome.refusals[1].reason
    assert any("is refused: channel 1 is clipped" in text for text in notes.told)
    assert "attempt 3" in notes.asked[5]
    kept = wav.decode((tmp_path / "takes" / NAMES[3]).read_bytes())
    assert np.abs(kept.samples).max() == pytest.approx(0.123, abs=1e-3)


def test_what_a_recorder_notes_is_a_reason_to_refuse(tmp_path: Path, simulation: Path) -> None:
    class Losing(SimulatedRecorder):
        def record(
            self, take: CapturedTake, seconds: float, lead_in: float, cue: Callable[[], None]
        ) -> Sound:
            sound = super().record(take, seconds, lead_in, cue)
            notes = ("samples were lost",) if take.attempt == 1 else ()
            return Sound(samples=sound.samples, sample_rate=sound.sample_rate, notes=notes)

    outcome = capture(plan(tmp_path), tmp_path / "takes", Losing(simulation))
    assert {each.reason for each in outcome.refusals} == {"samples were lost"}
    assert (outcome.recorded, len(outcome.refusals)) == (8, 8)


@pytest.mark.prove
def test_a_measurement_goes_on_where_it_was_stopped(tmp_path: Path, simulation: Path) -> None:
    write(simulation / NAMES[5], clip(hit()))
    wanted, folder = plan(tmp_path, "tries = 2\n"), tmp_path / "takes"
    with pytest.raises(RecordingError, match=r"_2\.wav was refused 2 times .* start again") as told:
        run(wanted, folder, simulation)
    assert "clipped" in str(told.value)
    assert len(read_manifest(folder / "manifest.toml").entries) == 5
    times = {name: (folder / name).stat().st_mtime_ns for name in NAMES[:5]}
    write(simulation / NAMES[5], hit())
    notes = Notes()
    outcome = run(wanted, folder, simulation, notes)
    assert (outcome.recorded, outcome.earlier) == (3, 5)
    assert len(notes.asked) == 3
    assert {name: (folder / name).stat().st_mtime_ns for name in NAMES[:5]} == times
    whole = run(wanted, tmp_path / "others", simulation).manifest.read_bytes()
    assert outcome.manifest.read_bytes() == whole


def test_a_take_whose_file_has_gone_is_recorded_again(tmp_path: Path, simulation: Path) -> None:
    wanted, folder = plan(tmp_path), tmp_path / "takes"
    run(wanted, folder, simulation)
    (folder / NAMES[2]).unlink()
    outcome = run(wanted, folder, simulation)
    assert (outcome.recorded, outcome.earlier) == (1, 7)
    assert len(read_manifest(outcome.manifest).entries) == 8


PROGRAM = """
import sys, time
from pathlib import Path
from struck.recordings.capture import capture
from struck.recordings.capture_plan import read_plan
from struck.recordings.capture import SimulatedRecorder

class Slow(SimulatedRecorder):
    def record(self, *given):
        sound = super().record(*given)
        time.sleep(0.02)
        return sound

capture(read_plan(sys.argv[1]), Path(sys.argv[2]), Slow(Path(sys.argv[3])))
"""


@pytest.mark.skipif(os.name == "nt", reason="signals are asked for")
def test_a_killed_measurement_leaves_whole_files_and_goes_on(
    tmp_path: Path, simulation: Path
) -> None:
    wanted, folder = plan(tmp_path), tmp_path / "takes"
    command = [sys.executable, "-c", PROGRAM, tmp_path / "plan.toml", folder, simulation]
    process = subprocess.Popen(command)
    give_up = time.monotonic() + 30
    while not (folder / NAMES[2]).exists():
        assert process.poll() is None
        assert time.monotonic() < give_up
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    process.wait()
    done = read_manifest(folder / "manifest.toml").entries
    assert 2 <= len(done) < 8
    for path in folder.glob("*.wav"):
        assert wav.decode(path.read_bytes()).samples.shape[1] > SECONDS * RATE
    outcome = run(wanted, folder, simulation)
    assert (outcome.recorded, outcome.earlier) == (8 - len(done), len(done))
    assert [entry.file for entry in read_manifest(outcome.manifest).entries] == NAMES
    assert sorted(path.name for path in folder.iterdir()) == sorted([*NAMES, "manifest.toml"])


def test_takes_of_another_plan_are_not_taken_for_these(tmp_path: Path, simulation: Path) -> None:
    folder = tmp_path / "takes"
    run(plan(tmp_path), folder, simulation)
    text = (tmp_path / "plan.toml").read_text()
    (tmp_path / "plan.toml").write_text(text.replace("[[1.0], [0.5]]", "[[0.9], [0.5]]"))
    with pytest.raises(RecordingError, match=r"contact \(1.0,\).* the plan says \(0.9,\)"):
        run(read_plan(tmp_path / "plan.toml"), folder, simulation)
    (tmp_path / "plan.toml").write_text(text.replace(f"rate = {RATE}", "rate = 48000"))
    with pytest.raises(RecordingError, match="16000 Hz, and now 48000 Hz"):
        run(read_plan(tmp_path / "plan.toml"), folder, simulation)


def test_a_device_of_another_rate_is_refused(tmp_path: Path, simulation: Path) -> None:
    write(simulation / NAMES[0], hit(), rate=22_050)
    with pytest.raises(RecordingError, match="records at 22050 Hz and the plan says 16000 Hz"):
        run(plan(tmp_path), tmp_path / "takes", simulation)


HOOK = """
import os, sys
with open("log", "a") as log:
    print(*sys.argv[1:], os.environ["STRUCK_HIT"], os.environ["STRUCK_LISTENER"], file=log)
"""


def hooks(**commands: str) -> str:
    lines = [f"{which} = [{sys.executable!r}, {command}]" for which, command in commands.items()]
    return "[hooks]\n" + "\n".join(lines)


def test_hooks_move_before_each_point_and_strike_in_each_take(
    tmp_path: Path, simulation: Path
) -> None:
    (tmp_path / "hook.py").write_text(HOOK)
    text = hooks(move="'hook.py', 'to {z} of {name}'", strike="'hook.py', 'at {u}'")
    wanted, notes = plan(tmp_path, text), Notes()
    run(wanted, tmp_path / "takes", simulation, notes)
    log = (tmp_path / "log").read_text().splitlines()
    assert log[:4] == [
        "to 0.0 of contact1_listener1 1 0.0,1.0,0.0",
        "at 1.0 1 0.0,1.0,0.0",
        "at 1.0 2 0.0,1.0,0.0",
        "to 1.0 of contact1_listener2 1 0.0,0.0,1.0",
    ]
    assert len(log) == 4 + 8
    assert (wanted.prompt, wanted.patience) == ("never", 1.0)
    assert not notes.asked
    assert not notes.told
    run(wanted, tmp_path / "takes", simulation)
    assert len((tmp_path / "log").read_text().splitlines()) == 12


def test_a_person_can_be_asked_when_the_contact_changes(tmp_path: Path, simulation: Path) -> None:
    notes = Notes()
    run(plan(tmp_path, "prompt = 'contact'\n"), tmp_path / "takes", simulation, notes)
    assert [text.partition(",")[0] for text in notes.asked] == [
        "contact1_listener1",
        "contact2_listener1",
    ]


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("'-c', 'import sys; sys.exit(\"the arm is stuck\")'", "exit code 1: the arm is stuck"),
        ("'-c', 'import time; time.sleep(60)'", r"did not end within 0.3 s \(hooks.timeout\)"),
    ],
)
def test_a_hook_that_fails_stops_the_measurement(
    command: str, words: str, tmp_path: Path, simulation: Path
) -> None:
    begun = time.monotonic()
    wanted = plan(tmp_path, hooks(move=command) + "\ntimeout = 0.3\n")
    with pytest.raises(RecordingError, match=words):
        run(wanted, tmp_path / "takes", simulation)
    assert time.monotonic() - begun < 10
    assert not list((tmp_path / "takes").iterdir())


def test_a_hook_that_is_not_there_is_named(tmp_path: Path, simulation: Path) -> None:
    wanted = CapturePlan(
        seconds=SECONDS,
        contacts=(PlannedContact(name="a", at=(1.0,)),),
        hooks=Hooks(move=("./nothing",)),
    )
    with pytest.raises(RecordingError, match=r"\./nothing, cannot be started: No such file"):
        run(wanted, tmp_path / "takes", simulation)


def test_p_plus_q_records_a_row_and_a_column_at_the_best_contact(tmp_path: Path) -> None:
    wanted = plan(
        tmp_path,
        "pairs = 'P+Q'\npivot = 'listener2'\n",
    )
    text = (tmp_path / "plan.toml").read_text()
    (tmp_path / "plan.toml").write_text(
        text.replace("[[1.0], [0.5]]", "[[1.0], [0.5], [0.0]]").replace(
            "[0, 0, 1]]", "[0, 0, 1], [1, 0, 0]]"
        )
    )
    wanted = read_plan(tmp_path / "plan.toml")
    simulation = tmp_path / "simulated"
    simulation.mkdir()
    # The second contact drives all three modes; the others have one that is silent.
    gains = {1: [1, 0.001, 1], 2: [0.9, 0.9, 0.9], 3: [0.001, 1, 0.5]}
    for contact, strengths in gains.items():
        for listener in (1, 2, 3):
            for number in (1, 2):
                name = f"contact{contact}_listener{listener}_{number}.wav"
                write(simulation / name, hit(gains=np.array(strengths, float), seed=number))
    outcome = run(wanted, tmp_path / "takes", simulation)
    manifest = read_manifest(outcome.manifest)
    files = [entry.file[:-6] for entry in manifest.entries[::2]]
    assert files[:5] == [
        "contact1_listener2",
        "contact2_listener2",
        "contact3_listener2",
        "contact2_listener1",
        "contact2_listener3",
    ]
    assert len(files) == 6
    assert files[5].startswith(("contact1_", "contact3_"))
    assert (outcome.recorded, wanted.count) == (12, 12)
    (tmp_path / "takes" / f"{files[4]}_1.wav").unlink()
    again = run(wanted, tmp_path / "takes", simulation)
    assert (again.recorded, again.earlier) == (1, 11)


def test_several_channels_and_named_and_spherical_places(tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    path.write_text(
        f"seconds = {SECONDS}\nlead_in = {LEAD_IN}\nchannels = 2\ndevice = 'USB'\n"
        "[[contacts]]\nname = 'rim'\nat = [1.0, 0.25]\n"
        "[[listeners]]\nname = 'front'\nmicrophones = [[1, 0, 0], [0, 1, 0]]\n"
    )
    wanted = read_plan(path)
    simulation = tmp_path / "simulated"
    simulation.mkdir()
    write(simulation / "rim_front_1.wav", np.concatenate([hit(), hit(peak=0.2, seed=2)]))
    manifest = read_manifest(run(wanted, tmp_path / "takes", simulation).manifest)
    assert manifest.entries[0].listeners == ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    assert manifest.pairs.tolist() == [[0, 0], [0, 1]]
    write(simulation / "rim_front_1.wav", hit())
    with pytest.raises(RecordingError, match="1 channels instead of 2"):
        run(wanted, tmp_path / "again", simulation)
    path.write_text(
        f"seconds = {SECONDS}\n[[points]]\ncontact = [0.5]\n"
        "spherical_degrees = [2, 90, 90]\nhits = 3\n"
    )
    [point] = read_plan(path).every()
    assert (point.name, point.contact, point.hits) == ("point1", (0.5,), 3)
    np.testing.assert_allclose(point.listeners, [[0, 2, 0]], atol=1e-12)


BAD_PLANS = {
    "no seconds": ("contacts = [[1.0]]", "seconds is missing: give a number from 0.05 to 600"),
    "a name for a number": ("seconds = 'two'\ncontacts = [[1.0]]", "seconds is 'two'"),
    "no places": ("seconds = 1", "give either contacts"),
    "places by a misspelt name": ("seconds = 1\ncontact = [[0.1]]", "contact.*contacts"),
    "both": ("seconds=1\ncontacts=[[1]]\n[[points]]\ncontact=[1]", "one of them"),
    "unknown": ("seconds = 1\ncontacts = [[1.0]]\nsecond = 2", "second is not known here: use"),
    "toml": ("seconds = = 1", "is no TOML"),
    "long": ("seconds = 599\ncontacts = [[1.0]]", "602.5 s together: at most 600 s"),
    "twice": ("seconds = 1\ncontacts = [[1.0], [1.0]]", r"the contact \(1.0,\) occurs twice"),
    "three": ("seconds = 1\ncontacts = [[1.0, 2, 3]]", "a list of 1 or 2 finite numbers"),
    "mixed": ("seconds = 1\ncontacts = [[1.0, 2], [3.0]]", "give all as many"),
    "coordinates": (
        "seconds = 1\ncoordinates = ['height', 'u']\ncontacts = [[0.5], [1.0]]",
        r"names 2, height, u, and each contact has 1 number: name one for each number",
    ),
    "coordinates of none": (
        "seconds = 1\ncoordinates = ['u']\n[[points]]\nlistener = [1, 0, 0]",
        r"names 1, u, and each contact has 0 numbers",
    ),
    "nan": ("seconds = 1\ncontacts = [[nan]]", "a list of 1 or 2 finite numbers"),
    "channels": (
        "seconds = 1\nchannels = 2\ncontacts = [[1.0]]\nlisteners = [[0, 0, 1]]",
        "has 1 microphones, and channels is 2",
    ),
    "P+Q alone": ("seconds = 1\npairs = 'P+Q'\ncontacts = [[1.0]]", "there are no listeners"),
    "pairs": ("seconds = 1\npairs = 'some'\ncontacts = [[1.0]]", r"give one of all, P\+Q"),
    "pivot": ("seconds = 1\npivot = 'top'\ncontacts = [[1.0]]", "pivot is 'top'"),
    "name": ("seconds = 1\n[[contacts]]\nname = '../x'\nat = [1]", "cannot be part of a file"),
    "names": (
        "seconds=1\n[[contacts]]\nname='a'\nat=[1]\n[[contacts]]\nname='A'\nat=[2]",
        "the name 'a' occurs twice",
    ),
    "no at": ("seconds = 1\n[[contacts]]\nname = 'rim'", "at is missing"),
    "no place": ("seconds=1\ncontacts=[[1]]\n[[listeners]]\nname='a'", "it has no place"),
    "two places": (
        "seconds=1\ncontacts=[[1]]\n[[listeners]]\nat=[0,0,1]\nspherical=[1,0,0]",
        "given twice",
    ),
    "brace": ("seconds=1\ncontacts=[[1]]\n[hooks]\nmove=['a', '{w}']", r"\{w\} is not known"),
    "hook": ("seconds=1\ncontacts=[[1]]\n[hooks]\nmove='a b'", "give a list of texts"),
    "rate": ("seconds=1\ncontacts=[[1]]\nsample_rate=4000", "from 8000 to 192000"),
    "whole": ("seconds=1\ncontacts=[[1]]\nhits=1.5", "give a whole number from 1 to 1000"),
    "levels": ("seconds=1\ncontacts=[[1]]\n[levels]\nloudest=3", "loudest is 3"),
    "levels unknown": ("seconds=1\ncontacts=[[1]]\n[levels]\nlouder=3", "louder is not known"),
}


@pytest.mark.parametrize("fault", BAD_PLANS)
def test_a_bad_plan_is_one_clear_error(fault: str, tmp_path: Path) -> None:
    text, words = BAD_PLANS[fault]
    path = tmp_path / "plan.toml"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=words) as caught:
        read_plan(path)
    assert str(path) in str(caught.value)


def test_plans_without_a_file_are_checked_too() -> None:
    with pytest.raises(OptionError, match="some points have a listener and some have none"):
        CapturePlan(
            seconds=1,
            listed=(
                Point(name="a", contact=(1.0,), listeners=(), hits=1),
                Point(name="b", contact=(1.0,), listeners=((0.0, 0.0, 1.0),), hits=1),
            ),
        )
    with pytest.raises(OptionError, match="200000 takes are planned"):
        CapturePlan(
            seconds=1,
            contacts=tuple(PlannedContact(name=f"c{n}", at=(float(n),)) for n in range(200)),
            listeners=(PlannedListener(name="a", at=((0.0, 0.0, 1.0),)),),
            hits=1000,
        )


def test_a_folder_that_cannot_be_made_is_said(tmp_path: Path, simulation: Path) -> None:
    with pytest.raises(FileFormatError, match="there is no folder"):
        run(plan(tmp_path), tmp_path / "a" / "b", simulation)
    (tmp_path / "file").write_text("")
    with pytest.raises(FileFormatError, match="cannot be made"):
        run(plan(tmp_path), tmp_path / "file", simulation)


def test_a_missing_rehearsal_file_is_named(tmp_path: Path, simulation: Path) -> None:
    (simulation / NAMES[1]).unlink()
    with pytest.raises(RecordingError, match=r"contact1_listener1_2\.wav is missing"):
        run(plan(tmp_path), tmp_path / "takes", simulation)
