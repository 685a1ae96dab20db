"""Contact logs written, read back, and written by hand."""

from __future__ import annotations

import re
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import struck
from struck.errors import FileFormatError, OptionError, StruckError
from struck.scene import Contacts, events_of, load_contacts, save_contacts
from tests.scene.logs import SCENE, Solver, landing
from tests.scene.test_events import EAR

BY_HAND = """\
time,body0,body1,position_x,position_y,position_z,impulse_x,impulse_y,impulse_z
0.1,board,block,0.02,0.0,0.01,0,0,0.05
0.4,board,block,0.05,0.01,0.01,0,0.01,0.03
0.6,block,board,-0.1,0.05,0.01,0,0,-0.02
"""
POSED = """\
# Lengths as the animation has them.
# length: mm
time,body,position_z,position_y,position_x,rotation_w,rotation_x,rotation_y,rotation_z,\
body0,body1,impulse_x,impulse_y,impulse_z,dt

0,block,35,0,0,1,0,0,0,,,,,,
1,block,35,0,100,1,0,0,0,,,,,,
0.5,,10,0,50,,,,,board,block,0,0,0.05,0.001
"""


@pytest.mark.parametrize("kind", ["csv", "jsonl", "npz"])
def test_a_log_written_and_read_renders_the_same_samples(tmp_path: Path, kind: str) -> None:
    contacts = landing(
        Solver(flicker=True, sway=0.1),
        slides=lambda t: 0.05 * np.clip(t - 0.1, 0, 0.2),
        seconds=0.5,
    )
    contacts = replace(contacts, id=np.tile(np.arange(4), len(contacts) // 4))
    save_contacts(contacts, tmp_path / f"log.{kind}")
    read = load_contacts(tmp_path / f"log.{kind}")
    for name in ("time", "dt", "body1", "position", "normal", "impulse", "velocity", "id"):
        np.testing.assert_array_equal(getattr(read, name), getattr(contacts, name))
    np.testing.assert_array_equal(read.poses.rotation, contacts.poses.rotation)
    assert read.names == contacts.names
    first, second = (
        struck.render(SCENE, each, listener=EAR, seconds=0.5, sample_rate=16_000)
        for each in (contacts, read)
    )
    np.testing.assert_array_equal(first.samples, second.samples)


@pytest.mark.parametrize("kind", ["csv", "jsonl", "npz"])
def test_a_log_without_contacts_is_read_again(tmp_path: Path, kind: str) -> None:
    nothing = np.zeros(0)
    log = Contacts(
        names=["board", "block"],
        time=nothing,
        body0=nothing,
        body1=nothing,
        position=np.zeros((0, 3)),
        impulse=np.zeros((0, 3)),
    )
    save_contacts(log, tmp_path / f"a.{kind}")
    read = load_contacts(tmp_path / f"a.{kind}")
    assert (read.names, len(read)) == (log.names, 0)
    sound = struck.render(SCENE, read)
    assert sound.notes == ("silence: the log has no contacts",)
    assert not sound.samples.any()


def test_three_impacts_written_by_hand_are_heard(tmp_path: Path) -> None:
    (tmp_path / "hits.csv").write_text(BY_HAND, encoding="utf-8")
    contacts = load_contacts(tmp_path / "hits.csv")
    scene = replace(
        SCENE,
        bodies={**SCENE.bodies, "block": replace(SCENE.bodies["block"], position=(0, 0, 0.035))},
    )
    impacts = events_of(scene, contacts).impacts
    np.testing.assert_allclose(impacts.time, [0.1, 0.4, 0.6])
    np.testing.assert_allclose(impacts.impulse[:, 2], [0.05, 0.03, 0.02])  # on the block
    sound = struck.render(scene, contacts, listener=EAR, seconds=0.9).samples[0]
    late = [
        np.abs(sound[round((t + d) * 48_000) :][:480]).max()
        for t in impacts.time
        for d in (-0.02, 0.005)
    ]
    assert late[0] == 0
    assert late[1] > late[2] < late[3] > late[4] < late[5]


@pytest.mark.parametrize("between", [";", "\t", "; "])
@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("text", [BY_HAND, POSED], ids=["contacts", "poses"])
def test_semicolons_and_tabs_separate_cells_too(
    tmp_path: Path, text: str, between: str, decimal: str
) -> None:
    (tmp_path / "commas.csv").write_text(text, encoding="utf-8")
    lines = [
        line if line.startswith("#") else line.replace(",", between).replace(".", decimal)
        for line in text.splitlines()
    ]
    (tmp_path / "other.csv").write_text("\r\n".join(lines), encoding="utf-8-sig")
    plain, other = (load_contacts(tmp_path / f"{name}.csv") for name in ("commas", "other"))
    assert other.names == plain.names
    for name in ("time", "dt", "body0", "body1", "position", "impulse"):
        np.testing.assert_array_equal(getattr(other, name), getattr(plain, name))
    if plain.poses is not None:
        np.testing.assert_array_equal(other.poses.position, plain.poses.position)
        np.testing.assert_array_equal(other.poses.rotation, plain.poses.rotation)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("0.1;board;block;0;0;0;0;0", "line 2 has 8 cells, and there are 9"),
        ("0.1;board;block;0;0;0;0;0;1.234,5", "line 2 has impulse '1.234,5': give a number"),
        ("0,1,board,block,0,0,0,0,0,1", "line 2 has 1 cells, and there are 9"),
    ],
)
def test_wrong_lines_with_semicolons_are_named(tmp_path: Path, line: str, said: str) -> None:
    head = BY_HAND.splitlines()[0].replace(",", ";")
    (tmp_path / "log.csv").write_text(f"{head}\n{line}\n", encoding="utf-8")
    with pytest.raises(FileFormatError, match=re.escape(said)):
        load_contacts(tmp_path / "log.csv")


