from spacerobot.drafting.capture import draft_capture as draft_capture
from spacerobot.drafting.capture import surface_point as surface_point
from spacerobot.drafting.held import draft_scenario as draft_scenario
from spacerobot.drafting.request import DraftRequest as DraftRequest
from spacerobot.drafting.verified import Draft as Draft
from spacerobot.drafting.verified import draft as draft
