"""Samplers of a campaign's uncertain parameters, one file each in ``spacerobot/samplers/kinds``."""

from spacerobot.samplers.sampler import Sampler, SamplingPlan

__all__ = ["Sampler", "SamplingPlan"]
