"""Play two balls that roll and collide on a table: python examples/play_a_scene.py.

This needs an audio device. Without one, the message describes how to render to a file.
"""

import time
from pathlib import Path
from typing import Any

import struck
from struck.errors import DeviceError, MissingDependencyError
from struck.scene import Simulation

SECONDS = 8.0
TABLE = """
<mujoco>
  <option timestep="0.001"/>
  <worldbody>
    <geom name="table" type="box" size=".4 .3 .012" pos="0 0 -.012"/>
    <body name="left" pos="-.3 0 .021"><freejoint/><geom size=".02"/></body>
    <body name="right" pos=".3 .004 .021"><freejoint/><geom size=".02"/></body>
  </worldbody>
</mujoco>
"""


def push(model: Any, data: Any) -> None:  # noqa: ANN401 - MuJoCo's
    """Push the balls toward the centre of the table."""
    for name in ("left", "right"):
        body = data.body(name)
        body.xfrc_applied[0] = -0.4 * model.body(name).mass[0] * body.xpos[0] / 0.1


path = Path("table.xml")
path.write_text(TABLE)
simulation = Simulation(
    path,
    materials={"table": "oak", "*": "glass"},
    restitution="materials",
    accuracy="preview",
)
print(*simulation.notes, sep="\n")
ears = struck.Binaural(position=(0, -0.8, 0.5), facing=(0, 1, 0))
try:
    with struck.play(simulation, listener=ears, control=push) as player:
        end = time.monotonic() + SECONDS
        while time.monotonic() < end and player.simulating:
            time.sleep(0.5)
            print(f"load {player.load:.0f} %, simulation {player.simulation_load:.0f} %")
except (DeviceError, MissingDependencyError) as error:
    print(error)
