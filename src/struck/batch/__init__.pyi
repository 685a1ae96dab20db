from .batch import analyze_many as analyze_many
from .batch_report import BatchReport as BatchReport
from .batch_report import BatchRow as BatchRow
