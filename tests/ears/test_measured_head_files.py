"""SOFA files as two other programs wrote them, and as they should not be."""

from __future__ import annotations

import builtins
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from struck.ears import measured_head
from struck.ears.measured_head import read_sofa
from struck.errors import FileFormatError, MissingDependencyError

DATA = Path(__file__).parent / "data"
KEMAR, PULSES = DATA / "kemar_subset.sofa", DATA / "pulses_sofar.sofa"


def spoiled(folder: Path, change: Callable[[h5py.File], object], original: Path = PULSES) -> Path:
    path = folder / "spoiled.sofa"
    shutil.copyfile(original, path)
    with h5py.File(path, "r+") as file:
        change(file)
    return path


def replace(name: str, values: object) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        attributes = dict(file[name].attrs)
        del file[name]
        file[name] = values
        for key in ("Type", "Units"):
            if key in attributes:
                file[name].attrs[key] = attributes[key]

    return change


def test_kemar_is_read_as_it_was_written() -> None:
    head = read_sofa(KEMAR)
    with h5py.File(KEMAR) as file:
        stored = file["Data.IR"][...]
    assert np.array_equal(head.responses, stored)
    assert (head.distance, head.sample_rate) == (pytest.approx(1.4), 44100)
    assert not head.delays.any()
    np.testing.assert_allclose(head.directions[4:7, 2], 0, atol=1e-12)
    left = head.responses[np.argmax(head.directions[:, 1])]
    assert np.sum(left[0] ** 2) > 10 * np.sum(left[1] ** 2)


def test_pulses_of_sofar_are_read_in_seconds_metres_and_unit_vectors() -> None:
    head = read_sofa(PULSES)
    count = np.arange(60) + 0.5
    azimuth, z = np.pi * (3 - np.sqrt(5)) * count, 1 - 2 * count / 60
    level = np.sqrt(1 - z**2)
    right = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), z], axis=1)
    np.testing.assert_allclose(head.directions, right, atol=1e-12)
    y = right[:, 1]
    expected = 100 / 48000 + np.stack([-y, y], axis=1) * 0.08 / 343
    np.testing.assert_allclose(head.delays, expected, atol=1e-12)
    assert (head.name, head.distance, head.sample_rate) == ("Pulses", pytest.approx(2.0), 48000)
    assert np.array_equal(np.unique(head.responses), [0, 1 / 3])
    assert head.licence == "CC0-1.0"


def test_ears_are_told_by_where_they_are(tmp_path: Path) -> None:
    def swap(file: h5py.File) -> None:
        file["ReceiverPosition"][...] = file["ReceiverPosition"][...][::-1]

    swapped = read_sofa(spoiled(tmp_path, swap, KEMAR))
    assert np.array_equal(swapped.responses, read_sofa(KEMAR).responses[:, ::-1])


def test_a_head_that_looks_to_the_left_has_its_left_behind(tmp_path: Path) -> None:
    turned = read_sofa(spoiled(tmp_path, replace("ListenerView", [[0.0, 2.0, 0.0]])))
    x, y, z = read_sofa(PULSES).directions.T
    np.testing.assert_allclose(turned.directions, np.stack([y, -x, z], axis=1), atol=1e-12)


def test_spherical_and_cartesian_sources_are_the_same(tmp_path: Path) -> None:
    def spherical(file: h5py.File) -> None:
        x, y, z = file["SourcePosition"][...].T
        angles = np.degrees([np.arctan2(y, x), np.arcsin(z / 2)])
        file["SourcePosition"][...] = np.stack([*angles, np.full(60, 2.0)], axis=1)
        file["SourcePosition"].attrs["Type"] = "spherical"
        file["SourcePosition"].attrs["Units"] = "degree, degree, metre"

    found = read_sofa(spoiled(tmp_path, spherical)).directions
    np.testing.assert_allclose(found, read_sofa(PULSES).directions, atol=1e-12)


def not_a_number(file: h5py.File) -> None:
    file["Data.IR"][3, 1, 7] = np.nan


def silent(file: h5py.File) -> None:
    file["Data.IR"][3, 1] = 0


def another_convention(file: h5py.File) -> None:
    file.attrs["SOFAConventions"] = "MultiSpeakerBRIR"


