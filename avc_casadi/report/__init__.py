"""The report: one self-contained HTML page, and the summary that stands at its head."""

from avc_casadi.report._diagnosis import diagnosis_html as diagnosis_html
from avc_casadi.report._frame import Picture as Picture
from avc_casadi.report._identification import identification_html as identification_html
from avc_casadi.report._page import ReportContents as ReportContents
from avc_casadi.report._page import report_html as report_html
from avc_casadi.report._summary import summarise as summarise
from avc_casadi.report._summary import summary_lines as summary_lines
from avc_casadi.report._words import picture_words as picture_words
