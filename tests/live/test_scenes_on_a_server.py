"""Simulations on a sound server of our own, for as long as nobody notices that they are late."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import struck
from struck.cli import main
from struck.live.callback_memory import CALLS
from struck.scene.engines.simulation import Simulation
from tests.live.servers import Server, judge
from tests.live.watchdog import stalls

EARS = struck.Stereo(position=(0.0, -1.0, 0.6), facing=(0.0, 1.0, 0.0))
Scene = Callable[[Path], tuple[Simulation, Any]]
PUSH = 0.55  # of the weight of a block that is pushed to and fro


def blocks(folder: Path) -> tuple[Simulation, Any]:
    """Return ten blocks, nine on a table and one on top, pushed for a while twice in 4 s."""
    bodies = ""
    for number in range(10):
        x, y = (0.06 * (number % 3 - 1), 0.06 * (number // 3 - 1)) if number < 9 else (0.0, 0.0)
        z = 0.026 if number < 9 else 0.077
        bodies += (
            f'<body name="block {number}" pos="{x} {y} {z}"><freejoint/>'
            '<geom type="box" size=".025 .025 .025" friction=".4"/></body>'
        )
    path = folder / "blocks.xml"
    path.write_text(
        '<mujoco><option timestep=".001" integrator="implicitfast"/><worldbody>'
        '<geom name="table" type="box" size=".3 .3 .01" pos="0 0 -.01"/>'
        f"{bodies}</worldbody></mujoco>"
    )

    def push(model: Any, data: Any) -> None:  # noqa: ANN401 - MuJoCo's
        way = {0: 1.0, 2: -1.0}.get(int(data.time % 4), 0.0) if data.time % 1 < 0.4 else 0.0
        for number in range(9):
            body = model.body(f"block {number}").id
            data.xfrc_applied[body, 0] = PUSH * way * model.body(body).mass[0] * 9.81

    made = Simulation(
        path, materials="oak", restitution="materials", accuracy="preview", band=(20.0, 12_000.0)
    )
    return made, push


def chimes(folder: Path) -> tuple[Simulation, Any]:
    from struck.report import obrien2002

    staged = obrien2002.SCENES["chimes"](folder, "preview")
    return obrien2002.ready(staged, folder, "preview"), staged.control


@pytest.mark.prove
@pytest.mark.parametrize("scene", [chimes, blocks])
def test_a_simulation_plays_for_a_minute(
    jack: Server, tmp_path: Path, capsys: pytest.CaptureFixture[str], scene: Scene
) -> None:
    pytest.importorskip("mujoco")
    simulation, control = scene(tmp_path)
    touching = []

    def watched(model: Any, data: Any) -> None:  # noqa: ANN401 - MuJoCo's
        control(model, data)
        touching.append(data.ncon)

    late = jack.late()
    with (
        stalls() as stalled,
        struck.play(simulation, listener=EARS, control=watched, volume=-20) as player,
    ):
        for _ in range(120):
            time.sleep(0.5)
            assert player.simulating
        calls = int(player._shared.counters[CALLS])
        told = (
            f"\n{scene.__name__}: load {player.load:.0f} %, simulation "
            f"{player.simulation_load:.0f} %, {calls} blocks, {player.late} late, "
            f"{player.underflows} underflows ({jack.late() - late} times the server's clock was "
            f"late), slipped {player.slipped:.2f} s, dropped {player.dropped}, at most "
            f"{max(touching)} contacts, {sorted(touching)[len(touching) // 2]} in the middle\n"
        )
        with capsys.disabled():
            sys.stdout.write(told)
        assert player.peak > 1e-3
        assert player.late <= 0.01 * calls
        assert player.dropped == 0
        underflows = player.underflows
    if scene is blocks:
        assert sorted(touching)[len(touching) // 2] >= 16
    judge(underflows, calls, stalled)


@pytest.mark.usefixtures("jack")
def test_the_shell_plays_a_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("mujoco")
    path = tmp_path / "tile.xml"
    path.write_text(
        '<mujoco><option timestep=".001"/><worldbody>'
        '<geom name="floor" type="plane" size="1 1 .1"/><body name="tile" pos="0 0 .1">'
        '<freejoint/><geom type="box" size=".05 .05 .004"/></body></worldbody></mujoco>'
    )
    told = ["--material", "tile=ceramic", "--accuracy", "preview", "--seconds", "0.6"]
    assert main(["simulate", str(path), *told, "--play", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["peak"] > 1e-4
    assert facts["simulation_load"] > 0
    assert not list(tmp_path.glob("*.wav"))