def in_radians(file: h5py.File) -> None:
    file["SourcePosition"].attrs["Units"] = "radian, radian, metre"


def group_for_responses(file: h5py.File) -> None:
    del file["Data.IR"]
    file.create_group("Data.IR")


def far_too_many(file: h5py.File) -> None:
    del file["Data.IR"]
    file.create_dataset("Data.IR", (10**6, 2, 10**6), chunks=(1, 2, 100), dtype=float)


def elsewhere(file: h5py.File) -> None:
    del file["Data.IR"]
    outside = [("responses.raw", 0, h5py.h5f.UNLIMITED)]
    file.create_dataset("Data.IR", (60, 2, 64), dtype=float, external=outside)


RESPONSES = np.ones((60, 2, 8))
SPHERE = np.eye(3)[np.arange(60) % 3]
MALFORMED = {
    "NaN": (not_a_number, "holds 1 values that are NaN"),
    "silence": (silent, "all zeros"),
    "convention": (another_convention, "MultiSpeakerBRIR"),
    "no convention": (lambda file: file.attrs.pop("SOFAConventions"), "not said"),
    "units": (in_radians, "radian"),
    "group": (group_for_responses, "Data.IR is missing"),
    "size": (far_too_many, "1000000 directions"),
    "outside": (elsewhere, "in another file"),
    "text": (replace("Data.IR", "text"), "numbers"),
    "one ear": (replace("Data.IR", RESPONSES[:, :1]), r"\(60, 1, 8\)"),
    "flat": (replace("Data.IR", RESPONSES[:, 0]), r"\(60, 8\)"),
    "few": (replace("Data.IR", RESPONSES[:3]), "3 directions"),
    "long": (replace("Data.IR", np.ones((4, 2, 16385))), "16385 taps"),
    "counts": (replace("Data.IR", RESPONSES[:59]), r"SourcePosition has shape \(60, 3\)"),
    "slow": (replace("Data.SamplingRate", [4000.0]), "4000 Hz"),
    "fast": (replace("Data.SamplingRate", [384000.0]), "384000 Hz"),
    "two rates": (replace("Data.SamplingRate", np.arange(60) + 48000.0), "48000, 48001"),
    "delays": (replace("Data.Delay", np.zeros((7, 2))), r"\(7, 2\)"),
    "long delays": (replace("Data.Delay", [[0.0, 1e6]]), "1e"),
    "at the centre": (replace("SourcePosition", 0 * SPHERE), "0 m away"),
    "two distances": (
        replace("SourcePosition", SPHERE * np.linspace(1, 2, 60)[:, None]),
        "1 to 2 m",
    ),
    "head upside": (replace("ListenerUp", [[1.0, 0.0, 0.0]]), "parallel"),
    "head elsewhere": (replace("ListenerPosition", [[1.0, 0.0, 0.0]]), "not the origin"),
    "ears": (replace("ReceiverPosition", np.zeros((2, 3, 1))), "both ears at y = 0 m"),
} | {
    f"no {name}": (lambda file, name=name: file.pop(name), f"{name} is missing")
    for name in ("Data.IR", "Data.SamplingRate", "Data.Delay", "SourcePosition", "ListenerView")
}


@pytest.mark.parametrize("fault", MALFORMED)
def test_a_malformed_file_gives_one_clear_error(fault: str, tmp_path: Path) -> None:
    change, message = MALFORMED[fault]
    path = spoiled(tmp_path, change)
    with pytest.raises(FileFormatError, match=message) as caught:
        read_sofa(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"RIFF....WAVE", KEMAR.read_bytes()[:40000]])
def test_what_is_no_hdf5_file_is_said_to_be_none(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "head.sofa"
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match="cannot be read as HDF5"):
        read_sofa(path)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"here\.sofa is missing, there is no file"):
        read_sofa(tmp_path / "nowhere.sofa")


def test_without_h5py_the_way_out_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    imported = builtins.__import__

    def without(name: str, *rest: object) -> object:
        if name == "h5py":
            raise ImportError(name)
        return imported(name, *rest)  # type: ignore[arg-type] - passed on as it came

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingDependencyError, match=r"struck\[sofa\]"):
        measured_head.read_sofa(KEMAR)
