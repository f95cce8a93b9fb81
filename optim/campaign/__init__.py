"""Campaigns: how gains do over the whole range of what is not known."""

from optim.campaign.evaluator import Evaluator, Table, all_draws, build_evaluator
from optim.campaign.run import Campaigned, Executor, Here, Progress, run_campaign
from optim.campaign.store import load_campaign
from optim.campaign.summary import command_of, simulate_sample, summarise

__all__ = [
    "Campaigned",
    "Evaluator",
    "Executor",
    "Here",
    "Progress",
    "Table",
    "all_draws",
    "build_evaluator",
    "command_of",
    "load_campaign",
    "run_campaign",
    "simulate_sample",
    "summarise",
]
