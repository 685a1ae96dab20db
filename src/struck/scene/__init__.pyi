from .body import Body as Body
