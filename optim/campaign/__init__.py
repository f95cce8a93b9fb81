"""Campaigns: how gains do over the whole range of what is not known."""

from optim.campaign.bands import Bands, read_bands
from optim.campaign.evaluator import Evaluator, Table, all_draws, build_evaluator
from optim.campaign.notes import Named
from optim.campaign.reopen import reopen
from optim.campaign.run import ROLLING_OUT, Campaigned, Executor, Here, Progress, run_campaign
from optim.campaign.samples import command_of, simulate_sample
from optim.campaign.store import load_campaign
from optim.campaign.summary import summarise, told_of

__all__ = [
    "ROLLING_OUT",
    "Bands",
    "Campaigned",
    "Evaluator",
    "Executor",
    "Here",
    "Named",
    "Progress",
    "Table",
    "all_draws",
    "build_evaluator",
    "command_of",
    "load_campaign",
    "read_bands",
    "reopen",
    "run_campaign",
    "simulate_sample",
    "summarise",
    "told_of",
]
