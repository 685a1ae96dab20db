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
    known = inferable(model, options.size_error)
    density = known.density if options.density is None else options.density
    replace(known, density=density)  # refuses what no solid has
    fitted = _fitted(options.recordings, progress)
    found = replace(calibrated(fitted, model, size_error=options.size_error), density=density)
    lines = [*found.summary(), f"--material {_as_argument(found)}"]
    if not 0.1 < (times := density / known.density) < 10:
        lines.insert(
            0,
            f"caution: {density:g} kg/m3 is {rounded(times, 3)} times the model's density, "
            f"{known.density:g}: 1 g/cm3 is 1000 kg/m3",
        )
    written = {}
    if output is not None:
        struck.save(corrected(model, fitted), output)
        lines.append(f"wrote {output}")
        written["corrected"] = str(output)
    stiffness, ratio = found.standard_errors
    return Result(
        lines,
        specific_stiffness=found.specific_stiffness,
        specific_stiffness_error=stiffness,
        poisson_ratio=found.poisson_ratio,
        poisson_ratio_error=ratio,
        damping=found.losses.name,
        damping_coefficients=dict(found.losses.coefficients),
        pairs=len(found.pairing),
        **written,
    )


def _fitted(recordings: list[str], progress: TerminalProgress) -> struck.ModalModel:
    if len(recordings) == 1 and is_model(recordings[0]):
        return struck.load(recordings[0])
    return struck.fit(recordings, modes=None, progress=progress)


def _as_argument(found: Calibration) -> str:
    """Return the material as text for the `--material` option of other commands.

    A law of Rayleigh's stays what it is; another one is told by its median loss tangent.
    """
    material = found.material()
    frequencies = found.model.natural_frequencies[found.pairing.computed]
    tangent = np.median(found.losses.law.decays(frequencies) / (np.pi * frequencies))
    law = material.damping
    losses = f"loss_tangent={rounded(tangent, 4)}"
    if isinstance(law, Rayleigh):
        losses = f"rayleigh_mass={law.mass:.6g},rayleigh_stiffness={law.stiffness:.6g}"
    return (
        f"density={material.density:g},youngs_modulus={material.youngs_modulus:.6g},"
        f"poisson_ratio={material.poisson_ratio:.4f},{losses}"
    )
