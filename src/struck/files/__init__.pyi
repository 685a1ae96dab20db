from .cache import Cache as Cache
from .meshes import MeshPart as MeshPart
from .meshes import list_parts as list_parts
from .meshes import load_body as load_body
from .meshes import load_surface as load_surface
from .meshes import load_volume as load_volume
from .sofa_fields import load_sofa_responses as load_sofa_responses
from .sound import Sound as Sound
