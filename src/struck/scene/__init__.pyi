from .body import Body as Body
from .body import RigidBody as RigidBody
from .body import Scene as Scene
from .contacts import Contacts as Contacts
from .contacts import Poses as Poses
from .events import Events as Events
from .events import events_of as events_of
