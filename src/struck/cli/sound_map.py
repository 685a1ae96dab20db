"""`struck sound-map`: how few contacts of a body are enough, and where they are."""

from __future__ import annotations

import argparse
from pathlib import Path

import struck
from struck.cli import Result
from struck.cli.options import POSITION
from struck.files.atomic import writable
from struck.model.arrays import Array
from struck.model.provenance import TerminalProgress
from struck.perception.wav_bank import write_bank
from struck.report.charts import PICTURES
from struck.report.charts import save as save_picture
from struck.report.sound_map_picture import sound_map_picture

EXAMPLES = (
    "bar.struck --threshold 3 -o bar_map.png",
    "bar.struck --threshold 3 --bank bar_sounds --parameters bar_map.safetensors",
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck sound-map`."""
    parser.add_argument("model", help="model file")
    parser.add_argument(
        "--threshold",
        type=float,
        default=3.0,
        help="largest sonic distance from a place to its contact, dB (default: 3)",
    )
    parser.add_argument(
        "--listener", type=POSITION, help="position x,y,z, m; default: next to the body"
    )
    parser.add_argument(
        "--level", type=float, help="level of the loudest contact, dB SPL (default: 85)"
    )
    parser.add_argument("--bank", help="folder for a WAV file of each contact, and a list of them")
    parser.add_argument("--parameters", help="file for the map as arrays, .safetensors")
    parser.add_argument("-o", "--output", help="picture file; default: MODEL_map.png")


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck sound-map`."""
    path = Path(options.model)
    picture = options.output or path.with_name(f"{path.stem}_map.png")
    output, parameters = writable(picture, unlike=[path], endings=PICTURES, kind="pictures"), None
    if options.parameters:
        other_paths, endings = [path, output], (".safetensors",)
        parameters = writable(options.parameters, unlike=other_paths, endings=endings, kind="maps")
    model = struck.load(path)
    map_options = {"listener": options.listener, "level": options.level}
    sound_map = struck.sound_map(model, options.threshold, **map_options, progress=progress)
    save_picture(sound_map_picture(sound_map), output)
    facts = {"output": str(output)}
    if parameters is not None:
        sound_map.save(parameters)
        facts["parameters"] = str(parameters)
    if options.bank:
        progress("writing their sounds", 0.0)
        facts["bank"] = str(_bank(model, sound_map, options.bank))
    summary = f"{sound_map}".removeprefix("SoundMap(").removesuffix(")")
    lines = [summary, *(f"wrote {name}" for name in facts.values())]
    return Result(
        lines,
        contacts=sound_map.contacts.tolist(),
        bound=sound_map.bound,
        threshold=sound_map.threshold,
        **facts,
    )


def _bank(model: struck.ModalModel, sound_map: struck.SoundMap, folder: str) -> Path:
    def render(contact: Array, direction: Array) -> struck.Sound:
        strike = struck.Strike(at=contact, direction=direction, impulse=1.0)
        return struck.render(model, strike, listener=sound_map.listener)

    return write_bank(sound_map, folder, render)
