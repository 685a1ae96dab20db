from .bodies import Block as Block
from .bodies import Extrusion as Extrusion
from .bodies import Tube as Tube
from .revolution import Revolution as Revolution
from .revolution import Stem as Stem
from .volume_mesh import VolumeMesh as VolumeMesh