def test_poses_and_units_stand_in_the_same_file(tmp_path: Path) -> None:
    (tmp_path / "posed.csv").write_text(POSED, encoding="utf-8")
    contacts = load_contacts(tmp_path / "posed.csv")
    np.testing.assert_allclose(contacts.position, [[0.05, 0.0, 0.01]])
    number = contacts.names.index("block")
    np.testing.assert_allclose(contacts.poses.of(number)[1], [[0, 0, 0.035], [0.1, 0, 0.035]])
    assert contacts.dt.tolist() == [0.001]


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        (
            "a.csv",
            BY_HAND.replace("0.05,0.01,0.01", "0.05,oops,0.01"),
            "line 3 has position 'oops'",
        ),
        ("a.csv", BY_HAND.replace("0.4,board", "soon,board"), "line 3 has time 'soon'"),
        ("a.csv", BY_HAND.replace("0.6,block", "0.6,"), "line 4 has no body0"),
        ("a.csv", BY_HAND + "1,2\n", "line 5 has 2 cells, and there are 9"),
        ("a.csv", "time\n", "no contacts and no poses"),
        ("a.csv", "# length: furlong\n" + BY_HAND, "'furlong': m, cm, mm, in, ft"),
        ("a.jsonl", "{]", "line 1 is no JSON"),
        ("a.jsonl", "[1]", "line 1 is no object"),
        (
            "a.jsonl",
            '{"time": 0, "body0": "a", "body1": "b", "position": 3, "impulse": [1, 0, 0]}',
            "line 1 has position 3",
        ),
        (
            "a.jsonl",
            '{"time": 0, "body0": "a", "body1": "b", "position": [0, 0, 0]}',
            "columns are time, body0, body1, position: impulse are missing; give time, body0",
        ),
        (
            "a.csv",
            BY_HAND.replace("position_", "").replace("body0", "first"),
            r"first, body1, .*: body0, position are missing; give .* \(in CSV position_x, .* dt",
        ),
        ("a.csv", BY_HAND.replace("impulse_x", "impuls_x"), "lack impulse_x: is it impuls_x"),
        ("a.npz", "x", "a.npz is no contact log"),
        ("a.txt", "x", "a contact log is .csv"),
    ],
)
def test_what_is_wrong_in_a_file_is_told_with_its_line(
    tmp_path: Path, name: str, text: str, message: str
) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(FileFormatError, match=message):
        load_contacts(tmp_path / name)


