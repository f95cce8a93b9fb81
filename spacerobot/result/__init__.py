"""Results: labelled data, metrics, ledger, and their folders on disk."""

from spacerobot.result.derived_files import note_derived
from spacerobot.result.result import Result
from spacerobot.result.store import JOURNALS, check_folder

__all__ = ["JOURNALS", "Result", "check_folder", "note_derived"]
