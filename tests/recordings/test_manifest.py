"""Manifests as people write them, right and wrong."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from struck.errors import FileFormatError, RecordingError
from struck.model.survey import Survey, from_spherical
from struck.recordings.manifest import (
    Manifest,
    ManifestEntry,
    TomlTable,
    _manifest_of_table,
    read_manifest,
)

FILES = ("a.wav", "b.wav", "c.wav")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in FILES:
        (tmp_path / name).write_bytes(b"")
    return tmp_path


def read(folder: Path, name: str, text: str) -> Manifest:
    (folder / name).write_text(text, encoding="utf-8")
    return read_manifest(folder / name)


def test_a_csv_file_gives_contact_and_listener_of_each_recording(folder: Path) -> None:
    manifest = read(
        folder,
        "m.csv",
        "file,u,v,x,y,z,note\r\na.wav,1.0,0,0,1,0,\r\n"
        'b.wav,0.5,0,0,1,0,"soft, but good"\r\n\r\nc.wav,1.0,0,0,0,1\r\n',
    )
    assert manifest.files == [folder / name for name in FILES]
    np.testing.assert_array_equal(manifest.contacts, [[1, 0], [0.5, 0]])
    np.testing.assert_array_equal(manifest.listeners, [[0, 1, 0], [0, 0, 1]])
    assert manifest.pairs.tolist() == [[0, 0], [1, 0], [0, 1]]
    assert manifest.entries[1].note == "soft, but good"
    Survey(
        contacts=manifest.contacts,
        listeners=manifest.listeners,
        pairs=manifest.pairs,
        gains=np.ones((3, 2), complex),
        frequencies=np.array([100.0, 200.0]),
        centre=np.array(manifest.centre),
    )


def test_a_toml_file_gives_the_same_and_what_holds_for_all(folder: Path) -> None:
    manifest = read(
        folder,
        "m.toml",
        "symmetry = 'axial'\ncentre = [0, 0, 0.1]\ncoordinates = ['height', 'azimuth (rad)']\n"
        "[[takes]]\nfile = 'a.wav'\ncontact = [1.0, 0.0]\nlistener = [0, 1, 0]\nlead_in = 0.5\n"
        "[[takes]]\nfile = 'b.wav'\ncontact = [0.5, 0.0]\nspherical_degrees = [1, 90, 90]\n"
        "[[takes]]\nfile = 'c.wav'\ncontact = [0.5, 0.0]\nspherical_degrees = [1, 90, 90]\nhit = 2",
    )
    assert (manifest.symmetry, manifest.centre) == ("axial", (0.0, 0.0, 0.1))
    assert manifest.coordinates == ("height", "azimuth (rad)")
    assert [entry.lead_in for entry in manifest.entries] == [0.5, None, None]
    np.testing.assert_allclose(manifest.listeners[-1], [0, 1, 0], atol=1e-12)
    assert [entry.hit for entry in manifest.entries] == [1, 1, 2]


@pytest.mark.parametrize("unit", ["", "_degrees"])
def test_listeners_may_be_spherical(folder: Path, unit: str) -> None:
    scale = 180 / np.pi if unit else 1.0
    header = f"file,u,distance,azimuth{unit},polar{unit}\n"
    manifest = read(folder, "m.csv", f"{header}a.wav,1,2,{0.7 * scale},{1.1 * scale}")
    np.testing.assert_allclose(manifest.listeners, from_spherical(2.0, 0.7, 1.1), rtol=1e-12)


def test_channels_of_one_file_stand_in_lines_of_their_own(folder: Path) -> None:
    manifest = read(
        folder,
        "m.csv",
        "file,channel,u,x,y,z,hit\na.wav,2,1,0,0,2,1\nb.wav,1,1,0,0,1,2\n"
        "a.wav,1,1,0,0,1,1\nb.wav,2,1,0,0,2,2\n",
    )
    assert [entry.file for entry in manifest.entries] == ["a.wav", "b.wav"]
    assert manifest.entries[0].listeners == ((0.0, 0.0, 1.0), (0.0, 0.0, 2.0))
    assert manifest.pairs.tolist() == [[0, 0], [0, 1], [0, 0], [0, 1]]


def test_places_may_be_left_out_of_all_takes(folder: Path) -> None:
    alone = read(folder, "m.csv", "file,lead_in\na.wav,0.5\nb.wav,0.25\n")
    assert (alone.has_contacts, alone.has_listeners) == (False, False)
    assert alone.contacts.shape == (1, 0)
    assert [entry.lead_in for entry in alone.entries] == [0.5, 0.25]
    with pytest.raises(RecordingError, match="tells no listeners"):
        _ = alone.listeners
    contacts = read(folder, "n.csv", "file,u\na.wav,0.5\nb.wav,0.25\n")
    assert (contacts.has_contacts, contacts.has_listeners) == (True, False)


def test_files_are_chosen_and_those_without_an_entry_are_named(folder: Path) -> None:
    manifest = read(folder, "m.csv", "file,u\na.wav,0.5\nb.wav,0.25\n")
    assert manifest.chosen([folder / "b.wav"]).contacts.tolist() == [[0.25]]
    with pytest.raises(RecordingError, match=r"1 of 2 recordings have no entry .*c\.wav"):
        manifest.chosen([folder / "a.wav", folder / "c.wav"])


CSV = {
    "column": ("file,u,w\na.wav,1,2", "the columns 'w' are not known: use file, channel"),
    "semicolons": ("file;u\na.wav;1", "separate names by commas"),
    "no file": ("u,x,y,z\n1,0,0,1", "has no column 'file'"),
    "nameless": ("file,u\n,1", "line 2: it names no file"),
    "half": ("file,u,v\na.wav,1,", "line 2: v is missing: add it"),
    "one without": ("file,u\na.wav,1\nb.wav,", "1 of 2 takes have no contact, the first b.wav"),
    "word": ("file,u\na.wav,rim", "line 2: u is 'rim': give a finite number"),
    "nan": ("file,u\na.wav,nan", "give a finite number"),
    "comma": ("file,u\na.wav,0,5", "it has 3 cells for 2 columns"),
    "two axes": ("file,x,y\na.wav,1,2", "has the columns x, y for listeners: give x, y, z; or"),
    "two systems": (
        "file,x,y,z,distance,azimuth,polar\na.wav,1,2,3,1,2,3",
        "for listeners: give x, y, z; or",
    ),
    "v alone": ("file,v\na.wav,1", "has a column v and no u"),
    "column twice": ("file,u,u\na.wav,1,2", "the column 'u' occurs twice"),
    "file twice": ("file,u\na.wav,1\na.wav,2", "channels 1, 1: give a line for each channel"),
    "channels": ("file,channel,u\na.wav,1,1\na.wav,3,1", "lines for the channels 1, 3"),
    "channels differ": ("file,channel,u\na.wav,1,1\na.wav,2,2", "differ in more than listener"),
    "one deaf": (
        "file,channel,u,x,y,z\na.wav,1,1,0,0,1\na.wav,2,1,,,",
        "a channel of a.wav has no listener",
    ),
    "place twice": (
        "file,u,x,y,z\na.wav,1,0,0,1\nb.wav,1,0,0,1",
        "a.wav and b.wav have the same contact, listener and hit: .* number several hits",
    ),
    "hit": ("file,u,hit\na.wav,1,0", "hit is '0': give a whole number from 1 to 1000"),
    "rate": ("file,u,sample_rate\na.wav,1,44.1", "sample_rate is '44.1'"),
    "lead-in": ("file,u,lead_in\na.wav,1,-1", "lead_in is '-1': give seconds from 0"),
    "missing": ("file,u\na.wav,1\nz.wav,2", r"1 of 2 recordings are missing, the first .*z\.wav"),
    "quote": ('file,u\n"a.wav,1', "is no CSV"),
    "empty": ("", "is empty"),
    "header alone": ("file,u\n", "has no takes"),
}


@pytest.mark.parametrize("fault", CSV)
def test_a_wrong_csv_file_is_one_clear_error(folder: Path, fault: str) -> None:
    text, words = CSV[fault]
    with pytest.raises(FileFormatError, match=words) as caught:
        read(folder, "m.csv", text)
    assert str(folder / "m.csv") in str(caught.value)


TOML = {
    "key": ("[[takes]]\nfile='a.wav'\nplace=[1]", "place is not known here: use"),
    "head": ("symetry='axial'\n[[takes]]\nfile='a.wav'", "symetry is not known"),
    "symmetry": ("symmetry='round'\n[[takes]]\nfile='a.wav'", "give one of none, axial"),
    "no file": ("[[takes]]\ncontact=[1]", r"\[\[takes\]\] 1: file is missing"),
    "one without": (
        "[[takes]]\nfile='a.wav'\nlistener=[0,0,1]\n[[takes]]\nfile='b.wav'",
        "1 of 2 takes have no listeners, the first b.wav",
    ),
    "coordinates": (
        "[[takes]]\nfile='a.wav'\ncontact=[1]\n[[takes]]\nfile='b.wav'\ncontact=[1, 2]",
        "contacts have 1 and 2 coordinates",
    ),
    "names": (
        "coordinates=['height', 'u']\n[[takes]]\nfile='a.wav'\ncontact=[0.5]",
        r"names 2, height, u, and each contact has 1 number: name one for each number",
    ),
    "twice": ("[[takes]]\nfile='a.wav'\n[[takes]]\nfile='a.wav'", "a.wav occurs twice"),
    "two listeners": (
        "[[takes]]\nfile='a.wav'\nlistener=[0,0,1]\nlisteners=[[0,0,1]]",
        "given twice",
    ),
    "flat": ("[[takes]]\nfile='a.wav'\nlistener=[0,1]", "a list of 3 finite numbers"),
    "no list": ("takes = 3", "takes is 3: give a list"),
    "no tables": ("takes = [3]", r"write each as \[\[takes\]\]"),
    "nothing": ("", "has no takes"),
    "syntax": ("[[takes]", "is no TOML"),
}


@pytest.mark.parametrize("fault", TOML)
def test_a_wrong_toml_file_is_one_clear_error(folder: Path, fault: str) -> None:
    text, words = TOML[fault]
    with pytest.raises(FileFormatError, match=words) as caught:
        read(folder, "m.toml", text)
    assert str(folder / "m.toml") in str(caught.value)


def test_other_files_are_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"there is no file of that name"):
        read_manifest(tmp_path / "m.toml")
    with pytest.raises(FileFormatError, match=r"ends in '\.xlsx'"):
        read_manifest(tmp_path / "m.xlsx")
    (tmp_path / "m.csv").write_bytes("file,u\nä.wav,1".encode("latin-1"))
    with pytest.raises(FileFormatError, match="save it as UTF-8"):
        read_manifest(tmp_path / "m.csv")


def written(
    entries: list[ManifestEntry], coordinates: tuple[str, ...], centre: tuple[float, ...]
) -> Manifest:
    numbered = tuple(replace(each, hit=number) for number, each in enumerate(entries, 1))
    return Manifest(
        path=Path("m.toml"),
        entries=numbered,
        coordinates=coordinates,
        centre=centre,
        symmetry="axial",
    )


def same_again(manifest: Manifest) -> None:
    table = TomlTable(tomllib.loads(manifest.text()), "m.toml")
    again = _manifest_of_table(manifest.path, table)
    for name in ("entries", "coordinates", "centre", "symmetry"):
        assert getattr(again, name) == getattr(manifest, name)


NUMBERS = some.floats(-1e6, 1e6)
ENTRIES = some.builds(
    ManifestEntry,
    file=some.text(min_size=1, max_size=8),
    contact=some.tuples(NUMBERS, NUMBERS),
    listeners=some.lists(some.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=3).map(tuple),
    hit=some.integers(1, 1000),
    sample_rate=some.sampled_from([None, 8000, 44100]),
    lead_in=some.none() | some.floats(0, 600),
    peak=some.none() | some.floats(-200, 0),
    above_noise=some.none() | some.floats(0, 200),
    note=some.text(max_size=8),
)


MANIFESTS = some.builds(
    written,
    entries=some.lists(ENTRIES, max_size=4, unique_by=lambda entry: entry.file),
    coordinates=some.lists(some.text(max_size=6), max_size=2).map(tuple),
    centre=some.tuples(NUMBERS, NUMBERS, NUMBERS),
)


@settings(max_examples=20)
@given(MANIFESTS)
def test_what_is_written_is_read_again(manifest: Manifest) -> None:
    same_again(manifest)


@pytest.mark.prove
@given(MANIFESTS)
def test_any_manifest_is_read_again_as_written(manifest: Manifest) -> None:
    same_again(manifest)
