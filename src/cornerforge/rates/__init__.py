"""Crash rates and their uncertainty."""

from __future__ import annotations

from cornerforge.intervals import binomial_interval, poisson_interval, rate_ratio_interval, weighted_interval

__all__ = ["binomial_interval", "poisson_interval", "rate_ratio_interval", "weighted_interval"]
