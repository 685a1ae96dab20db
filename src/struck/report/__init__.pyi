from .charts import overview as overview
from .comparison import Comparison as Comparison
from .figurine import bird as bird
from .fit_page import report as report
from .fit_page import save_report as save_report
from .gallery import gallery as gallery
from .obrien2002 import scene2002 as scene2002
from .sound_map_picture import sound_map_picture as sound_map_picture
