"""`struck calibrate`: the material of a body, from recordings of it and a model of its shape."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

import struck
from struck.cli import Result
from struck.errors import rounded
from struck.files.model_file import is_model, model_path
from struck.model.damping import Rayleigh
from struck.model.provenance import TerminalProgress

if TYPE_CHECKING:
    from struck.recordings import Calibration


EXAMPLES = ("pot.struck taps/*.wav --density 7850 --corrected real_pot.struck",)


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck calibrate`."""
    parser.add_argument("model", help="model of the body, with an approximate material")
    parser.add_argument("recordings", nargs="+", help="sound files, or one model fitted to them")
    parser.add_argument("--density", type=float, help="density, kg/m3; default: that of the model")
    parser.add_argument(
        "--size-error",
        type=float,
        default=0.0,
        help="relative error of the dimensions, e.g. 0.01 for 1 %% (default: 0)",
    )
    parser.add_argument(
        "--corrected", help="model file for the body with its recorded frequencies and decays"
    )


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck calibrate`."""
    from struck.recordings import calibrated, corrected, inferable

    output = None
    if options.corrected:
        output = model_path(options.corrected, unlike=[options.model, *options.recordings])
    model = struck.load(options.model)
    material = inferable(model, options.size_error)
    density = material.density if options.density is None else options.density
    replace(material, density=density)  # refuses what no solid has
    fitted = _fit_recordings(options.recordings, progress)
    calibration = calibrated(fitted, model, size_error=options.size_error).of_density(density)
    flag = " --no-air" if calibration.air is None else ""  # its losses are in the damping
    lines = [*calibration.summary(), f"--material {_as_argument(calibration)}{flag}"]
    if not 0.1 < (times := density / material.density) < 10:
        lines.insert(
            0,
            f"caution: {rounded(density)} kg/m3 is {rounded(times, 3)} times the model's density, "
            f"{rounded(material.density)}: 1 g/cm3 is 1000 kg/m3",
        )
    facts = {}
    if output is not None:
        struck.save(corrected(model, fitted), output)
        lines.append(f"wrote {output}")
        facts["corrected"] = str(output)
    stiffness, ratio = calibration.standard_errors
    damping_error = float(np.median(calibration.damping_errors))
    return Result(
        lines,
        specific_stiffness=calibration.specific_stiffness,
        specific_stiffness_error=stiffness,
        poisson_ratio=calibration.poisson_ratio,
        poisson_ratio_error=ratio,
        damping=calibration.losses.name,
        damping_coefficients=dict(calibration.losses.coefficients),
        damping_error=damping_error if np.isfinite(damping_error) else None,
        air_fraction=None
        if calibration.air is None
        else float(np.median(calibration.air_fractions)),
        pairs=len(calibration.pairing),
        **facts,
    )


def _fit_recordings(recordings: list[str], progress: TerminalProgress) -> struck.ModalModel:
    if len(recordings) == 1 and is_model(recordings[0]):
        return struck.load(recordings[0])
    return struck.fit(recordings, modes=None, progress=progress)


def _as_argument(calibration: Calibration) -> str:
    """Return the material as text for the `--material` option of other commands.

    A Rayleigh law is kept; other laws are replaced by their median loss tangent.
    """
    material = calibration.material()
    frequencies = calibration.model.natural_frequencies[calibration.pairing.computed]
    loss_tangent = np.median(calibration.losses.law.decays(frequencies) / (np.pi * frequencies))
    law = material.damping
    losses = f"loss_tangent={rounded(loss_tangent, 4)}"
    if isinstance(law, Rayleigh):
        losses = f"rayleigh_mass={law.mass:.6g},rayleigh_stiffness={law.stiffness:.6g}"
    return (
        f"density={rounded(material.density)},youngs_modulus={material.youngs_modulus:.6g},"
        f"poisson_ratio={material.poisson_ratio:.4f},{losses}"
    )
