"""Public names and their modules; :mod:`spacerobot.common.lazy_names` loads a name when it is first used."""

from spacerobot.result.derived_files import note_derived as note_derived
from spacerobot.result.result import Result as Result
from spacerobot.result.store import JOURNALS as JOURNALS
from spacerobot.result.store import check_folder as check_folder
from spacerobot.result.summary_types import Summary as Summary
