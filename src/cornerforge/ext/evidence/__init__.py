"""Evidence for assessors: what was found of an AV, question by question, each claim with what makes it again."""

from __future__ import annotations
