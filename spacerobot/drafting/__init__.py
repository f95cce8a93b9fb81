"""Drafts of scenarios: from URDFs to a file that was simulated before it is written, ready to edit."""

from spacerobot.drafting.capture import draft_capture, surface_point
from spacerobot.drafting.held import DraftRequest, draft_scenario
from spacerobot.drafting.verified import Draft, draft

__all__ = ["Draft", "DraftRequest", "draft", "draft_capture", "draft_scenario", "surface_point"]
