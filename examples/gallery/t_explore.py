"""
In a browser
============

`struck.explore` shows bodies in a browser, where a click strikes them. This script starts the
server, prints its address, and stops it.
"""

import struck
from struck.solids import Tube

tube = Tube(length=0.505, radius=0.0125, wall=0.001)
chime = struck.analyze(tube, "aluminium", accuracy="preview", band=(20, 8000))
struck.show(chime)

# %%
with struck.explore(chime, names=["chime"], browser=False, wait=False) as explorer:
    print(explorer.url.partition("?")[0])
