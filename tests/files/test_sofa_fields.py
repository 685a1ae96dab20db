"""Timbre fields and impulse responses as SOFA files, read back by us and by sofar."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from struck.errors import ContactError, FileFormatError, MissingDependencyError, OptionError
from struck.files import sofa
from struck.files.sampled_field import SampledField
from struck.files.sofa_fields import (
    load_sofa_field,
    load_sofa_responses,
    save_sofa,
    save_sofa_responses,
)
from struck.model.material import AIR
from struck.model.model import ModalModel
from struck.model.survey import from_spherical
from tests.live.hand import ball
from tests.model.vases import HEIGHTS, Vase, listeners

sofar = pytest.importorskip("sofar", reason="NO SOFA FILE WAS VERIFIED: pip install sofar")

Change = Callable[[h5py.File], object]


@pytest.fixture(scope="module")
def vase() -> SampledField:
    """Return a vase of 25 modes at 3 heights and 19 listeners, with two pairs of close modes."""
    drawn = Vase.drawn(np.random.default_rng(5))
    frequencies = drawn.frequencies.copy()
    frequencies[1], frequencies[7] = np.nextafter(frequencies[0], 1e9), frequencies[6] + 1e-9
    return SampledField(
        frequencies=frequencies,
        decays=drawn.decays,
        contacts=HEIGHTS,
        listeners=listeners(),
        gains=drawn.gains(HEIGHTS[:, 0], listeners()),
        centre=np.zeros(3),
        symmetry="axial",
        coordinates=("height (vase heights)",),
        title="Väse",
    )


def same(left: SampledField, right: SampledField) -> bool:
    arrays = ("frequencies", "decays", "contacts", "listeners", "gains", "centre")
    texts = ("symmetry", "calibrated", "coordinates", "title")
    return all(
        getattr(left, name).tobytes() == getattr(right, name).tobytes() for name in arrays
    ) and all(getattr(left, name) == getattr(right, name) for name in texts)


def test_a_field_comes_back_to_the_last_bit(vase: SampledField, tmp_path: Path) -> None:
    path = tmp_path / "vase.sofa"
    save_sofa(vase, path, author="the workshop", licence="CC0-1.0")
    assert same(load_sofa_field(path), vase)


def test_sofar_verifies_a_field_and_reads_the_same(vase: SampledField, tmp_path: Path) -> None:
    path = tmp_path / "vase.sofa"
    save_sofa(vase, path, author="the workshop", licence="CC0-1.0")
    read = sofar.read_sofa(str(path), verbose=False)
    assert read.verify(issue_handling="return", mode="write") is None
    assert read.GLOBAL_SOFAConventions == "GeneralTF-E"
    assert (read.GLOBAL_Title, read.GLOBAL_License) == ("Väse", "CC0-1.0")
    assert read.N.tobytes() == vase.frequencies.tobytes()
    assert read.ModeDecay.tobytes() == vase.decays.tobytes()
    assert (read.N_Units, read.ModeDecay_Units) == ("hertz", "1/s")
    gains = (read.Data_Real + 1j * read.Data_Imag)[:, 0]
    assert np.array_equal(gains.transpose(2, 0, 1), vase.gains)
    assert np.array_equal(read.ListenerPosition, vase.listeners)
    assert np.array_equal(read.EmitterPosition[:, :1], vase.contacts)
    assert [read.get_dimension(letter) for letter in "MRNE"] == [19, 1, 25, 3]


def test_what_sofar_writes_again_is_the_same_field(vase: SampledField, tmp_path: Path) -> None:
    ours, theirs = tmp_path / "ours.sofa", tmp_path / "theirs.sofa"
    save_sofa(vase, ours)
    sofar.write_sofa(str(theirs), sofar.read_sofa(str(ours), verbose=False))
    assert same(load_sofa_field(theirs), vase)


@pytest.mark.parametrize(("contacts", "heard", "modes"), [(1, 1, 1), (2, 1, 3), (1, 4, 1)])
def test_single_contacts_listeners_and_modes_keep_their_places(
    contacts: int, heard: int, modes: int, tmp_path: Path
) -> None:
    chance = np.random.default_rng(2)
    shape = (contacts, heard, modes)
    field = SampledField(
        frequencies=chance.uniform(100, 1000, modes),
        decays=chance.uniform(1, 9, modes),
        contacts=chance.uniform(size=(contacts, 2)),
        listeners=chance.normal(size=(heard, 3)),
        gains=chance.normal(size=shape) + 1j * chance.normal(size=shape),
        centre=np.array([0.0, 0.1, 0.2]),
        calibrated=True,
        coordinates=("u", "v"),
        title="one",
    )
    path = tmp_path / "field.sofa"
    save_sofa(field, path)
    assert same(load_sofa_field(path), field)
    save_sofa_responses(field, path, seconds=0.01)
    read = sofar.read_sofa(str(path), verbose=False)
    assert read.verify(issue_handling="return", mode="write") is None
    assert load_sofa_responses(path).samples.shape == (contacts, heard, 480)


def test_a_field_read_back_plays_as_if_never_written(vase: SampledField, tmp_path: Path) -> None:
    model = replace(vase, frequencies=np.sort(vase.frequencies)).model()
    path = tmp_path / "model.sofa"
    save_sofa(model, path, contacts=HEIGHTS, listeners=listeners())
    again = load_sofa_field(path)
    assert np.array_equal(again.frequencies, model.frequencies)
    assert np.array_equal(again.decays, model.decays)
    assert (again.symmetry, again.calibrated) == ("axial", False)
    unwritten = SampledField.of(model, HEIGHTS, listeners()).model()
    places, contact = from_spherical(0.8, 0.3, 1.2), np.array([[0.7]])
    for part in (lambda each: each.toward(places), lambda each: each.at(contact, np.zeros((1, 3)))):
        assert np.array_equal(part(again.model().gains), part(unwritten.gains))
    table = again.model("table")
    exact = table.gains.at(HEIGHTS, np.zeros((3, 3)))[:, None] * table.gains.toward(listeners())
    np.testing.assert_allclose(exact.sum(axis=2), again.gains, rtol=1e-9, atol=1e-12)


def test_modes_out_of_order_are_put_in_order_with_their_gains(vase: SampledField) -> None:
    turned = replace(
        vase,
        frequencies=vase.frequencies[::-1],
        decays=vase.decays[::-1],
        gains=vase.gains[:, :, ::-1],
    )
    model, usual = turned.model("table"), vase.model("table")
    assert np.array_equal(model.natural_frequencies, usual.natural_frequencies)
    assert np.array_equal(model.gains.toward(listeners()), usual.gains.toward(listeners()))


def test_a_body_with_a_surface_is_sampled_at_names_and_points(tmp_path: Path) -> None:
    model, heard = ball(), np.array([[0.0, 2.0, 0.0], [0.0, 0.0, 3.0]])
    path = tmp_path / "ball.sofa"
    save_sofa(model, path, contacts=["top", "side"], listeners=heard)
    field = load_sofa_field(path)
    for number, name in enumerate(["top", "side"]):
        contact = model.contact(name)
        assert np.array_equal(field.contacts[number], contact.point)
        drive = model.gains.at(contact.point[None], contact.direction[None])[0, 0]
        expected = drive * model.gains.toward(heard)[:, 0]
        np.testing.assert_allclose(field.gains[number], expected, rtol=1e-14)
    assert field.calibrated == model.calibrated
    assert field.coordinates == ("x (m)", "y (m)", "z (m)")
    with pytest.raises(OptionError, match="contacts have 3 coordinates"):
        field.survey()


def closed_form(model: ModalModel | SampledField, gains: np.ndarray, times: np.ndarray):  # noqa: ANN201
    poles = -model.decays + 2j * np.pi * model.frequencies
    return np.imag(np.exp(times[:, None] * poles) @ gains)


def test_responses_are_those_of_the_closed_form_after_the_travel_time(
    vase: SampledField, tmp_path: Path
) -> None:
    path, rate = tmp_path / "vase.sofa", 16_000
    left_out = save_sofa_responses(vase, path, seconds=0.05, sample_rate=rate)
    found = load_sofa_responses(path)
    assert left_out == 0
    times = np.arange(800) / rate
    for contact, listener in ((0, 0), (1, 7), (2, 18)):
        expected = closed_form(vase, vase.gains[contact, listener], times)
        np.testing.assert_allclose(found.samples[contact, listener], expected, atol=1e-12)
    distances = np.linalg.norm(vase.listeners, axis=1)
    expected = np.broadcast_to(distances / AIR.sound_speed, (3, 19))
    np.testing.assert_allclose(found.delays, expected, rtol=1e-14)
    assert np.array_equal(found.contacts, HEIGHTS)
    assert (found.sample_rate, found.calibrated) == (rate, False)


def test_sofar_verifies_responses_and_lost_modes_are_counted(
    vase: SampledField, tmp_path: Path
) -> None:
    path = tmp_path / "vase.sofa"
    beyond = np.count_nonzero(vase.frequencies >= 4000)
    assert 0 < beyond < 25
    assert save_sofa_responses(vase, path, seconds=0.02, sample_rate=8000) == beyond
    read = sofar.read_sofa(str(path), verbose=False)
    assert read.verify(issue_handling="return", mode="write") is None
    assert f"({beyond} more at or above 4000 Hz are left out)" in read.GLOBAL_Comment
    assert read.GLOBAL_SOFAConventions == "GeneralFIR-E"
    assert np.shape(read.Data_IR) == (19, 1, 160, 3)
    assert read.Data_SamplingRate == 8000


def test_what_sofar_makes_from_nothing_is_read(tmp_path: Path) -> None:
    made = sofar.Sofa("GeneralFIR-E")
    made.Data_IR = np.arange(24.0).reshape(2, 1, 4, 3)
    made.Data_Delay = np.zeros((1, 1, 3))
    made.EmitterPosition = np.eye(3)
    made.ListenerPosition = [[90, 0, 2], [0, 90, 3]]
    made.ListenerPosition_Type, made.ListenerPosition_Units = "spherical", "degree, degree, metre"
    path = tmp_path / "made.sofa"
    sofar.write_sofa(str(path), made)
    found = load_sofa_responses(path)
    assert found.samples[2, 1].tolist() == [14, 17, 20, 23]
    np.testing.assert_allclose(found.listeners, [[0, 2, 0], [0, 0, 3]], atol=1e-12)
    np.testing.assert_allclose(found.contacts, np.eye(3) + np.eye(3)[0], atol=1e-12)


def spoiled(folder: Path, original: Path, change: Change) -> Path:
    path = folder / "spoiled.sofa"
    shutil.copyfile(original, path)
    with h5py.File(path, "r+") as file:
        change(file)
    return path


def replaced(name: str, values: object) -> Change:
    def change(file: h5py.File) -> None:
        attributes = {
            key: file[name].attrs[key] for key in ("Type", "Units") if key in file[name].attrs
        }
        del file[name]
        file[name] = values
        file[name].attrs.update(attributes)

    return change


def attribute(name: str, value: str) -> Change:
    return lambda file: file.attrs.__setitem__(name, value)


def not_a_number(file: h5py.File) -> None:
    file["Data.Real"][0, 0, 3, 1] = np.nan


def in_feet(file: h5py.File) -> None:
    file["ListenerPosition"].attrs["Units"] = "foot"


def huge(file: h5py.File) -> None:
    del file["Data.Real"]
    file.create_dataset("Data.Real", (10**4, 1, 10**4, 10), chunks=(1, 1, 100, 1), dtype=float)


MALFORMED = {
    "head": (attribute("SOFAConventions", "SimpleFreeFieldHRIR"), "'GeneralTF-E' is read here"),
    "no decays": (lambda file: file.pop("ModeDecay"), "no variable ModeDecay, .* fit a model"),
    "decays": (replaced("ModeDecay", np.ones(24)), r"ModeDecay has shape \(24,\)"),
    "growing": (replaced("ModeDecay", np.full(25, -1.0)), "decays from -1 1/s"),
    "no gains": (lambda file: file.pop("Data.Imag"), "Data.Imag is missing"),
    "NaN": (not_a_number, "1 values that are NaN"),
    "text": (replaced("Data.Real", "text"), "numbers in this one are read"),
    "size": (huge, "more than 134,217,728 numbers are not read: split"),
    "feet": (in_feet, "'cartesian' in 'foot'"),
    "listeners": (replaced("ListenerPosition", np.ones((18, 3))), r"\(18, 1, 25, 3\) is demanded"),
    "flat": (replaced("ListenerPosition", np.ones(19)), r"\(n, 3\) is read"),
    "receivers": (replaced("ReceiverPosition", np.zeros((2, 3))), "2 receivers, and 1 for each"),
    "symmetry": (attribute("Symmetry", "round"), "Symmetry is 'round': give one of none, axial"),
    "axes": (replaced("ContactU", np.ones((3, 2))), r"ContactU has shape \(3, 2\), and \(3,\)"),
}


@pytest.mark.parametrize("fault", MALFORMED)
def test_a_malformed_file_gives_one_clear_error(
    fault: str, vase: SampledField, tmp_path: Path
) -> None:
    change, words = MALFORMED[fault]
    save_sofa(vase, tmp_path / "vase.sofa")
    path = spoiled(tmp_path, tmp_path / "vase.sofa", change)
    with pytest.raises(FileFormatError, match=words) as caught:
        load_sofa_field(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"RIFF....WAVE"])
def test_what_is_no_hdf5_file_is_said_to_be_none(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "vase.sofa"
    path.write_bytes(content)
    for load in (load_sofa_field, load_sofa_responses):
        with pytest.raises(FileFormatError, match="cannot be read as HDF5"):
            load(path)


def test_bad_arguments_are_refused_and_nothing_is_written(
    vase: SampledField, tmp_path: Path
) -> None:
    path = tmp_path / "x.sofa"
    with pytest.raises(OptionError, match=r"give contacts=, .*, and listeners="):
        save_sofa(ball(), path)
    with pytest.raises(OptionError, match="has its own contacts"):
        save_sofa(vase, path, listeners=listeners())
    with pytest.raises(ContactError, match="inside the body"):
        save_sofa(ball(), path, contacts=["top"], listeners=[[0.0, 0.0, 0.0]])
    with pytest.raises(OptionError, match="listeners have shape"):
        save_sofa(ball(), path, contacts=["top"], listeners=[0.0, 0.0, 1.0])
    with pytest.raises(OptionError, match=r"seconds is 1000: .* to 49.1 s"):
        save_sofa_responses(vase, path, seconds=1000)
    with pytest.raises(OptionError, match="sample_rate is 0"):
        save_sofa_responses(vase, path, seconds=1, sample_rate=0)
    with pytest.raises(OptionError, match="interpolation is 'best'"):
        vase.model("best")
    with pytest.raises(FileFormatError, match="does not exist"):
        save_sofa(vase, tmp_path / "none" / "x.sofa")
    assert not list(tmp_path.iterdir())


def test_without_h5py_the_way_out_is_told(
    vase: SampledField, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "h5py", None)
    with pytest.raises(MissingDependencyError, match=r"struck\[sofa\]"):
        sofa._library()
    with pytest.raises(MissingDependencyError, match=r"struck\[sofa\]"):
        save_sofa(vase, tmp_path / "vase.sofa")
