"""Drafts of scenarios: from URDFs to a file that runs and is ready to edit."""

from spacerobot.scene.draft.capture import draft_capture, surface_point
from spacerobot.scene.draft.draft import DraftRequest, draft_scenario

__all__ = ["DraftRequest", "draft_capture", "draft_scenario", "surface_point"]
