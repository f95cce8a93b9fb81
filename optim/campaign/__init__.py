"""Campaigns: how sets of gains perform over uncertain parameters."""

from optim.campaign.analysis.bands import QuantileBands, read_bands
from optim.campaign.analysis.samples import simulate_sample
from optim.campaign.analysis.summary import summarise, summary_data
from optim.campaign.rollouts.evaluator import CampaignEvaluator, all_draws, build_evaluator
from optim.campaign.run import (
    ROLLING_OUT,
    CampaignProgress,
    CampaignRun,
    Executor,
    LocalExecutor,
    run_campaign,
)
from optim.campaign.store.load_evaluator import reopen
from optim.campaign.store.netcdf import load_campaign

__all__ = [
    "ROLLING_OUT",
    "CampaignEvaluator",
    "CampaignProgress",
    "CampaignRun",
    "Executor",
    "LocalExecutor",
    "QuantileBands",
    "all_draws",
    "build_evaluator",
    "load_campaign",
    "read_bands",
    "reopen",
    "run_campaign",
    "simulate_sample",
    "summarise",
    "summary_data",
]
