"""Public names and their modules; :mod:`spacerobot.common.lazy_names` loads a name when it is first used."""

from viz.figures import draw_all as draw_all
from viz.figures import save_figures as save_figures
from viz.page.live import LiveViewer as LiveViewer
from viz.page.notebook import embed as embed
from viz.page.page import animation_page as animation_page
from viz.page.page import write_animation as write_animation
from viz.recording.record import write_recording as write_recording
from viz.report.report import write_report as write_report
