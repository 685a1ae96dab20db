"""
Many meshes
===========

Analyze a folder of meshes into a folder of models, with a report: `struck.analyze_many`.
"""

from pathlib import Path

import trimesh

import struck
from struck import Strike

Path("meshes").mkdir(exist_ok=True)
for name, size in (("die", (0.02, 0.02, 0.02)), ("slab", (0.2, 0.1, 0.01))):
    trimesh.creation.box(extents=size).export(f"meshes/{name}.obj")

report = struck.analyze_many("meshes/*.obj", "ceramic", out="models", accuracy="preview")
for row in report.rows:
    print(row.file, row.status)

# %%
slab = struck.load("models/slab.struck")
struck.show(slab)

# %%
struck.render(slab, Strike(striker="wood"), seconds=1.0)
