"""Calibration: trajectory readers, the fit of the naturalistic model, its validation and its pages."""

from __future__ import annotations

__all__: list[str] = []
