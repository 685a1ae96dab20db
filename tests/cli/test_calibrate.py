"""`struck calibrate` from the shell."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import struck
from struck.cli import main
from struck.shapes import RectangularPlate


def plate(material: struck.Material | str) -> struck.ModalModel:
    shape = RectangularPlate(length=0.3, width=0.2, thickness=0.004, edges="free")
    return struck.analyze(shape, material, band=(20, 6000))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a model of guessed material, and beside it recordings of the real one."""
    folder = tmp_path_factory.mktemp("recorded")
    true = struck.Material(
        name="secret",
        density=7850.0,
        youngs_modulus=2.05e11,
        poisson_ratio=0.31,
        damping=struck.InternalFriction(loss_tangent=2e-3),
    )
    real = plate(true)
    for number, place in enumerate([(0.02, 0.015), (0.11, 0.04)]):
        sound = struck.render(real, struck.Strike(at=place, impulse=1e-3), seconds=1.0)
        samples = np.pad(sound.samples[0] / sound.peak, (20_000, 0))
        noise = 1e-4 * np.random.default_rng(number).standard_normal(len(samples))
        take = np.float32(0.5 * samples + noise)
        struck.Sound(samples=take, sample_rate=48_000).save(folder / f"tap{number}.wav")
    guessed = plate("aluminium")
    struck.save(guessed, folder / "pot.struck")
    struck.save(replace(guessed, material=None), folder / "heard.struck")
    return folder


@pytest.fixture
def pot(recorded: Path, tmp_path: Path) -> Path:
    """Return a copy of them."""
    return shutil.copytree(recorded, tmp_path, dirs_exist_ok=True)


@pytest.mark.prove
def test_a_plate_is_found_to_be_what_it_is(pot: Path, capsys: pytest.CaptureFixture[str]) -> None:
    taps = [str(pot / "tap0.wav"), str(pot / "tap1.wav")]
    corrected = pot / "real.struck"
    words = ["calibrate", str(pot / "pot.struck"), *taps, "--corrected", str(corrected)]
    assert main([*words, "--density", "7850", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["specific_stiffness"] == pytest.approx(2.05e11 / 7850, rel=2e-3)
    assert told["poisson_ratio"] == pytest.approx(0.31, abs=0.006)
    real = struck.load(corrected)
    fitted = struck.fit(taps, cache=False)
    nearest = np.abs(real.frequencies[:, None] - fitted.frequencies).min(axis=1)
    assert np.median(nearest) < 0.01


@pytest.mark.prove
def test_what_is_found_is_said_as_a_material(pot: Path, capsys: pytest.CaptureFixture[str]) -> None:
    corrected = pot / "real.struck"
    words = ["calibrate", str(pot / "pot.struck"), str(pot / "tap0.wav"), "--density", "7850"]
    assert main([*words, "--corrected", str(corrected)]) == 0
    text = capsys.readouterr().out
    assert "caution" not in text
    assert main([*words[:-1], "7.85"]) == 0
    told = capsys.readouterr().out
    assert "caution: 7.85 kg/m3 is 0.00291 times the model's density, 2700: 1 g/cm3 is" in told
    assert "E/density" in text
    assert "if the density is 7850 kg/m3" in text
    assert f"wrote {corrected}" in text
    given = text.split("--material ")[1].splitlines()[0]
    numbers = dict(part.split("=") for part in given.split(","))
    assert float(numbers["loss_tangent"]) == pytest.approx(2e-3, rel=0.02)
    bar = "analyze bar:length=0.2,width=0.02,thickness=0.004,ends=free"
    assert main([*bar.split(), "--material", given, "-o", str(pot / "b.struck")]) == 0


def test_another_body_is_told(pot: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shape = RectangularPlate(length=0.21, width=0.2, thickness=0.009, edges="free")
    other = struck.analyze(shape, "glass", band=(20, 6000))
    struck.save(other, pot / "other.struck")
    assert main(["calibrate", str(pot / "other.struck"), str(pot / "tap0.wav")]) == 2
    told = capsys.readouterr().err
    assert "check" in told
    assert "shape" in told


def never_fitted(*_: object, **__: object) -> None:
    raise AssertionError("the recordings were fitted first")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["heard.struck", "tap0.wav"], "material is unknown"),
        (["pot.struck", "tap0.wav", "--size-error", "-1"], "--size-error is -1.0"),
        (["pot.struck", "tap0.wav", "--density", "-1"], "density"),
        (["pot.struck", "tap0.wav", "--corrected", "tap0.wav"], "models end in .struck"),
        (["pot.struck", "heard.struck", "--corrected", "heard.struck"], "another name"),
        (["pot.struck", "tap0.wav", "--corrected", "pot.struck"], "another name"),
    ],
)
def test_what_cannot_be_is_told_before_anything_is_fitted(
    pot: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    words: list[str],
    message: str,
) -> None:
    before = {path: path.read_bytes() for path in pot.iterdir()}
    monkeypatch.chdir(pot)
    monkeypatch.setattr(struck, "fit", never_fitted, raising=False)
    assert main(["calibrate", *words]) == 2
    assert message in capsys.readouterr().err
    assert {path: path.read_bytes() for path in pot.iterdir()} == before


@pytest.mark.prove
@pytest.mark.filterwarnings("ignore::struck.errors.LossWarning")
@pytest.mark.parametrize("name", ["Taps.STRUCK", "taps.sofa"])
def test_one_fitted_model_is_as_good_as_recordings(
    pot: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    pytest.importorskip("h5py")
    struck.save(struck.fit(pot / "tap0.wav"), pot / name)
    assert main(["calibrate", str(pot / "pot.struck"), str(pot / name), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["specific_stiffness"] == pytest.approx(2.05e11 / 7850, rel=2e-3)
