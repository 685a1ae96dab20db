"""Parts of the untimed proofs that take about equally long; CI runs one of them a commit."""

from __future__ import annotations

import argparse
import re
from functools import cache
from zlib import crc32

# Seconds of the proofs of a file, or of one test where a file's tests run separately, on two idle
# cores: most are what `pytest --group-seconds` printed on a busy machine, reduced by its load, the
# others estimates. Only the balance of the parts and of the workers depends on them.
SECONDS: dict[str, float] = {
    "tests/analysis/test_analysis.py": 40,
    "tests/analysis/test_forecast.py": 60,
    "tests/analysis/test_interruption.py": 100,
    "tests/analysis/test_pools.py": 30,
    "tests/batch/test_batch.py": 480,
    "tests/batch/test_cluster.py": 60,
    "tests/browser/test_limits_of_the_room.py": 60,
    "tests/browser/test_sound_page.py": 80,
    "tests/cli/test_control_c.py::test_early_moments[forty]": 40,
    "tests/cli/test_control_c.py::test_moments_of_every_command[2]": 25,
    "tests/cli/test_control_c.py::test_moments_of_every_command[3]": 25,
    "tests/cli/test_control_c.py::test_moments_of_every_command[4]": 25,
    "tests/cli/test_control_c.py::test_moments_of_every_command[5]": 25,
    "tests/cli/test_control_c.py::test_moments_of_every_command[6]": 25,
    "tests/cli/test_kills.py": 280,
    "tests/cli/test_little_memory.py": 150,
    "tests/core/test_sanitizers.py": 80,
    "tests/core/test_wheels.py": 250,
    "tests/explorer/test_connections.py": 150,
    "tests/explorer/test_jobs.py": 80,
    "tests/explorer/test_private_folder.py": 30,
    "tests/files/test_made_files.py": 100,
    "tests/files/test_recorded_model_file.py": 60,
    "tests/files/test_surfaces.py": 7,
    "tests/files/test_write_faults.py": 140,
    "tests/fuzz/test_fuzz.py": 110,
    "tests/live/": 220,
    "tests/papers/test_2002_table2.py": 70,
    "tests/perception/test_sound_map_bounds.py": 30,
    "tests/physics/test_cube.py": 50,
    "tests/physics/test_errors.py": 500,
    "tests/physics/test_everyday.py": 700,
    "tests/physics/test_laws.py": 90,
    "tests/physics/test_materials.py": 20,
    "tests/physics/test_moebius.py": 130,
    "tests/physics/test_polygons.py": 70,
    "tests/physics/test_slender_parts.py": 30,
    "tests/physics/test_sphere.py": 120,
    "tests/physics/test_thin_bodies.py": 100,
    "tests/physics/test_tube.py": 15,
    "tests/radiation/test_boundary_elements.py": 100,
    "tests/recordings/calibration/test_calibrate.py": 60,
    "tests/recordings/poles/test_search.py": 60,
    "tests/recordings/test_corbett2007.py": 5,
    "tests/recordings/test_fit.py": 50,
    "tests/recordings/test_measured_modes.py": 250,
    "tests/recordings/test_real_takes.py": 350,
    "tests/recordings/test_residual_sound.py": 50,
    "tests/recordings/test_vase.py": 60,
    "tests/report/test_gallery.py": 40,
    "tests/report/test_obrien2002.py": 300,
    "tests/scene/test_recoil.py": 30,
    "tests/solids/fem/test_memory.py": 60,
    "tests/solids/filling/test_membership.py": 250,
    "tests/solids/surface/test_dirty.py": 70,
    "tests/solids/test_lattice.py": 35,
    "tests/test_documents.py::test_example[examples/play_a_scene.py]": 30,
    "tests/test_documents.py::test_example[examples/scenes_of_2002.py]": 50,
    "tests/test_documents.py::test_example[examples/walk_round_a_bowl.py]": 30,
    "tests/test_documents.py::test_page[docs/tutorial/first_sound.md]": 25,
    "tests/test_hostile_calls.py::test_five_hundred_times_nobody_should_type_them": 60,
    "tests/test_hostile_calls.py::test_five_thousand_times_nobody_should": 120,
    "tests/test_mutants.py": 600,
}


def part(text: str) -> tuple[int, int]:
    """Parse ``k/n``, the number of a part and how many there are."""
    match = re.fullmatch(r"([0-9]+)/([0-9]+)", text)
    if match is None or not 1 <= int(match[1]) <= int(match[2]):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a part of the proofs: write k/n with k from 1 to n, as in 1/4 to 4/4"
        )
    return int(match[1]), int(match[2])


@cache
def _largest(parts: int) -> dict[str, int]:
    """Return the part of each group of `SECONDS`: the longest first, to the shortest part."""
    totals = [0.0] * parts
    numbers = {}
    for group, seconds in sorted(SECONDS.items(), key=lambda item: (-item[1], item[0])):
        shortest = totals.index(min(totals))
        totals[shortest] += seconds
        numbers[group] = shortest + 1
    return numbers


def part_of(group: str, parts: int) -> int:
    """Return the number, from 1, of the part that runs a group of tests."""
    return _largest(parts).get(group) or crc32(group.encode()) % parts + 1
