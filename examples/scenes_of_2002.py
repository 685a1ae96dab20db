"""The five scenes of O'Brien et al. (2002): python examples/scenes_of_2002.py chimes bowl.

Sounds, contact logs, animations (GLB) and pictures are written to the folder `scenes`. The names
are chimes, bowl, chute, blocks, boxes and the_end; the default is blocks. --stems also writes the
sound of each body.
"""

import sys
from pathlib import Path

from struck.report import scene2002

SCENES = ("chimes", "bowl", "chute", "blocks", "boxes", "the_end")
names = [word for word in sys.argv[1:] if word != "--stems"] or ["blocks"]
if unknown := {*names} - {*SCENES}:
    sys.exit(f"no scene is called {', '.join(sorted(unknown))}: give some of {', '.join(SCENES)}")
for name in names:
    for path in scene2002(name, Path("scenes"), accuracy="preview", stems="--stems" in sys.argv):
        print("wrote", path)
