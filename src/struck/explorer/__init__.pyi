from .page_files import head_bytes as head_bytes
from .page_files import model_bytes as model_bytes
from .server import Explorer as Explorer
from .server import explore as explore
