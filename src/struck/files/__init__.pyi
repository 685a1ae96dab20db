from .cache import Cache as Cache
from .sound import Sound as Sound
from .surfaces import load_body as load_body
from .surfaces import load_surface as load_surface
from .volumes import load_volume as load_volume