def test_numbers_that_cannot_be_are_told_with_the_file(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(BY_HAND.replace("0.03", "nan"), encoding="utf-8")
    with pytest.raises(OptionError, match=r"a\.csv: impulse is .* in row 1"):
        load_contacts(tmp_path / "a.csv")


@pytest.mark.prove
def test_a_million_rows_are_read_within_a_minute(tmp_path: Path) -> None:
    count = 10**6
    contacts = Contacts(
        names=["a", "b"],
        time=np.arange(count) * 1e-3,
        dt=1e-3,
        body0=np.zeros(count),
        body1=np.ones(count),
        position=np.random.default_rng(0).random((count, 3)),
        impulse=np.ones((count, 3)),
    )
    save_contacts(contacts, tmp_path / "log.csv")
    read = load_contacts(tmp_path / "log.csv", seconds=60)
    np.testing.assert_array_equal(read.position, contacts.position)


ROW = '{"time": 0, "body0": "a", "body1": "b", "position": [0, 0, 0], "impulse": [0, 0, 1]}'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"names": 5}', "line 1 has names '5': give a list of them"),
        ('{"length": []}', r"line 1 gives lengths in \[\]: m, cm"),
        ("[" * 100_000, "damaged, or another format"),
        ("null", "line 1 is no object"),
        (ROW.replace("0", "9" * 400, 1), "line 1 has time 9999.*: give a number"),
        (ROW.replace("[0, 0, 1]", "[0, 0, null]"), "line 1 has impulse None: give a number"),
        (ROW.replace("[0, 0, 1]", "7"), "line 1 has impulse 7: give 3 numbers"),
        ('{"names": ["\\ud800"]}', "is no text .*: rename it"),
    ],
)
def test_lines_of_other_types_and_sizes_are_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "a.jsonl").write_text(f"{text}\n{ROW}\n", encoding="utf-8")
    with pytest.raises(StruckError, match=rf"a\.jsonl.*{said}"):
        load_contacts(tmp_path / "a.jsonl")


def test_arrays_that_unpack_without_end_are_refused(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "a.npz", time=np.zeros(10**7))
    with pytest.raises(FileFormatError, match="no honest file packs better than 200 to 1"):
        load_contacts(tmp_path / "a.npz")
    shape = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,)}"
    header = b"\x93NUMPY\x01\x00v\x00" + shape.ljust(117) + b"\n"
    with zipfile.ZipFile(tmp_path / "b.npz", "w") as archive:
        archive.writestr("time.npy", header)
    with pytest.raises(FileFormatError, match=r"b\.npz .* more than 2147483648 bytes of memory"):
        load_contacts(tmp_path / "b.npz")


def test_reading_takes_no_longer_than_is_asked_for(tmp_path: Path) -> None:
    (tmp_path / "a.jsonl").write_text(f"{ROW}\n" * 50_000, encoding="utf-8")
    with pytest.raises(FileFormatError, match=r"0\.05 s of the processor.*than seconds=0\.05"):
        load_contacts(tmp_path / "a.jsonl", seconds=0.05)
    with pytest.raises(OptionError, match="seconds is 0"):
        load_contacts(tmp_path / "a.jsonl", seconds=0)


def test_columns_that_are_not_used_are_told_with_the_names_there_are(tmp_path: Path) -> None:
    head, *rows = BY_HAND.splitlines()
    lines = [f"{head},force,velocty_x", *(f"{row},3,1" for row in rows)]
    (tmp_path / "hits.csv").write_text("\n".join(lines), encoding="utf-8")
    told = "columns that are not used: force, velocty_x; did you mean velocity? there are time, dt"
    assert any(note.startswith(told) for note in load_contacts(tmp_path / "hits.csv").notes)
    (tmp_path / "hits.csv").write_text(BY_HAND, encoding="utf-8")
    assert not load_contacts(tmp_path / "hits.csv").notes
    (tmp_path / "hits.csv").write_text(BY_HAND.replace("impulse", "imulse"), encoding="utf-8")
    with pytest.raises(FileFormatError, match=r"missing; did you mean impulse[?] give time, body0"):
        load_contacts(tmp_path / "hits.csv")
    for wrong, told in (
        ({"impulse": "force"}, "impulse are missing; an impulse is force times dt, in N s; give"),
        ({"body0": "bodyA", "body1": "bodyB"}, "did you mean body0[?] did you mean body1[?]"),
    ):
        text = BY_HAND
        for name, other in wrong.items():
            text = text.replace(name, other)
        (tmp_path / "hits.csv").write_text(text, encoding="utf-8")
        with pytest.raises(FileFormatError, match=told):
            load_contacts(tmp_path / "hits.csv")


def test_contacts_after_the_end_are_told(tmp_path: Path) -> None:
    (tmp_path / "hits.csv").write_text(BY_HAND.replace("\n0.", "\n"), encoding="utf-8")
    contacts = load_contacts(tmp_path / "hits.csv")
    told = "excitations (strike) begin after the end at 0.5 s of the sound and are left out"
    late = struck.render(SCENE, contacts, listener=EAR, seconds=0.5, sample_rate=16_000)
    assert any(told in note and "or times in s" in note for note in late.notes)
    assert not late.samples.any()
    (tmp_path / "hits.csv").write_text(BY_HAND.replace("\n0.", "\n-0."), encoding="utf-8")
    contacts = load_contacts(tmp_path / "hits.csv")
    early = struck.render(SCENE, contacts, listener=EAR, seconds=0.1, sample_rate=16_000)
    assert any(re.match(r"\d contacts? before 0 s, heard as at 0 s", note) for note in early.notes)
