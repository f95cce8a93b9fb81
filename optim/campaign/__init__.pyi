"""Public names and their modules; :mod:`spacerobot.common.lazy_names` loads a name when it is first used."""

from optim.campaign.analysis.bands import QuantileBands as QuantileBands
from optim.campaign.analysis.bands import read_bands as read_bands
from optim.campaign.analysis.samples import simulate_sample as simulate_sample
from optim.campaign.analysis.summary import summarise as summarise
from optim.campaign.analysis.summary import summary_data as summary_data
from optim.campaign.rollouts.evaluator import CampaignEvaluator as CampaignEvaluator
from optim.campaign.rollouts.evaluator import all_draws as all_draws
from optim.campaign.rollouts.evaluator import build_evaluator as build_evaluator
from optim.campaign.run import ROLLING_OUT as ROLLING_OUT
from optim.campaign.run import CampaignProgress as CampaignProgress
from optim.campaign.run import CampaignRun as CampaignRun
from optim.campaign.run import Executor as Executor
from optim.campaign.run import LocalExecutor as LocalExecutor
from optim.campaign.run import run_campaign as run_campaign
from optim.campaign.store.load_evaluator import reopen as reopen
from optim.campaign.store.netcdf import load_campaign as load_campaign
