"""
Simulate
========

Simulate a tile that falls on a shelf in MuJoCo, and render both: `struck.simulate`.
"""

from pathlib import Path

import struck
from struck.report.charts import spectrogram

Path("shelf.xml").write_text("""
<mujoco>
  <option timestep="0.001"/>
  <worldbody>
    <geom name="shelf" type="box" size=".2 .15 .01" pos="0 0 -.01"/>
    <body name="tile" pos="0 0 .1" euler="30 20 0">
      <freejoint/>
      <geom type="box" size=".05 .05 .004"/>
    </body>
  </worldbody>
</mujoco>
""")
scene, contacts = struck.simulate(
    "shelf.xml",
    seconds=1.0,
    materials={"tile": "ceramic", "shelf": "oak"},
    restitution="materials",
    accuracy="preview",
)
print(*scene.notes, sep="\n")
print(f"{len(contacts.time)} rows of contacts")

# %%
sound = struck.render(scene, contacts, listener=struck.Mono(position=(0, -1, 0.5)), seconds=1.5)
spectrogram(sound)

# %%
sound
