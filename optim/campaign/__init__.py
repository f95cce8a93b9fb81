"""Campaigns: how sets of gains perform over uncertain parameters."""

from optim.campaign.analysis.bands import Bands, read_bands
from optim.campaign.analysis.samples import command_of, simulate_sample
from optim.campaign.analysis.statistics import Estimate, share
from optim.campaign.analysis.summary import summarise, told_of
from optim.campaign.rollouts.evaluator import Evaluator, Table, all_draws, build_evaluator
from optim.campaign.run import ROLLING_OUT, Campaigned, Executor, Here, Progress, run_campaign
from optim.campaign.store.folder import load_campaign
from optim.campaign.store.notes import Named
from optim.campaign.store.reopen import reopen

__all__ = [
    "ROLLING_OUT",
    "Bands",
    "Campaigned",
    "Estimate",
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
    "share",
    "simulate_sample",
    "summarise",
    "told_of",
]
